"""Make the folder of a new run, with everything that is known before it begins."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from benchtool.acquire.air import Air
from benchtool.acquire.calibration import Calibration
from benchtool.acquire.metadata import run_metadata
from benchtool.acquire.order import visits_of
from benchtool.acquire.pitch_experiment import PitchExperiment
from benchtool.acquire.plan import Plan, plan_to_toml
from benchtool.bench.bench import Identity
from benchtool.core.rig import Rig
from benchtool.data.run.run import Run, free_run_path


def new_run(
    folder: tuple[Path, Path | None],
    plan: Plan,
    rig: Rig,
    identity: Identity,
    *,
    operator: str = "",
    air: Air | None = None,
    calibration: Calibration | None = None,
) -> Run:
    """Create the run folder of a sweep that begins now.

    Args:
        folder: where run folders are made, and exactly which one; None names it by date and plan.
        plan: resolved.
        rig: what stands on the bench.
        identity: who answers.
        operator: who measures; the user when empty.
        air: around the bench; the standard one when left out.
        calibration: of the load cell, where one is applied.

    Raises:
        WouldOverwrite: the folder exists.
    """
    now = datetime.now().astimezone()
    path = folder[1] or free_run_path(folder[0], f"{now:%Y-%m-%d}", plan.name)
    facts = run_metadata(
        plan, rig, identity, operator=operator, air=air, calibration=calibration, started=now
    )
    facts["visits"] = len(visits_of(plan, rig))
    return Run.create(path, plan_to_toml(plan), facts)


def new_pitch_run(
    folder: tuple[Path, str, Path | None],
    experiment: PitchExperiment,
    rig: Rig,
    identity: Identity,
    *,
    operator: str = "",
) -> Run:
    """Create the run folder of a pitch experiment that begins now.

    Args:
        folder: where run folders are made, the run's name, and exactly which one; None names it by
            date and name.
        experiment: to be recorded.
        rig: on the hinge.
        identity: who answers.
        operator: who measures; the user when empty.

    Raises:
        WouldOverwrite: the folder exists.
    """
    runs, name, out = folder
    now = datetime.now().astimezone()
    facts = run_metadata(Plan(), rig, identity, operator=operator, started=now)
    # The order of a sweep has a seed; here only a virtual device has one, among its facts.
    del facts["seed"]
    facts |= {
        "experiment": "pitch",
        "schedule": experiment.schedule or identity.facts.get("schedule", ""),
        "collective_us": experiment.collective_us,
        "seconds": experiment.seconds,
    }
    path = out or free_run_path(runs, f"{now:%Y-%m-%d}", name)
    return Run.create(path, experiment.to_toml(), facts)
