"""Commands `benchtool motor` and `benchtool export`: motor constants, and files of a model."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Gt, Le

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code, typed_command
from benchtool.core.choices import ExportTarget
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.inputs import Input, Inputs, input_values, to_arguments, with_changes
from benchtool.core.user_file import read_library_file


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorTestInputs(Inputs):
    """Options of a motor fit: rig of the logs, vehicle mass and extrapolation of thrust."""

    TITLE = "Motor fit"

    propeller: Annotated[
        str | None, Input("Propeller, if missing in a log: name, file or inches: 5x4.5.")
    ] = None
    rig: Annotated[str | None, Input("Rig name or file.", default_text="from the logs")] = None
    mass_kg: Annotated[
        Annotated[float, Gt(0.0), Le(1000.0)] | None,
        Input("Vehicle mass for the hover point.", "kg", default_text="rig value"),
    ] = None
    rotors: Annotated[
        Annotated[int, Ge(1), Le(64)] | None,
        Input("Rotors that carry the mass.", default_text="rig value"),
    ] = None
    extrapolate: Annotated[
        bool, Input("Extrapolate thrust beyond 10 % of command and 15 % of voltage.")
    ] = False


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
    if not inputs.runs:
        raise InputError("no input; give run folders without a plate, or test stand logs")
    for path in inputs.runs:
        if not path.exists():
            raise FileFormatError(str(path), "there is no such file or run folder; check the path")
    from benchtool.api import motor as fit_motor_runs

    if inputs.out is not None and inputs.out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {inputs.out} does not end in .html; change the suffix")
    result = fit_motor_runs(inputs.runs, **input_values(inputs.stand))
    print(result.summary())
    first, *others = map(str, inputs.runs)
    arguments = [argument for run in others for argument in ("--motor", run)]
    arguments += to_arguments(MotorTestInputs, with_changes(inputs.stand))
    if "propulsion.radius_m" in result.found.rig.not_stated:
        arguments += ["--propeller", "SIZE"]
    command = shlex.join(["benchtool", "export", first, *arguments, "--to", "all"])
    print(f"\nexport for autopilots, simulators and firmware: {command}")
    if inputs.out is not None:
        print(f"report: {result.report(inputs.out, commands=[typed_command()])}")


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
    if not Path(inputs.model).exists():
        read_library_file("model", "models", inputs.model)  # before the imports of an export
    from benchtool.api.models import read_stand
    from benchtool.export.targets import TARGETS, write_targets
    from benchtool.export.vehicle import ExportedNumber, build_vehicle

    stand = inputs.stand
    bench = (*read_stand(stand.rig, stand.propeller), stand.extrapolate)
    vehicle = build_vehicle(inputs.model, inputs.motor, announce_code, *bench)
    vehicle = replace(vehicle, mass_kg=stand.mass_kg, rotors=stand.rotors)
    for path in write_targets(vehicle, inputs.to, inputs.out):
        print(f"written: {path}")
        for line in re.findall(r"\w+ is omitted: .*", path.read_text("utf-8")):
            print(f"  {line}")
    thrust = vehicle.thrust_max
    print(f"full thrust of a rotor: {thrust.value:.4g} N ({thrust.why})")
    for target, name in (("ardupilot", "MOT_THST_EXPO"), ("px4", "THR_MDL_FAC")):
        expo = TARGETS[target].values(vehicle)["expo"] if inputs.to in (target, "all") else 0
        if isinstance(expo, ExportedNumber) and expo.stated:
            print(f"{name}: {expo.value:g} ({expo.why.partition('; linearised')[0]})")
