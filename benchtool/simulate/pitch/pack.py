"""From a bench and its controller to the numbers of the loop's work space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.effects.effect import HOOKS, Effect
from benchtool.physics.model import Model
from benchtool.simulate.controllers.pid import AttitudePid
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.pitch import rows as r
from benchtool.simulate.pitch.bench import GRAVITY_M_S2, PitchBench, PitchSensor

Array = NDArray[np.float64]


class Geometry(NamedTuple):
    """Hold places and distances of discs as the loop takes them."""

    table: Array
    distances: Array
    arms: Array


def geometry_of(model: Model) -> Geometry:
    """Return places (n, 3: x, y, root of the rotors on the disc), distances and arms of eq. (4)."""
    rig = model.rig
    places = rig.disc_positions_m
    counts = np.bincount(rig.disc_of_rotor, minlength=rig.n_discs)
    if rig.n_discs > r.MAX_DISCS:
        raise InputError(f"rig {rig.name!r} has {rig.n_discs} discs; the loop takes up to 8")
    if not np.any(places[:, 0]):
        raise InputError(
            f"rig {rig.name!r} has no rotor before or behind the hinge; take another rig"
        )
    return Geometry(
        np.ascontiguousarray(np.column_stack([places, np.sqrt(counts)])),
        np.ascontiguousarray(rig.disc_distances_m),
        np.ascontiguousarray(model.body_arms_m, float),
    )


def loop_effects(*models: Model, neutral_too: bool = False) -> tuple[Effect, ...]:
    """Return the effects that a loop must spell out for these models, in catalogue order.

    Those that cannot act are left out, but for those that stand in every loop; with `neutral_too`
    every effect of the models stands in it, so that one compilation serves all values of their
    numbers. What only lags, delays or wanders acts through numbers of its own.
    """
    found = {name: effect for name, effect in EFFECTS.items() if effect.always_compiled}
    for model in models:
        for effect in model.effects:
            hooks = effect.hooks
            outside = (hooks.lag_s, hooks.delay_s, hooks.random_torque)
            if any(outside) and sum(getattr(hooks, name) is not None for name in HOOKS) == 1:
                continue
            if neutral_too or effect.name in found or model.is_present(effect):
                found[effect.name] = effect
    order = [*EFFECTS, *(name for name in found if name not in EFFECTS)]
    return tuple(found[name] for name in order if name in found)


def pack(
    bench: PitchBench, control: PitchControl, believed: Model, effects: Sequence[Effect]
) -> Array:
    """Return one lane's column of the work space (n_rows,).

    Args:
        bench: the plant.
        control: its controller.
        believed: the model that feedforward and mixer take for true.
        effects: from `loop_effects`.
    """
    total = sum(len(effect.parameters) for effect in effects)
    w = np.zeros(r.EFFECTS + 2 * max(total, 1))
    model = bench.model
    p = model.rig.propulsion
    values = model.parameters
    w[r.INERTIA] = bench.inertia_kgm2
    w[r.WEIGHT] = model.rig.body.mass_kg * GRAVITY_M_S2
    w[r.K], w[r.RADIUS] = values["k"].value, values["R_m"].value
    w[r.SLOPE], w[r.START] = p.speed_per_us_rad_s, p.pwm_start_us
    w[r.PWM_MIN], w[r.PWM_MAX] = bench.pwm_min_us, bench.pwm_max_us
    w[r.PWM_QUANTUM] = bench.pwm_quantum_us
    w[r.STOP] = bench.stop_rad
    w[r.COVERED : r.COVERED + len(bench.covered)] = bench.covered
    w[r.FACTOR : r.FACTOR + r.MAX_DISCS] = 1.0
    _pack_motion(w, bench)
    for rows, name in (
        (r.THETA_SENSOR, "theta_rad"),
        (r.GYRO_SENSOR, "gyro_rad_s"),
        (r.PLATE_SENSOR, "plate_z_m"),
        (r.SPEED_SENSOR, "rpm"),
    ):
        sensor = bench.sensors.get(name, PitchSensor())
        for row, value in zip(rows, (sensor.noise, sensor.bias, sensor.quantum), strict=True):
            w[row] = value
    _pack_control(w, bench, control, believed)
    w[r.EFFECTS :] = np.concatenate(
        [_numbers(model, effects) or [0.0], _numbers(believed, effects) or [0.0]]
    )
    return w


def _pack_motion(w: Array, bench: PitchBench) -> None:
    """Work out lag, delay and wake torque for steps of the plant."""
    dt_s = 1.0 / bench.plant_rate_Hz
    tau_s, wait_s = bench.model.lag_s, bench.model.delay_s
    steps = int(np.floor(wait_s / dt_s + 1e-9))
    late_s = max(wait_s - steps * dt_s, 0.0)
    w[r.DELAY_STEPS] = steps
    half = 0.5 * dt_s

    def left(duration_s: float) -> float:
        """Return the share of the distance to a command that is left after some time."""
        if duration_s <= 0.0:
            return 1.0
        return float(np.exp(-duration_s / tau_s)) if tau_s > 0.0 else 0.0

    for rows, old_s in (
        ((r.MID_KEPT, r.MID_OLD, r.MID_NEW), min(late_s, half)),
        ((r.END_KEPT, r.END_OLD, r.END_NEW), max(late_s - half, 0.0)),
    ):
        before, after = left(old_s), left(half - old_s)
        w[rows[0]] = before * after
        w[rows[1]] = (1.0 - before) * after
        w[rows[2]] = 1.0 - after
    if bench.model.random_torque is not None:
        sd, correlation_s = bench.model.random_torque
        w[r.WAKE_KEPT] = np.exp(-dt_s / correlation_s)
        w[r.WAKE_KICK] = sd * np.sqrt(1.0 - w[r.WAKE_KEPT] ** 2)


def _pack_control(w: Array, bench: PitchBench, control: PitchControl, believed: Model) -> None:
    p = believed.rig.propulsion
    w[r.BELIEVED_K] = believed.parameters["k"].value
    w[r.BELIEVED_RADIUS] = believed.parameters["R_m"].value
    w[r.BELIEVED_SLOPE], w[r.BELIEVED_START] = p.speed_per_us_rad_s, p.pwm_start_us
    if control.gains is not None:
        attitude = control.gains.attitude
        given = {name: getattr(attitude, name) for name in attitude.__slots__}
        numbers = AttitudePid(
            **given,
            inertia_kgm2=believed.rig.body.inertia_yy_kgm2,
            torque_limit_Nm=torque_limit_Nm(bench, believed),
        )
        w[r.PID : r.PID + len(numbers)] = numbers
        w[r.OBSERVER_RATE] = control.gains.observer.rate_per_s if control.observer else 0.0
    w[r.STRENGTH] = control.feedforward.strength
    law = control.pulses
    w[r.PULSE_KP], w[r.PULSE_KI] = law.kp_us_per_rad, law.ki_us_per_rad_s
    w[r.PULSE_KD], w[r.PULSE_LIMIT] = law.kd_us_s_per_rad, law.limit_rad_s


def torque_limit_Nm(bench: PitchBench, believed: Model) -> float:
    """Return the torque that the mixer can give about hover before a rotor stops or saturates."""
    rig = believed.rig
    p = rig.propulsion
    x = rig.disc_positions_m[rig.disc_of_rotor, 0]
    top = (
        believed.parameters["k"].value
        * (p.speed_per_us_rad_s * (bench.pwm_max_us - p.pwm_start_us)) ** 2
    )
    room = min(bench.hover_N, max(top - bench.hover_N, 0.0))
    return float(room * np.sum(x * x) / np.max(np.abs(x)))


def _numbers(model: Model, effects: Sequence[Effect]) -> list[float]:
    out = []
    for effect in effects:
        for item in effect.parameters:
            full = f"{effect.name}.{item.name}"
            if full in model.parameters:
                out.append(model.parameters[full].value)
            else:
                out.append(item.value if item.neutral is None else item.neutral)
    return out
