"""Go on with a run from what is on disk."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from benchtool.acquire.calibration import Calibration, calibration_from
from benchtool.acquire.order import visits_of
from benchtool.acquire.plan import Plan, plan_from_toml
from benchtool.acquire.record import LinkQuality
from benchtool.acquire.sweep import Start
from benchtool.bench.bench import Identity
from benchtool.core.counted import counted
from benchtool.core.rig import Rig
from benchtool.core.toml_text import build
from benchtool.core.user_file import read_file
from benchtool.errors import FileFormatError, InputError
from benchtool.store import KINDS, Run, code_of, read_points, read_samples
from benchtool.store.samples import mark_interrupted

GAP_S = 1.0
"""Time of the run that stands for the break, however long it was; the event tells the real one."""


@dataclass(frozen=True, slots=True)
class Unfinished:
    """Hold what a run on disk says of how to go on.

    Attributes:
        stage: the `--stage` that moved the plate; None where the run does not say.
    """

    run: Run
    plan: Plan
    rig: Rig
    calibration: Calibration | None
    done: frozenset[int]
    left: int
    stage: str | None = None


def unfinished(run: Run) -> Unfinished:
    """Read what a run has and what it lacks; nothing is changed.

    Raises:
        InputError: nothing is left to measure.
        FileFormatError: a file of the run cannot be read.
    """
    facts = run.metadata
    where = str(run.path / "metadata.json")
    if "rig" not in facts:
        raise FileFormatError(where, "it names no rig; restore it from a copy")
    rig = build(Rig, facts["rig"], f"{where}: rig")
    plan = plan_from_toml(run.plan_text, str(run.path / "plan.toml"))
    calibration = facts.get("calibration")
    visits = {visit.point for visit in visits_of(plan, rig)}
    done = frozenset(_points_on_disk(run)) & visits
    if done == visits:
        raise InputError(
            f"nothing is left to resume of {run.path}: {counted(len(visits), 'visit')}, and all "
            f"measured already"
        )
    return Unfinished(
        run,
        plan,
        rig,
        calibration_from(calibration, f"{where}: calibration") if calibration else None,
        done,
        len(visits - done),
        (facts.get("plate") or {}).get("stage"),
    )


def reopen(unfinished: Unfinished, identity: Identity) -> Start:
    """Make a run ready to be gone on with on the bench that answers, and say where it starts.

    Samples of a visit that was cut short keep their rows and become `interrupted`.

    Raises:
        InputError: another device than the one that began the run.
    """
    run = unfinished.run
    began = run.metadata.get("device_id")
    if began != identity.device_id:
        raise InputError(
            f"run {run.path} was begun on device {began!r}, but {identity.address} is "
            f"{identity.device_id!r}; connect the first one, or start a new run"
        )
    run.reopen()
    samples = run.path / "samples.csv"
    if not samples.is_file() or not samples.stat().st_size:
        run.update_metadata(state="running", reason=None)
        return Start(unfinished.done)
    recording = read_samples(run.path)
    numbers = {int(point) for point in recording.column("point")} - {0}
    mark_interrupted(samples, frozenset(numbers - unfinished.done))
    last_s = float(recording.column("time_s").max()) if len(recording) else 0.0
    run.update_metadata(state="running", reason=None)
    counted = run.metadata.get("link") or {}
    link = LinkQuality(len(recording), counted.get("lost", 0), counted.get("corrupt", 0))
    unsettled, tares = _counts(run, unfinished.done)
    return Start(unfinished.done, last_s + GAP_S, unsettled, tares, link)


def _counts(run: Run, done: frozenset[int]) -> tuple[int, int]:
    """Return how many visits were taken unsettled, and how many tares there are."""
    try:
        points = read_points(run.path, KINDS)
    except FileFormatError:
        return 0, 0
    tares = points.column("kind") == code_of("kind", "tare")
    visited = np.isin(points.column("point"), list(done)) & ~tares
    return int((visited & (points.column("settled") == 0.0)).sum()), int(tares.sum())


def _points_on_disk(run: Run) -> set[int]:
    """Return the visits that have their points.

    Raises:
        FileFormatError: a line that cannot be read; to take its visit for not done would throw
            away what it says, so a person has to look.
    """
    path = run.path / "points.csv"
    if not os.path.lexists(path):
        return set()
    whole_lines = read_file(path).decode("utf-8", "replace").split("\n")[1:-1]
    if all(line.split(",")[1:2] == ["tare"] for line in whole_lines):
        return set()
    return {int(point) for point in read_points(run.path).column("point")}
