"""From a bench and its controller to the numbers of the loop's work space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchtool.core.array import Array
from benchtool.core.errors import InputError
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.effects.effect import HOOKS, Effect
from benchtool.physics.model import Model
from benchtool.simulate.controllers.controller import PitchPlant
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.pitch import records as r
from benchtool.simulate.pitch.bench import GRAVITY_M_S2, SENSOR_NAMES, PitchBench, PitchSensor

MAX_DISCS = 8
"""What a loop takes: beyond, it compiles for minutes."""


def geometry_of(model: Model, dt_s: float) -> Array:
    """Return plant step, places and distances as the loop takes them, see `Geometry`."""
    rig = model.rig
    places = rig.disc_positions_m
    counts = np.bincount(rig.disc_of_rotor, minlength=rig.n_discs)
    if rig.n_discs > MAX_DISCS:
        raise InputError(f"rig {rig.name!r} has {rig.n_discs} discs; the loop takes up to 8")
    if not np.any(places[:, 0]):
        raise InputError(
            f"rig {rig.name!r} has no rotor before or behind the hinge; take another rig"
        )
    parts: list[Any] = [
        dt_s,
        places[:, 0],
        places[:, 1],
        np.sqrt(counts),
        rig.disc_distances_m,
        model.body_arms_m,
    ]
    return np.concatenate([np.ravel(part) for part in parts])


def loop_effects(*models: Model, neutral_too: bool = False) -> tuple[Effect, ...]:
    """Return the effects whose hooks a loop for these models calls, in catalogue order.

    Those that cannot act are left out, but for those that stand in every loop; with `neutral_too`
    every effect of the models stands in it, so that one compilation serves all values of their
    numbers. Lag, delay and random torque act through numbers of their own, see `_motion`.
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
    bench: PitchBench,
    control: PitchControl,
    nominal: Model,
    effects: Sequence[Effect],
    layout: r.Layout,
) -> Array:
    """Return one lane's column of the work space (n_rows,).

    Args:
        bench: the plant.
        control: its controller.
        nominal: the model that feedforward and mixer take for true.
        effects: from `loop_effects`.
        layout: where records stand.
    """
    model, discs = bench.model, (0.0,) * layout.n_discs
    values, sensors = model.parameters, bench.sensors
    shown = [
        r.Sensor(sensor.noise, sensor.bias, sensor.quantum)
        for sensor in (sensors.get(name, PitchSensor()) for name in SENSOR_NAMES)
    ]
    inertia_kgm2 = nominal.rig.body.inertia_yy_kgm2
    plant = PitchPlant(inertia_kgm2, torque_limit_Nm(bench, nominal))
    return layout.column(
        command=r.Command(0.0, 0.0, tuple(1.0 for _ in discs), discs),
        body=r.Body(
            bench.inertia_kgm2, model.rig.body.mass_kg * GRAVITY_M_S2, values["k"].value,
            values["R_m"].value, bench.stop_rad, tuple(bench.covered),
        ),
        pulses=_pulse_map(model),
        limits=r.PulseLimits(bench.pwm_min_us, bench.pwm_max_us, bench.pwm_quantum_us),
        motion=_motion(bench),
        sensors=r.Sensors(*shown),
        nominal=r.Nominal(
            nominal.parameters["k"].value, nominal.parameters["R_m"].value, _pulse_map(nominal),
            control.feedforward.strength,
        ),
        law=control.law.numbers(control, plant),
        effects=_numbers(model, effects),
        nominal_effects=_numbers(nominal, effects),
    )  # fmt: skip


def _pulse_map(model: Model) -> r.PulseMap:
    propulsion = model.rig.propulsion
    return r.PulseMap(propulsion.speed_per_us_rad_s, propulsion.pwm_start_us)


def _motion(bench: PitchBench) -> r.Motion:
    """Return lag, delay and random torque for steps of the plant."""
    dt_s = 1.0 / bench.plant_rate_Hz
    tau_s, wait_s = bench.model.lag_s, bench.model.delay_s
    steps = int(np.floor(wait_s / dt_s + 1e-9))
    late_s, half = max(wait_s - steps * dt_s, 0.0), 0.5 * dt_s

    def remains(duration_s: float) -> float:
        """Return the share of the distance to a command that is left after some time."""
        if duration_s <= 0.0:
            return 1.0
        return float(np.exp(-duration_s / tau_s)) if tau_s > 0.0 else 0.0

    def over(old_s: float) -> r.Lag:
        """Return the lag over half a step, the first `old_s` of it on the command before."""
        before, after = remains(old_s), remains(half - old_s)
        return r.Lag(before * after, (1.0 - before) * after, 1.0 - after)

    wake_remains = wake_kick = 0.0
    if bench.model.random_torque is not None:
        sd, correlation_s = bench.model.random_torque
        wake_remains = np.exp(-dt_s / correlation_s)
        wake_kick = sd * np.sqrt(1.0 - wake_remains**2)
    first, second = over(min(late_s, half)), over(max(late_s - half, 0.0))
    return r.Motion(first, second, wake_remains, wake_kick, float(steps))


def torque_limit_Nm(bench: PitchBench, nominal: Model) -> float:
    """Return the torque that the mixer can give about hover before a rotor stops or saturates."""
    rig = nominal.rig
    p = rig.propulsion
    x = rig.disc_positions_m[rig.disc_of_rotor, 0]
    top = (
        nominal.parameters["k"].value
        * (p.speed_per_us_rad_s * (bench.pwm_max_us - p.pwm_start_us)) ** 2
    )
    room = min(bench.hover_N, max(top - bench.hover_N, 0.0))
    return float(room * np.sum(x * x) / np.max(np.abs(x)))


def _numbers(model: Model, effects: Sequence[Effect]) -> tuple[float, ...]:
    """Return the effects' numbers in a model, neutral where it lacks them; one zero without any."""
    out = []
    for effect in effects:
        for item in effect.parameters:
            full = f"{effect.name}.{item.name}"
            neutral = item.value if item.neutral is None else item.neutral
            out.append(model.parameters[full].value if full in model.parameters else neutral)
    return tuple(out) or (0.0,)
