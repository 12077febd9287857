"""From a bench and its controller to the numbers of the loop's work space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchtool.core.array import Array
from benchtool.core.errors import InputError
from benchtool.physics.disc_thrust import ImageRules
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model
from benchtool.simulate.controllers.controller import PitchPlant
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.hooks import loop_numbers
from benchtool.simulate.layout import Layout
from benchtool.simulate.motors import motion_of
from benchtool.simulate.pitch import records as r
from benchtool.simulate.pitch.bench import GRAVITY_M_S2, SENSOR_NAMES, PitchBench, PitchSensor

MAX_DISCS = 8  # what a loop takes: beyond, it compiles for minutes


def rules_of(model: Model) -> ImageRules:
    """Return a model's rules of images for a plate that leans about the hinge alone."""
    x_m, _, arm_m = (part.tolist() for part in model.body_images)
    places = list(zip(x_m, arm_m, strict=True))
    return model.image_rules._replace(body_like=tuple(map(places.index, places)))


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
    roots = np.sqrt(counts)
    span_m2 = sum(root * root * x * x for root, x in zip(roots, places[:, 0], strict=True))
    parts = [
        *(dt_s, span_m2, places[:, 0], places[:, 1], roots, rig.disc_distances_m),
        *model.body_images,
    ]
    return np.concatenate([np.ravel(part) for part in parts])


def pack(
    bench: PitchBench,
    control: PitchControl,
    nominal: Model,
    effects: Sequence[Effect],
    layout: Layout,
) -> Array:
    """Return one lane's column of the work space (n_rows,)."""
    model, dt_s = bench.model, 1.0 / bench.plant_rate_Hz
    discs = (0.0,) * model.rig.n_discs
    values, sensors = model.parameters, bench.sensors
    shown = [
        r.SensorErrors(sensor.noise, sensor.bias, sensor.quantum)
        for sensor in (sensors.get(name, PitchSensor()) for name in SENSOR_NAMES)
    ]
    inertia_kgm2 = nominal.rig.body.inertia_yy_kgm2
    plant = PitchPlant(inertia_kgm2, torque_limit_Nm(bench, nominal))
    return layout.column(
        command=r.Command(0.0, 0.0, tuple(1.0 for _ in discs), discs),
        body=r.HingedBody(
            dt_s / bench.inertia_kgm2, model.rig.body.mass_kg * GRAVITY_M_S2, values["k"].value,
            values["R_m"].value, bench.stop_rad, tuple(bench.covered),
        ),
        pulses=_pulse_map(model),
        limits=r.PulseLimits(bench.pwm_min_us, bench.pwm_max_us, bench.pwm_quantum_us),
        motion=motion_of(model, dt_s),
        sensors=r.Sensors(*shown),
        nominal=r.Nominal(
            nominal.parameters["k"].value, nominal.parameters["R_m"].value, _pulse_map(nominal),
            control.feedforward.strength,
        ),
        law=control.law.numbers(control, plant),
        effects=loop_numbers(model, effects),
        nominal_effects=loop_numbers(nominal, effects),
    )  # fmt: skip


def _pulse_map(model: Model) -> r.PulseMap:
    propulsion = model.rig.propulsion
    return r.PulseMap(propulsion.speed_per_us_rad_s, propulsion.pwm_start_us)


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
