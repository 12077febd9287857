"""From names and numbers on a command line to a bench with its controllers."""

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
from benchtool.simulate.controllers.laws import pitch_controller
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.gain_file import gains_named
from benchtool.simulate.pitch.bench import STEPS_PER_LAG, PitchBench
from benchtool.simulate.pitch.run import PitchJob, substeps_of
from benchtool.simulate.ranges import refuse_outside

BENCH_NUMBERS = ("inertia_kgm2", "plant_rate_Hz", "stop_rad", "pwm_quantum_us")
GAIN_TABLES = ("attitude", "observer")
MAX_PLANT_HZ = 1e5  # a hundred times the default; rejects typing errors; assumed
MIN_CONTROL_HZ = 1.0  # slower than any controller of an attitude; assumed
MIN_LAG_S = STEPS_PER_LAG / MAX_PLANT_HZ  # the quickest motor that this plant follows

FEEDFORWARD_NUMBERS = {
    "strength": (0.0, 10.0), "height_error_m": (-10.0, 10.0), "late_s": (-3600.0, 3600.0),
}  # fmt: skip
"""Numbers of a feedforward with what they may be: beyond anything a map does (a guess)."""

RANGES = {
    "inertia_kgm2": (1e-6, 1e4), "pwm_quantum_us": (0.0, 1e3), "stop_rad": (1e-3, 1.5),
}  # fmt: skip
"""Numbers of a bench with what they may be: from an insect to a helicopter (a guess)."""

PLATE_DISTANCE = "plate.z_over_R"


@dataclass(frozen=True, kw_only=True)
class PitchSetup:
    """Hold what a pitch simulation is made of.

    Attributes:
        nominal: the model that mixer and feedforward take for true; the bench's when None.
    """

    bench: PitchBench
    controls: tuple[PitchControl, ...]
    schedule: Schedule
    nominal: Model | None = None

    @property
    def rate_Hz(self) -> float:
        """The controllers' common rate."""
        rates = {control.control_rate_Hz for control in self.controls}
        if len(rates) != 1:
            raise InputError(f"controllers of different rates, {sorted(rates)} Hz; give one rate")
        rate_Hz = rates.pop()
        refuse_outside("control_rate_Hz", rate_Hz, MIN_CONTROL_HZ, MAX_PLANT_HZ)
        substeps_of(self.bench, rate_Hz)
        return rate_Hz


PITCH_RIG = "pquad"  # the rig on the hinge where neither a rig nor a model is named: the paper's


def pitch_setup(
    rig: str | None = None,
    model: str | None = None,
    gains: str = "s3",
    controllers: Sequence[str] = ("pid", "feedforward", "observer"),
    schedule: str = "plate",
    permit: CodePermit = check_code_allowed,
) -> PitchSetup:
    """Return the setup of these names; the model is the rig's own pitch model when left out.

    The rig is the model's when left out, pquad without a model.
    `permit` is called with the file of a model's own effects before it is run.
    """
    own = f"pitch_{rig or PITCH_RIG}"
    if model is not None:
        physics = load_model(model, None if rig is None else load_rig_by_name(rig), permit).model
    elif own in model_names():
        physics = load_model(own).model
    else:
        physics = Model.single(load_rig_by_name(rig or PITCH_RIG))
    set_ = gains_named(gains)
    return PitchSetup(
        bench=PitchBench.of(physics),
        controls=tuple(pitch_controller(name, set_) for name in controllers),
        schedule=load_schedule(schedule),
    )


def with_changes(setup: PitchSetup, values: Mapping[str, float]) -> PitchSetup:
    """Return the setup with some numbers changed, by name.

    A name is a model parameter ("k", "body_lift.K_b", or "K_b" alone where only one effect has
    it), a gain ("gains.attitude.k_q_per_s"), a factor on all gains of a table ("gains.attitude"),
    a number of the bench ("bench.inertia_kgm2") or of the feedforward ("feedforward.strength"), or
    the distance of every visit of the plate ("plate.z_over_R").
    """
    for name, value in values.items():
        if name == PLATE_DISTANCE:
            setup = replace(setup, schedule=_with_plate_at(setup.schedule, float(value)))
        else:
            bench, controls = _changed(setup.bench, setup.controls, name, float(value))
            setup = replace(setup, bench=bench, controls=controls)
    return setup


