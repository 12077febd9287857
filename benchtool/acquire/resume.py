"""Resuming of a run from its folder."""

from __future__ import annotations

import os
from dataclasses import dataclass, field

import numpy as np

from benchtool.acquire.plan import Plan, plan_from_toml
from benchtool.acquire.record import LinkQuality
from benchtool.acquire.visit_order import plan_visits
from benchtool.bench.bench import DeviceInfo
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.rig import Rig
from benchtool.core.text import pluralize
from benchtool.core.user_file import read_file
from benchtool.data.calibration import Calibration, parse_calibration
from benchtool.data.columns import VALID_KINDS, word_to_code
from benchtool.data.run.read import read_points, run_rig
from benchtool.data.run.run import Run

MIN_GAP_S = 1.0  # run time of an interruption; its event has the real time


@dataclass(frozen=True, slots=True)
class ResumeState:
    """State of a run on disk, for resuming."""

    run: Run
    plan: Plan
    rig: Rig
    calibration: Calibration | None
    done: frozenset[int]
    remaining: int
    stage: str | None = None


@dataclass(frozen=True, slots=True)
class SweepStart:
    """Starting state of a sweep; the defaults are a new sweep.

    Attributes:
        done: numbers of the points that a resumed run has measured.
        time_s: run time at which this part begins.
        unsettled, suspect: counts among the measured points.
        tares: number of tares so far.
    """

    done: frozenset[int] = frozenset()
    time_s: float = 0.0
    unsettled: int = 0
    suspect: int = 0
    tares: int = 0
    link: LinkQuality = field(default_factory=LinkQuality)


def load_resume_state(run: Run) -> ResumeState:
    """Read completed and missing visits of a run, without changes.

    Raises:
        InputError: a recording, which has no plan to resume.
        FileFormatError: unreadable file of the run.
    """
    facts = run.metadata
    if kind := facts.get("experiment"):
        raise InputError(f"{run.path} is a {kind} recording and cannot be resumed; record again")
    where = str(run.path / "metadata.json")
    rig = run_rig(run.path, facts)
    plan_file = str(run.path / "plan.toml")
    plan = plan_from_toml(run.plan_text, plan_file)
    if not ((plan.plate.distances_m or not plan.plate.used) and plan.throttle.pwm_us):
        raise FileFormatError(
            plan_file,
            "plate.distances_m or throttle.pwm_us is missing from the plan of the run; restore it "
            "from a copy",
        )
    calibration = facts.get("calibration")
    visits = {visit.point for visit in plan_visits(plan, rig)}
    done = frozenset(_points_on_disk(run)) & visits
    return ResumeState(
        run,
        plan,
        rig,
        parse_calibration(calibration, f"{where}: calibration") if calibration else None,
        done,
        len(visits - done),
        (facts.get("plate") or {}).get("stage"),
    )


def close_run(run: Run) -> bool:
    """Close a run of any kind; return True if data were missing (see `Run.close`)."""
    if "visits" in run.metadata or run.metadata.get("experiment"):
        return run.close()
    state = load_resume_state(run)
    return run.close(len(state.done) + state.remaining)


def prepare_resume(unfinished: ResumeState) -> SweepStart:
    """Prepare the files of a run to resume, before its bench is opened.

    Samples of an incomplete visit are kept and marked as `interrupted`. A complete run that is
    still open is closed.

    Raises:
        InputError: the run is complete, or another process measures it.
        FileFormatError: unreadable file of the run.
        ResourceExhausted: the run cannot be written.
    """
    run = unfinished.run
    if not unfinished.remaining:
        visits = pluralize(len(unfinished.done), "visit")
        closed = "; it has now been closed" if run.close(len(unfinished.done)) else ""
        raise InputError(
            f"nothing to resume in {run.path}: all visits are measured ({visits}){closed}"
        )
    samples = run.prepare_samples(unfinished.done)
    if not samples.rows:
        return SweepStart(unfinished.done)
    link = run.metadata.get("link") or {}
    quality = LinkQuality(
        samples.rows, *(link.get(name, 0) for name in ("lost", "corrupt", "repeated"))
    )
    counts = _counts(run, unfinished.done)
    return SweepStart(unfinished.done, samples.last_s + MIN_GAP_S, *counts, quality)


def require_same_device(unfinished: ResumeState, identity: DeviceInfo) -> None:
    """Raise InputError for another device than that of the run."""
    run = unfinished.run
    device_id = run.metadata.get("device_id")
    if device_id != identity.device_id:
        raise InputError(
            f"run {run.path} was started on device {device_id!r}, but {identity.address} is "
            f"{identity.device_id!r}; connect the first device, or start a new run"
        )


def _counts(run: Run, done: frozenset[int]) -> tuple[int, int, int]:
    """Return the numbers of unsettled visits, suspect visits and tares."""
    try:
        points = read_points(run.path, VALID_KINDS)
    except FileFormatError:
        return 0, 0, 0
    tares = points.column("kind") == word_to_code("kind", "tare")
    is_done = np.isin(points.column("point"), list(done)) & ~tares
    unsettled = is_done & (points.column("settled") == 0.0)
    suspect = int(points.column("suspect")[is_done].sum()) if "suspect" in points else 0
    return int(unsettled.sum()), suspect, int(tares.sum())


def _points_on_disk(run: Run) -> set[int]:
    """Return the visits with stored points.

    Raises:
        FileFormatError: unreadable line, which must be repaired by hand so that no point is lost.
    """
    path = run.path / "points.csv"
    if not os.path.lexists(path):
        return set()
    whole_lines = read_file(path).decode("utf-8", "replace").split("\n")[1:-1]
    if all(line.split(",")[1:2] in (["tare"], ["failed"]) for line in whole_lines):
        return set()
    return {int(point) for point in read_points(run.path).column("point")}
