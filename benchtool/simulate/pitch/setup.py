"""Pitch bench with controllers and schedule from names and numbers, and named changes of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.parameter import resolve_name
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.schedule import MAX_PLATE_Z_OVER_R, Schedule
from benchtool.core.schedule_file import load_schedule
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model, model_names
from benchtool.simulate.controllers.laws import build_pitch_controller
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.gain_file import load_gains
from benchtool.simulate.pitch.bench import STEPS_PER_LAG, PitchBench
from benchtool.simulate.pitch.run import PitchJob, count_substeps
from benchtool.simulate.ranges import check_range

BENCH_NUMBERS = ("inertia_kgm2", "plant_rate_Hz", "stop_rad", "pwm_quantum_us")
GAIN_TABLES = ("attitude", "observer")
MAX_PLANT_HZ = 1e5  # a hundred times the default; rejects typing errors; assumed
MIN_CONTROL_HZ = 1.0  # slower than any controller of an attitude; assumed
MIN_LAG_S = STEPS_PER_LAG / MAX_PLANT_HZ  # fastest motor for this plant

FEEDFORWARD_NUMBERS = {  # ranges, wider than errors of any map; assumed
    "strength": (0.0, 10.0), "height_error_m": (-10.0, 10.0), "late_s": (-3600.0, 3600.0),
}  # fmt: skip

RANGES = {  # of a bench: from an insect to a helicopter; assumed
    "inertia_kgm2": (1e-6, 1e4), "pwm_quantum_us": (0.0, 1e3), "stop_rad": (1e-3, 1.5),
}  # fmt: skip

PLATE_DISTANCE = "plate.z_over_R"


@dataclass(frozen=True, kw_only=True)
class PitchSetup:
    """Pitch bench with its controllers and schedule."""

    bench: PitchBench
    controls: tuple[PitchControl, ...]
    schedule: Schedule

    @property
    def rate_Hz(self) -> float:
        """Common rate of the controllers."""
        rates = {control.control_rate_Hz for control in self.controls}
        if len(rates) != 1:
            raise InputError(f"controllers have different rates: {sorted(rates)} Hz; use one rate")
        rate_Hz = rates.pop()
        check_range("control_rate_Hz", rate_Hz, MIN_CONTROL_HZ, MAX_PLANT_HZ)
        count_substeps(self.bench, rate_Hz)
        return rate_Hz


PITCH_RIG = "pquad"  # default rig, from the paper


def pitch_setup(
    rig: str | None = None,
    model: str | None = None,
    gains: str = "s3",
    controllers: Sequence[str] = ("pid", "feedforward", "observer"),
    schedule: str = "plate",
    permit: CodePermit = check_code_allowed,
) -> PitchSetup:
    """Return the setup of these names.

    The default model is the pitch model of the rig; the default rig is that of the model, pquad
    without a model. `permit` is called with the file of user-defined effects before it is run.
    """
    library_model = f"pitch_{rig or PITCH_RIG}"
    if model is not None:
        physics = load_model(model, None if rig is None else load_rig_by_name(rig), permit).model
    elif library_model in model_names():
        physics = load_model(library_model).model
    else:
        physics = Model.single(load_rig_by_name(rig or PITCH_RIG))
    gain_set = load_gains(gains)
    return PitchSetup(
        bench=PitchBench.from_model(physics),
        controls=tuple(build_pitch_controller(name, gain_set) for name in controllers),
        schedule=load_schedule(schedule),
    )


def with_changes(setup: PitchSetup, values: Mapping[str, float]) -> PitchSetup:
    """Return the setup with some numbers changed, by name.

    A name is a model parameter ("k", "body_lift.K_b", or "K_b" if only one effect has it), a gain
    ("gains.attitude.k_q_per_s"), a factor on all gains of a table ("gains.attitude"), a number of
    the bench ("bench.inertia_kgm2") or of the feedforward ("feedforward.strength"), or the distance
    of all plate visits ("plate.z_over_R").
    """
    for name, value in values.items():
        if name == PLATE_DISTANCE:
            setup = replace(setup, schedule=_with_plate_at(setup.schedule, float(value)))
        else:
            bench, controls = _with_number(setup.bench, setup.controls, name, float(value))
            setup = replace(setup, bench=bench, controls=controls)
    return setup


def apply_job_changes(job: PitchJob, values: Mapping[str, float]) -> PitchJob:
    """Return a single job with some numbers changed, by the names of `with_changes`."""
    for name, value in values.items():
        if name == PLATE_DISTANCE:
            raise InputError(f"{name} cannot be set here: the schedule moves the plate; remove it")
        bench, (control,) = _with_number(job.bench, (job.control,), name, float(value))
        job = replace(job, bench=bench, control=control)
    return job


def _with_number(
    bench: PitchBench, controls: tuple[PitchControl, ...], name: str, value: float
) -> tuple[PitchBench, tuple[PitchControl, ...]]:
    head, _, field = name.partition(".")
    number: dict[str, Any] = {field: value}
    if head == "gains" and field:
        return bench, tuple(
            control
            if control.gains is None
            else replace(control, gains=control.gains.with_values(**number))
            for control in controls
        )
    if head == "feedforward":
        if field not in FEEDFORWARD_NUMBERS:
            raise UnknownChoice("number of the feedforward", field, FEEDFORWARD_NUMBERS)
        check_range(name, value, *FEEDFORWARD_NUMBERS[field])
        return bench, tuple(
            replace(control, feedforward=replace(control.feedforward, **number))
            if control.feedforward.strength > 0.0
            else control
            for control in controls
        )
    if head == "bench" and field != "inertia_kgm2":
        if field not in BENCH_NUMBERS:
            raise UnknownChoice("number of the bench", field, BENCH_NUMBERS)
        if field == "plant_rate_Hz" and value > MAX_PLANT_HZ:
            raise InputError(f"bench.plant_rate_Hz is {value:g}; allowed: up to {MAX_PLANT_HZ:g}")
        if field in RANGES:
            check_range(name, value, *RANGES[field])
        return replace(bench, **number), controls
    model = _with_parameter(bench.model, field if head == "bench" else name, value)
    inertia_kgm2 = model.parameters["inertia_kgm2"].value
    return replace(bench, model=model, inertia_kgm2=inertia_kgm2), controls


def _with_plate_at(schedule: Schedule, z_over_R: float) -> Schedule:
    if not schedule.plate:
        raise InputError(
            f"schedule {schedule.name!r} has no plate and so no {PLATE_DISTANCE}; use a schedule "
            f"with a plate, for example plate"
        )
    if not 0.0 < z_over_R <= MAX_PLATE_Z_OVER_R:
        raise InputError(
            f"{PLATE_DISTANCE} is {z_over_R:g}; allowed: above 0, up to {MAX_PLATE_Z_OVER_R:g}"
        )
    plate = tuple(replace(visit, z_over_R=z_over_R) for visit in schedule.plate)
    return replace(schedule, plate=plate)


def _with_parameter(model: Model, name: str, value: float) -> Model:
    full_name = _full_name(model, name)
    if full_name in RANGES:
        check_range(full_name, value, *RANGES[full_name])
    effect = EFFECTS.get(full_name.partition(".")[0])
    has_lag = effect is not None and effect.hooks.lag_s is not None
    if has_lag and 0.0 < value < MIN_LAG_S:
        raise InputError(
            f"{full_name} is {value:g} s; allowed: from {MIN_LAG_S:g} s, or 0 for motors without "
            f"lag"
        )
    if full_name not in model.parameters:
        model = model.with_effect(full_name.partition(".")[0])
    return model.with_fixed(full_name, value)


def _full_name(model: Model, name: str) -> str:
    """Return the full name of a parameter of the model or of an effect in the catalogue."""
    effect_parameters = (
        f"{effect.name}.{parameter.name}"
        for effect in EFFECTS.values()
        for parameter in effect.parameters
    )
    names = dict.fromkeys((*model.parameters, *effect_parameters))
    gains = [f"gains.{table}" for table in GAIN_TABLES]
    return resolve_name(name, names, "number to set or vary", (*gains, PLATE_DISTANCE))
