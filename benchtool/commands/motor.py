"""Command `benchtool motor`: thrust curve and motor constants from runs without a plate."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.recipe_options import MotorTestInputs
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs, input_values, to_arguments, with_changes


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorInputs(Inputs):
    """Options of `benchtool motor`."""

    runs: Annotated[
        tuple[Path, ...],
        Input("Runs without a plate, or test stand logs, of one rig.", argument="RUN"),
    ] = ()
    stand: MotorTestInputs = field(default_factory=MotorTestInputs)
    out: Annotated[Path | None, Input("New HTML file for the report.")] = None


@command_from_inputs(MotorInputs)
def motor(inputs: MotorInputs) -> None:
    """Fit thrust curve and motor constants to runs without a plate."""
    import sys

    from benchtool.api import motor as fit_motor_runs

    if inputs.out is not None and inputs.out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {inputs.out} does not end in .html; change the suffix")
    result = fit_motor_runs(inputs.runs, **input_values(inputs.stand))
    print(result.summary())
    first, *others = map(str, inputs.runs)
    arguments = [argument for run in others for argument in ("--motor", run)]
    arguments += to_arguments(MotorTestInputs, with_changes(inputs.stand))
    command = shlex.join(["benchtool", "export", first, *arguments, "--to", "all"])
    print(f"\nexport for autopilots, simulators and firmware: {command}")
    if inputs.out is not None:
        command = shlex.join(["benchtool", *sys.argv[1:]])
        print(f"report: {result.report(inputs.out, commands=[command])}")