def changed_job(job: PitchJob, values: Mapping[str, float]) -> PitchJob:
    """Return a single job with some numbers changed, by the names of `with_changes`."""
    for name, value in values.items():
        if name == PLATE_DISTANCE:
            raise InputError(f"{name} belongs to a schedule, which places the plate; leave it out")
        bench, (control,) = _changed(job.bench, (job.control,), name, float(value))
        job = replace(job, bench=bench, control=control)
    return job


def _changed(
    bench: PitchBench, controls: tuple[PitchControl, ...], name: str, value: float
) -> tuple[PitchBench, tuple[PitchControl, ...]]:
    head, _, rest = name.partition(".")
    number: dict[str, Any] = {rest: value}
    if head == "gains" and rest:
        return bench, tuple(
            each if each.gains is None else replace(each, gains=each.gains.with_values(**number))
            for each in controls
        )
    if head == "feedforward":
        if rest not in FEEDFORWARD_NUMBERS:
            raise UnknownChoice("number of the feedforward", rest, FEEDFORWARD_NUMBERS)
        refuse_outside(name, value, *FEEDFORWARD_NUMBERS[rest])
        return bench, tuple(
            replace(each, feedforward=replace(each.feedforward, **number))
            if each.feedforward.strength > 0.0
            else each
            for each in controls
        )
    if head == "bench" and rest != "inertia_kgm2":
        if rest not in BENCH_NUMBERS:
            raise UnknownChoice("number of the bench", rest, BENCH_NUMBERS)
        if rest == "plant_rate_Hz" and value > MAX_PLANT_HZ:
            raise InputError(f"bench.plant_rate_Hz is {value:g}; give at most {MAX_PLANT_HZ:g} Hz")
        if rest in RANGES:
            refuse_outside(name, value, *RANGES[rest])
        return replace(bench, **number), controls
    model = _with_parameter(bench.model, rest if head == "bench" else name, value)
    inertia_kgm2 = model.parameters["inertia_kgm2"].value
    return replace(bench, model=model, inertia_kgm2=inertia_kgm2), controls


def _with_plate_at(schedule: Schedule, z_over_R: float) -> Schedule:
    if not schedule.plate:
        raise InputError(
            f"schedule {schedule.name!r} brings no plate, so it has no {PLATE_DISTANCE}; take one "
            f"that does, as plate"
        )
    if not 0.0 < z_over_R <= MAX_PLATE_Z_OVER_R:
        raise InputError(
            f"{PLATE_DISTANCE} is {z_over_R:g}; give rotor radii above 0, {MAX_PLATE_Z_OVER_R:g} "
            f"at most"
        )
    plate = tuple(replace(visit, z_over_R=z_over_R) for visit in schedule.plate)
    return replace(schedule, plate=plate)


def _with_parameter(model: Model, name: str, value: float) -> Model:
    full = _full_name(model, name)
    if full in RANGES:
        refuse_outside(full, value, *RANGES[full])
    owner = EFFECTS.get(full.partition(".")[0])
    lags = owner is not None and owner.hooks.lag_s is not None
    if lags and 0.0 < value < MIN_LAG_S:
        raise InputError(
            f"{full} is {value:g} s; give at least {MIN_LAG_S:g} s, or 0 for motors without lag"
        )
    if full not in model.parameters:
        model = model.with_effect(full.partition(".")[0])
    return model.with_fixed(full, value)


def _full_name(model: Model, name: str) -> str:
    """Return a parameter's full name, of the model or of an effect that it may be given."""
    offered = (
        f"{effect.name}.{item.name}" for effect in EFFECTS.values() for item in effect.parameters
    )
    known = dict.fromkeys((*model.parameters, *offered))
    gains = [f"gains.{table}" for table in GAIN_TABLES]
    return resolve_name(name, known, "number to set or vary", (*gains, PLATE_DISTANCE))
