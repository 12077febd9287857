"""Creation of run folders with their metadata."""

from __future__ import annotations

import getpass
import platform
from dataclasses import asdict
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from benchtool import __version__
from benchtool.acquire.pitch_experiment import PitchExperiment
from benchtool.acquire.plan import Plan, plan_to_toml
from benchtool.acquire.visit_order import plan_visits
from benchtool.bench.bench import DeviceInfo
from benchtool.core.air import Air
from benchtool.core.rig import Rig
from benchtool.data.calibration import Calibration
from benchtool.data.run.run import Run, free_run_path


def new_run(
    folder: tuple[Path, Path | None],
    plan: Plan,
    rig: Rig,
    identity: DeviceInfo,
    *,
    operator: str = "",
    air: Air | None = None,
    calibration: Calibration | None = None,
) -> Run:
    """Create the run folder of a sweep with a resolved plan.

    Args:
        folder: parent folder and path; None: name from date and plan.

    Raises:
        WouldOverwrite: the folder exists.
    """
    now = datetime.now().astimezone()
    path = folder[1] or free_run_path(folder[0], f"{now:%Y-%m-%d}", plan.name)
    facts = run_metadata(
        plan, rig, identity, operator=operator, air=air, calibration=calibration, started=now
    )
    facts["visits"] = len(plan_visits(plan, rig))
    return Run.create(path, plan_to_toml(plan), facts)


def new_live_run(
    runs: Path,
    plan: Plan,
    rig: Rig,
    identity: DeviceInfo,
    *,
    operator: str = "",
    calibration: Calibration | None = None,
) -> Run:
    """Create the run folder of a live recording, named by date and plan."""
    now = datetime.now().astimezone()
    facts = run_metadata(
        plan, rig, identity, operator=operator, calibration=calibration, started=now
    )
    del facts["seed"]
    path = free_run_path(runs, f"{now:%Y-%m-%d}", plan.name)
    return Run.create(path, plan_to_toml(plan), facts | {"experiment": "live"})


def new_pitch_run(
    folder: tuple[Path, str, Path | None],
    experiment: PitchExperiment,
    rig: Rig,
    identity: DeviceInfo,
    *,
    operator: str = "",
) -> Run:
    """Create the run folder of a pitch experiment.

    Args:
        folder: parent folder, run name and path; None: name from date and run name.

    Raises:
        WouldOverwrite: the folder exists.
    """
    runs, name, out = folder
    now = datetime.now().astimezone()
    facts = run_metadata(Plan(), rig, identity, operator=operator, started=now)
    # Only the order of a sweep has a seed.
    del facts["seed"]
    facts |= {
        "experiment": "pitch",
        "schedule": experiment.schedule or identity.facts.get("schedule", ""),
        "collective_us": experiment.collective_us,
        "seconds": experiment.seconds,
    }
    path = out or free_run_path(runs, f"{now:%Y-%m-%d}", name)
    return Run.create(path, experiment.to_toml(), facts)


def run_metadata(
    plan: Plan,
    rig: Rig,
    identity: DeviceInfo,
    *,
    operator: str = "",
    air: Air | None = None,
    calibration: Calibration | None = None,
    started: datetime | None = None,
) -> dict[str, Any]:
    """Return metadata.json of a new run."""
    return {
        "state": "running",
        "simulated": identity.simulated,
        "started": (started or datetime.now().astimezone()).isoformat(timespec="seconds"),
        "operator": operator or user_name(),
        "seed": plan.order.seed,
        "address": identity.address,
        "device_id": identity.device_id,
        "device": {
            "firmware": identity.firmware,
            "protocol": identity.protocol,
            "rate_Hz": identity.rate_Hz,
            "watchdog_s": identity.watchdog_s,
            "limits": dict(identity.limits),
            "channels": {channel.name: channel.unit for channel in identity.channels},
            "channel_hash": identity.channel_hash,
            "orders_protected": identity.rejects_late_commands,
            "facts": dict(identity.facts),
        },
        "rig": asdict(rig),
        "calibration": asdict(calibration) if calibration else None,
        "air": (air or Air()).facts(),
        "versions": {
            "benchtool": __version__,
            "python": platform.python_version(),
            "system": platform.platform(),
            **{
                package: _version(package) for package in ("numpy", "pandas", "pyarrow", "pyserial")
            },
        },
    }


def user_name() -> str:
    """Return the name of the logged-in user."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return "unknown"


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
