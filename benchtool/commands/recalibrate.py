"""`benchtool recalibrate`: another calibration for a run that is on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    run: Annotated[Path, typer.Argument(help="The run folder.")],
    calibration: Annotated[
        Path | None, typer.Option(help="Calibration file; the device's latest when left out.")
    ] = None,
    other_device: Annotated[
        bool, typer.Option("--other-device", help="Take one of another device; noted in the run.")
    ] = False,
) -> None:
    """Apply a calibration to a run, its raw data untouched."""
    from benchtool.acquire.calibration import calibration_from
    from benchtool.acquire.calibration_file import read_calibration
    from benchtool.acquire.recalibrate import recalibrate
    from benchtool.core.errors import CalibrationError
    from benchtool.data.run.run import Run
    from benchtool.data.run.state import recall

    opened = Run.open(run)
    if calibration is not None:
        chosen = read_calibration(calibration)
    else:
        device_id = str(opened.metadata.get("device_id", ""))
        latest = recall("calibration", device_id)
        if latest is None:
            raise CalibrationError(
                f"no calibration of device {device_id!r} is known here; give --calibration FILE"
            )
        chosen = calibration_from(latest, f"the latest calibration of {device_id}")
    folder = recalibrate(opened, chosen, other_device=other_device)
    print(f"points through calibration {chosen.id}: {folder}")
