"""What a run says of itself: rig, device, calibration, air, versions, operator."""

from __future__ import annotations

import getpass
import platform
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from benchtool import __version__
from benchtool.acquire.air import Air
from benchtool.acquire.calibration import Calibration, calibration_to_dict
from benchtool.acquire.plan import Plan
from benchtool.bench.bench import Identity
from benchtool.core.rig import Rig
from benchtool.core.rig_file import rig_to_dict

_PACKAGES = ("numpy", "pandas", "pyarrow", "pyserial")


def run_metadata(
    plan: Plan,
    rig: Rig,
    identity: Identity,
    *,
    operator: str = "",
    air: Air | None = None,
    calibration: Calibration | None = None,
    started: datetime | None = None,
) -> dict[str, Any]:
    """Return the facts for metadata.json of a new run."""
    air = air or Air()
    return {
        "state": "running",
        "simulated": identity.simulated,
        "started": (started or datetime.now().astimezone()).isoformat(timespec="seconds"),
        "operator": operator or _user(),
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
            "orders_protected": identity.orders_protected,
            "facts": dict(identity.facts),
        },
        "rig": rig_to_dict(rig),
        "calibration": calibration_to_dict(calibration) if calibration else None,
        "air": {
            "temperature_degC": air.temperature_degC,
            "pressure_Pa": air.pressure_Pa,
            "humidity": air.humidity,
            "density_kg_m3": air.density_kg_m3,
            "measured": air.measured,
            "formula": "CIPM-2007",
        },
        "versions": {
            "benchtool": __version__,
            "python": platform.python_version(),
            "system": platform.platform(),
            **{package: _version(package) for package in _PACKAGES},
        },
    }


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return "unknown"


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
