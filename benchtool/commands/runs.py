"""`benchtool runs close` and `recalibrate`: what is done to runs that are on disk."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from benchtool.commands.declared import declared
from benchtool.core.errors import CalibrationError
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class CloseInputs(Inputs):
    """What `benchtool runs close` takes."""

    runs: Annotated[tuple[Path, ...], Input("Run folders.", argument="RUN")]


@declared(CloseInputs)
def close(inputs: CloseInputs) -> None:
    """Mend what a killed program left of runs and write their tables; safe to repeat."""
    from benchtool.acquire.resume import close_run
    from benchtool.data.run.run import Run

    for path in inputs.runs:
        run = Run.open(path)
        written = close_run(run)
        facts = run.metadata
        reason = f" ({facts['reason']})" if facts.get("reason") else ""
        done = "closed" if written else "it was closed already"
        print(f"{path}: {done}; {facts.get('state', '')}{reason}")


@dataclass(frozen=True, slots=True, kw_only=True)
class RecalibrateInputs(Inputs):
    """What `benchtool recalibrate` takes."""

    run: Annotated[Path, Input("The run folder.", argument="RUN")]
    calibration: Annotated[Path | None, Input("Calibration file.", empty="the device's latest")] = (
        None
    )
    other_device: Annotated[bool, Input("Take one of another device; noted in the run.")] = False


@declared(RecalibrateInputs)
def recalibrate_run(inputs: RecalibrateInputs) -> None:
    """Apply a calibration to a run, its raw data untouched."""
    from benchtool.acquire.recalibrate import recalibrate
    from benchtool.data.calibration import calibration_from, read_calibration
    from benchtool.data.run.run import Run
    from benchtool.data.run.state import recall

    opened = Run.open(inputs.run)
    if inputs.calibration is not None:
        chosen = read_calibration(inputs.calibration)
    else:
        device_id = str(opened.metadata.get("device_id", ""))
        latest = recall("calibration", device_id)
        if latest is None:
            raise CalibrationError(
                f"no calibration of device {device_id!r} is known here; give --calibration FILE"
            )
        chosen = calibration_from(latest, f"the latest calibration of {device_id}")
    folder = recalibrate(opened, chosen, other_device=inputs.other_device)
    print(f"points through calibration {chosen.id}: {folder}")
