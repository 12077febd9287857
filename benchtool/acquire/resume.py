"""Go on with a run from what is on disk."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from benchtool.acquire.plan import Plan, plan_from_toml
from benchtool.acquire.record import LinkQuality
from benchtool.acquire.sweep import SweepStart
from benchtool.acquire.visit_order import plan_visits
from benchtool.bench.bench import DeviceInfo
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.plural import pluralize
from benchtool.core.rig import Rig
from benchtool.core.user_file import read_file
from benchtool.data.calibration import Calibration, parse_calibration
from benchtool.data.columns import VALID_KINDS, word_to_code
from benchtool.data.run.read import read_points
from benchtool.data.run.run import Run
from benchtool.data.run.run_rig import run_rig

MIN_GAP_S = 1.0  # run time that a break counts as; the event has the real one


@dataclass(frozen=True, slots=True)
class ResumeState:
    """Hold what a run on disk holds for going on."""

    run: Run
    plan: Plan
    rig: Rig
    calibration: Calibration | None
    done: frozenset[int]
    left: int
    stage: str | None = None


def load_resume_state(run: Run) -> ResumeState:
    """Read what a run has and what it lacks; nothing is changed.

    Raises:
        InputError: a recording, which has no plan that could be resumed.
        FileFormatError: a file of the run cannot be read.
    """
    facts = run.metadata
    if kind := facts.get("experiment"):
        raise InputError(
            f"{run.path} is a {kind} recording, which has no visits left to measure; record again"
        )
    where = str(run.path / "metadata.json")
    rig = run_rig(run.path, facts)
    plan_file = str(run.path / "plan.toml")
    plan = plan_from_toml(run.plan_text, plan_file)
    if not ((plan.plate.distances_m or not plan.plate.used) and plan.throttle.pwm_us):
        raise FileFormatError(
            plan_file,
            "plate.distances_m or throttle.pwm_us is missing, which the plan of a run always "
            "states; restore it from a copy",
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
    """Close a run of any kind and return whether anything was missing; see `Run.close`."""
    if "visits" in run.metadata or run.metadata.get("experiment"):
        return run.close()
    rest = load_resume_state(run)
    return run.close(len(rest.done) + rest.left)


def prepare_resume(unfinished: ResumeState) -> SweepStart:
    """Read where a run goes on and make its files ready, before its bench is opened.

    Samples of a visit that was cut short stay in their rows and become `interrupted`. A run
    with nothing left to measure is closed where it is not; else nothing of it changes yet.

    Raises:
        InputError: nothing is left to measure, or another process measures the run.
        FileFormatError: a file of the run cannot be read.
        ResourceExhausted: the run cannot be written.
    """
    run = unfinished.run
    if not unfinished.left:
        visits = pluralize(len(unfinished.done), "visit")
        written = "; it was not closed, and is now" if run.close(len(unfinished.done)) else ""
        raise InputError(
            f"nothing is left to resume of {run.path}: {visits}, and all measured already{written}"
        )
    found = run.ready_samples(unfinished.done)
    if not found.rows:
        return SweepStart(unfinished.done)
    link = run.metadata.get("link") or {}
    quality = LinkQuality(
        found.rows, *(link.get(name, 0) for name in ("lost", "corrupt", "repeated"))
    )
    counts = _counts(run, unfinished.done)
    return SweepStart(unfinished.done, found.last_s + MIN_GAP_S, *counts, quality)


def require_same_device(unfinished: ResumeState, identity: DeviceInfo) -> None:
    """Refuse another device than the one that began the run."""
    run = unfinished.run
    began = run.metadata.get("device_id")
    if began != identity.device_id:
        raise InputError(
            f"run {run.path} was begun on device {began!r}, but {identity.address} is "
            f"{identity.device_id!r}; connect the first one, or start a new run"
        )


def _counts(run: Run, done: frozenset[int]) -> tuple[int, int, int]:
    """Return how many visits were taken unsettled, how many are suspect, how many tares are."""
    try:
        points = read_points(run.path, VALID_KINDS)
    except FileFormatError:
        return 0, 0, 0
    tares = points.column("kind") == word_to_code("kind", "tare")
    visited = np.isin(points.column("point"), list(done)) & ~tares
    unsettled = visited & (points.column("settled") == 0.0)
    suspect = int(points.column("suspect")[visited].sum()) if "suspect" in points else 0
    return int(unsettled.sum()), suspect, int(tares.sum())


def _points_on_disk(run: Run) -> set[int]:
    """Return the visits that have their points.

    Raises:
        FileFormatError: a line that cannot be read; to take its visit for not done would throw
            away what it holds, so a person has to look.
    """
    path = run.path / "points.csv"
    if not os.path.lexists(path):
        return set()
    whole_lines = read_file(path).decode("utf-8", "replace").split("\n")[1:-1]
    if all(line.split(",")[1:2] in (["tare"], ["failed"]) for line in whole_lines):
        return set()
    return {int(point) for point in read_points(run.path).column("point")}
