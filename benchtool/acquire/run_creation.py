"""Creation of run folders with their metadata."""

from __future__ import annotations

import getpass
import platform
from collections.abc import Mapping
from dataclasses import asdict
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from benchtool import __version__
from benchtool.acquire.inputs import RecordInputs, SweepInputs
from benchtool.bench.bench import DeviceInfo
from benchtool.core.air import Air
from benchtool.core.rig import Rig
from benchtool.data.run.run import Run, free_run_path


def new_run(
    inputs: SweepInputs | RecordInputs,
    name: str,
    plan_text: str,
    rig: Rig,
    identity: DeviceInfo,
    facts: Mapping[str, Any],
) -> Run:
    """Create a run folder with its plan and metadata; `facts` are those of the experiment.

    Without a path in the inputs, the folder is named by date and name.

    Raises:
        WouldOverwrite: the folder exists.
    """
    now = datetime.now().astimezone()
    path = inputs.out or free_run_path(inputs.runs, f"{now:%Y-%m-%d}", name)
    metadata = {
        "state": "running",
        "simulated": identity.simulated,
        "started": now.isoformat(timespec="seconds"),
        "operator": inputs.operator or user_name(),
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
        "calibration": None,
        "air": Air().facts(),
        "versions": {
            "benchtool": __version__,
            "python": platform.python_version(),
            "system": platform.platform(),
            **{
                package: _version(package) for package in ("numpy", "pandas", "pyarrow", "pyserial")
            },
        },
    }
    return Run.create(path, plan_text, metadata | facts)


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
