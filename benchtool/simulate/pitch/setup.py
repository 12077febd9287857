"""Pitch bench with controllers and schedule from names and numbers, and named changes of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, groupby
from typing import Any, NamedTuple, Self

import numpy as np

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.parameter import resolve_name
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.schedule import MAX_PLATE_Z_OVER_R, Schedule, load_schedule
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model, model_names
from benchtool.simulate.controllers.laws import PITCH_CONTROLLERS, build_pitch_controller
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.gain_file import load_gains
from benchtool.simulate.inputs import CONTROL_HZ, PitchInputs, Point, Row, Setup, check_range
from benchtool.simulate.pitch.bench import STEPS_PER_LAG, PitchBench
from benchtool.simulate.pitch.run import PitchJob, PitchLoop, count_substeps, shared_key
from benchtool.simulate.pitch.simulate import extract_run, measure_plate_visit, simulate_many

BENCH_NUMBERS = ("inertia_kgm2", "plant_rate_Hz", "stop_rad", "pwm_quantum_us")
GAIN_TABLES = ("attitude", "observer")
MAX_PLANT_HZ = CONTROL_HZ[1]  # a hundred times the default; rejects typing errors; assumed
MIN_LAG_S = STEPS_PER_LAG / MAX_PLANT_HZ  # fastest motor for this plant

FEEDFORWARD_NUMBERS = {  # ranges, wider than errors of any map; assumed
    "strength": (0.0, 10.0), "height_error_m": (-10.0, 10.0), "late_s": (-3600.0, 3600.0),
}  # fmt: skip

RANGES = {  # of a bench: from an insect to a helicopter; assumed
    "inertia_kgm2": (1e-6, 1e4), "pwm_quantum_us": (0.0, 1e3), "stop_rad": (1e-3, 1.5),
}  # fmt: skip

PLATE_DISTANCE = "plate.z_over_R"
PITCH_RIG = "pquad"  # default rig, from the paper

MEASURES = {  # of every run; those of the first plate visit are nan without one
    "rms_deg": "RMS error of pitch [deg]",
    "peak_deg": "peak of the plate's visit [deg]",
    "residual_deg": "residual of the plate's visit [deg]",
    "rebound_deg": "rebound after the plate's visit [deg]",
    "quiet_rms_deg": "RMS of pitch before the plate [deg]",
    "stopped_steps": "steps at the hinge's stop",
}


class PitchPoint(NamedTuple):
    """Run at a point of a design; runs with equal `key` share one loop."""

    setup: PitchSetup
    job: PitchJob
    key: tuple[object, ...]


@dataclass(frozen=True, kw_only=True)
class PitchSetup(Setup):
    """Pitch bench with its controllers and schedule."""

    measures = MEASURES

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
        check_range("control_rate_Hz", rate_Hz, *CONTROL_HZ)
        count_substeps(self.bench, rate_Hz)
        return rate_Hz

    @property
    def campaign_title(self) -> str:
        schedule = self.schedule
        return f"{self.bench.model.rig.name}: {schedule.title or schedule.name}"

    def to_metadata(self) -> dict[str, str]:
        return {"model": self.bench.model.name, "schedule": self.schedule.name}

    def with_number(self, name: str, value: float) -> Self:
        """Return the setup with one number changed, by name.

        A name is a model parameter ("k", "body_lift.K_b", or "K_b" if only one effect has it), a
        gain ("gains.attitude.k_q_per_s"), a factor on all gains of a table ("gains.attitude"), a
        number of the bench ("bench.inertia_kgm2") or of the feedforward ("feedforward.strength"),
        or the distance of all plate visits ("plate.z_over_R").
        """
        if name == PLATE_DISTANCE:
            return replace(self, schedule=_with_plate_at(self.schedule, value))
        head, _, field = name.partition(".")
        number: dict[str, Any] = {field: value}
        if head == "gains" and field:
            controls = [
                replace(control, gains=control.gains.with_values(**number))
                if control.gains
                else control
                for control in self.controls
            ]
            return replace(self, controls=tuple(controls))
        if head == "feedforward":
            if field not in FEEDFORWARD_NUMBERS:
                raise UnknownChoice("number of the feedforward", field, FEEDFORWARD_NUMBERS)
            check_range(name, value, *FEEDFORWARD_NUMBERS[field])
            controls = [
                replace(control, feedforward=replace(control.feedforward, **number))
                if control.feedforward.strength > 0.0
                else control
                for control in self.controls
            ]
            return replace(self, controls=tuple(controls))
        if head == "bench" and field != "inertia_kgm2":
            if field not in BENCH_NUMBERS:
                raise UnknownChoice("number of the bench", field, BENCH_NUMBERS)
            if field == "plant_rate_Hz" and value > MAX_PLANT_HZ:
                raise InputError(
                    f"bench.plant_rate_Hz is {value:g}; allowed: up to {MAX_PLANT_HZ:g}"
                )
            if field in RANGES:
                check_range(name, value, *RANGES[field])
            return replace(self, bench=replace(self.bench, **number))
        model = _with_parameter(self.bench.model, field if head == "bench" else name, value)
        inertia_kgm2 = model.parameters["inertia_kgm2"].value
        return replace(self, bench=replace(self.bench, model=model, inertia_kgm2=inertia_kgm2))

    def check_point(self, point: Point, varied: Sequence[str], seeds: int, controller: str) -> None:
        changed = self.with_changes(point)
        if changed.rate_Hz != self.rate_Hz:
            raise InputError("control_rate_Hz cannot be varied; run one campaign per rate")
        if changed.schedule != self.schedule:
            raise InputError(
                f"{PLATE_DISTANCE} cannot be varied; run one campaign per distance, with --set"
            )

    def build_run(self, controller: str, point: Point) -> PitchPoint:
        changed = self.with_changes(point)
        control = next(control for control in changed.controls if control.name == controller)
        job = PitchJob(changed.bench, control)
        return PitchPoint(changed, job, (changed.rate_Hz, *shared_key(job)))

    @staticmethod
    def measure_runs(
        runs: Iterator[tuple[PitchPoint, int]], seed: int, threads: int | None
    ) -> Iterator[Row]:
        for _, group in groupby(runs, key=lambda pair: pair[0].key):
            first, number = next(group)
            schedule, radius_m = first.setup.schedule, first.job.bench.model.rig.propulsion.radius_m
            yield from simulate_many(
                ((run.job, number) for run, number in chain([(first, number)], group)),
                schedule.sampled(first.setup.rate_Hz, radius_m),
                partial(_measure_run, schedule),
                seed=seed,
                threads=threads,
            )


def _measure_run(schedule: Schedule, loop: PitchLoop, lane: int, _run_number: int) -> Row:
    run = extract_run(loop, lane, "campaign")
    error = run.column("true_theta_rad") - run.column("reference_rad")
    measures = dict.fromkeys(MEASURES, float("nan"))
    measures["rms_deg"] = float(np.degrees(np.sqrt(np.mean(error**2))))
    measures["stopped_steps"] = float(run.stopped_steps)
    visit, end_s = schedule.plate[0] if schedule.plate else None, schedule.duration_s
    if visit is not None and visit.in_s < end_s:
        numbers = measure_plate_visit(run, visit, end_s)
        for name in ("peak", "residual", "rebound", "quiet_rms"):
            measures[f"{name}_deg"] = float(np.degrees(getattr(numbers, f"{name}_rad")))
    return measures


def pitch_setup(
    inputs: PitchInputs, gains: str = "s3", permit: CodePermit = check_code_allowed
) -> PitchSetup:
    """Return the setup of one gain set.

    The default model is the pitch model of the rig; the default rig is that of the model, pquad
    without a model. `permit` is called with the file of user-defined effects before it is run.
    """
    rig, library_model = inputs.rig, f"pitch_{inputs.rig or PITCH_RIG}"
    if inputs.model:
        loaded = load_model(inputs.model, None if rig is None else load_rig_by_name(rig), permit)
        model = loaded.model
    elif library_model in model_names():
        model = load_model(library_model).model
    else:
        model = Model.single(load_rig_by_name(rig or PITCH_RIG))
    gain_set, duration_s = load_gains(gains), inputs.study.duration_s
    names = [name for name in inputs.controllers if name in PITCH_CONTROLLERS] or ["pid"]
    setup = PitchSetup(
        bench=PitchBench.from_model(model),
        controls=tuple(build_pitch_controller(name, gain_set) for name in names),
        schedule=load_schedule(inputs.schedule),
    ).with_changes(inputs.study.settings)
    if duration_s is None:
        return setup
    return replace(setup, schedule=setup.schedule.with_duration(duration_s))


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
    """Return the model with a number changed; a missing effect of the catalogue is added."""
    effect_parameters = (
        f"{effect.name}.{parameter.name}"
        for effect in EFFECTS.values()
        for parameter in effect.parameters
    )
    names = dict.fromkeys((*model.parameters, *effect_parameters))
    tables = (*(f"gains.{table}" for table in GAIN_TABLES), PLATE_DISTANCE)
    full_name = resolve_name(name, names, "number to set or vary", tables)
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
