"""Campaign of the pitch bench, in parallel lanes of the compiled loop."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from itertools import chain, groupby
from typing import NamedTuple

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.schedule import Schedule
from benchtool.simulate.campaign import Campaign, Point, Row
from benchtool.simulate.design import Design
from benchtool.simulate.pitch.result import measure_plate_visit
from benchtool.simulate.pitch.run import PitchJob, PitchLoop, shared_key
from benchtool.simulate.pitch.setup import PLATE_DISTANCE, PitchSetup, with_changes
from benchtool.simulate.pitch.simulate import extract_run, simulate_many

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


def pitch_campaign(setups: Mapping[str, PitchSetup]) -> Campaign:
    """Return the campaign of the setups by gain set."""
    first = next(iter(setups.values()))
    model, schedule = first.bench.model, first.schedule
    return Campaign(
        title=f"{model.rig.name}: {schedule.title or schedule.name}",
        metadata={"model": model.name, "schedule": schedule.name},
        setups=setups,
        controllers=tuple(control.name for control in first.controls),
        measures=MEASURES,
        probe=_probe,
        case=_case,
        run=_run,
    )


def _probe(setup: PitchSetup, point: Point, _: Design) -> None:
    changed = with_changes(setup, point)
    if changed.rate_Hz != setup.rate_Hz:
        raise InputError("control_rate_Hz cannot be varied; run one campaign per rate")
    if changed.schedule != setup.schedule:
        raise InputError(
            f"{PLATE_DISTANCE} cannot be varied; run one campaign per distance, with --set"
        )


def _case(setup: PitchSetup, controller: str, point: Point) -> PitchPoint:
    changed = with_changes(setup, point)
    control = next(control for control in changed.controls if control.name == controller)
    job = PitchJob(changed.bench, control)
    return PitchPoint(changed, job, (changed.rate_Hz, *shared_key(job)))


def _run(cases: Iterator[tuple[PitchPoint, int]], seed: int, threads: int | None) -> Iterator[Row]:
    for _, group in groupby(cases, key=lambda pair: pair[0].key):
        first_case, number = next(group)
        schedule = first_case.setup.schedule
        radius_m = first_case.job.bench.model.rig.propulsion.radius_m
        yield from simulate_many(
            ((case.job, number) for case, number in chain([(first_case, number)], group)),
            schedule.sampled(first_case.setup.rate_Hz, radius_m),
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
        numbers = measure_plate_visit(run, visit.in_s, min(visit.out_s, end_s), visit.move_s)
        for name in ("peak", "residual", "rebound", "quiet_rms"):
            measures[f"{name}_deg"] = float(np.degrees(getattr(numbers, f"{name}_rad")))
    return measures
