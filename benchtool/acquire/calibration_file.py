"""Find, read and keep calibrations."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from benchtool.acquire.calibration import Calibration
    from benchtool.bench.bench import Identity


def read_calibration(path: Path) -> Calibration:
    """Return the calibration in a JSON file."""
    from benchtool.acquire.calibration import calibration_from
    from benchtool.data.atomic import read_json

    return calibration_from(read_json(path), str(path))


def calibration_for(option: str | None, identity: Identity) -> Calibration | None:
    """Return the calibration for a device: the file given, its latest one, or none.

    Raises:
        CalibrationError: the file belongs to another device.
    """
    from benchtool.acquire.calibration import calibration_from, require_device
    from benchtool.data.run.state import recall, state_file

    if option == "none":
        return None
    if option:
        calibration = read_calibration(Path(option))
        require_device(
            calibration, option, identity.address, identity.device_id, "--calibration none"
        )
        return calibration
    latest = recall("calibration", identity.device_id)
    if latest is None:
        return None
    return calibration_from(latest, str(state_file("calibration", identity.device_id)))
