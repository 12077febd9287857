"""Command `benchtool export`: model files for simulators, autopilots and firmware."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.recipe_options import MotorTestInputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.choices import ExportTarget
from benchtool.core.inputs import Input, Inputs, input_values


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportInputs(Inputs):
    """Options of `benchtool export`."""

    model: Annotated[
        str,
        Input(
            "Fit folder, run without a plate, test stand log, model file or model name.",
            argument="MODEL",
        ),
    ]
    to: Annotated[ExportTarget, Input("Target; all writes a folder with a file for each.")]
    motor: Annotated[
        tuple[Path, ...],
        Input("Run without a plate or test stand log for motor constants; repeatable."),
    ] = ()
    stand: MotorTestInputs = field(default_factory=MotorTestInputs)
    out: Annotated[
        Path | None, Input("New file, or new folder for all.", default_text="named after the rig")
    ] = None


@command_from_inputs(ExportInputs)
def export(inputs: ExportInputs) -> None:
    """Export a model for simulators, autopilots and firmware."""
    from benchtool.api import export as export_model

    for path in export_model(
        inputs.model,
        inputs.to,
        inputs.out,
        motor=inputs.motor,
        permit=announce_code,
        **input_values(inputs.stand),
    ):
        print(f"written: {path}")
