"""Command `benchtool report`: self-contained HTML report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Gt, Le

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code, typed_command
from benchtool.core.choices import Over
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs
from benchtool.core.text import format_value


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportInputs(Inputs):
    """Options of `benchtool report`."""

    paths: Annotated[
        tuple[Path, ...],
        Input("Run, fit or explain folder, or recording; several are compared.", argument="PATH"),
    ] = ()
    out: Annotated[Path | None, Input("HTML file.", default_text="report.html in the folder")] = (
        None
    )
    model: Annotated[str, Input("Model to overlay: name, file or fit folder.")] = ""
    rig: Annotated[str | None, Input("Rig of a log: name or file.")] = None
    controller: Annotated[
        str, Input("Controller of a log: pid, observer, feedforward, ...", group="Flight logs")
    ] = ""
    gains: Annotated[str, Input("Gain set of the controller: s3, s1a, stiff or a file.")] = ""
    plate_z_m: Annotated[
        Annotated[float, Gt(0.0), Le(1000.0)] | None,
        Input("Height over the surface, if missing in the log.", "m"),
    ] = None
    motors: Annotated[
        tuple[Annotated[int, Ge(1)], ...],
        Input("Motor number of each rotor in the log, e.g. 1,3,2,4."),
    ] = ()
    over: Annotated[
        Over | None,
        Input("Abscissa of a comparison plot.", default_text="thrust", group="Comparison"),
    ] = None
    at_thrust: Annotated[
        Annotated[float, Gt(0.0), Le(100_000.0)] | None,
        Input("Rank runs by efficiency at this thrust.", "N"),
    ] = None
    overwrite: Annotated[
        bool, Input("Replace existing files.", alias="--force", group="Results")
    ] = False


@command_from_inputs(ReportInputs)
def report(inputs: ReportInputs) -> None:
    """Write an HTML report of a run, fit or recording."""
    from benchtool.report.report_file import check_paths, is_mixed, write_report

    check_paths(inputs.paths)
    from benchtool.explain.pitch.replay import ReplayInputs
    from benchtool.report.compare.page import compare_runs, comparison_sentence, short_table

    paths, out = list(inputs.paths), inputs.out
    if len(set(inputs.motors)) < len(inputs.motors):
        raise InputError(
            f"--motors is {format_value(inputs.motors)}; name each motor once, as 1,3,2,4"
        )
    if inputs.rig is not None and not inputs.model:
        raise InputError(f"--rig {inputs.rig} needs a model; add --model")
    overlay = ReplayInputs(
        model=inputs.model,
        rig=inputs.rig,
        controller=inputs.controller,
        gains=inputs.gains,
        plate_z_m=inputs.plate_z_m,
        motors=inputs.motors,
        permit=announce_code,
    )
    if out is not None and out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {out} does not end in .html; change the suffix")
    comparison = None
    if inputs.over or inputs.at_thrust is not None or is_mixed(paths):
        if inputs.model:
            raise InputError("--model is not available for comparisons; remove it")
        comparison = compare_runs(paths, inputs.over or "thrust", inputs.at_thrust)
    page = write_report(
        paths,
        out,
        comparison=comparison,
        replay_inputs=overlay,
        commands=[typed_command()],
        replace=inputs.overwrite,
    )
    if comparison is not None:
        print(comparison_sentence(comparison))
        if (table := short_table(comparison)) is not None:
            from benchtool.commands.terminal.tables import Output, print_table

            print_table(Output(), table)
    print(f"report: {page}", flush=True)
