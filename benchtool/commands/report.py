"""`benchtool report`: one self-contained page of a run, fit, explanation or recording."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.errors import InputError
from benchtool.core.input_text import format_value
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportInputs(Inputs):
    """What `benchtool report` takes."""

    paths: Annotated[
        tuple[Path, ...],
        Input(
            "A run, fit or explain folder, or a recording; several are compared.",
            argument="PATH",
        ),
    ] = ()
    out: Annotated[
        Path | None,
        Input("The HTML file; report.html in the folder, or beside the recording."),
    ] = None
    model: Annotated[str, Input("Model to draw beside the data: name, file or fit folder.")] = ""
    rig: Annotated[str | None, Input("Rig of a log: shipped name or path; runs carry theirs.")] = (
        None
    )
    controller: Annotated[
        str,
        Input(
            "Controller that flew a log: pid, observer, feedforward, ...", group="Logs of flights"
        ),
    ] = ""
    gains: Annotated[str, Input("Its gain set: s3, s1a, stiff or a file.")] = ""
    plate_z_m: Annotated[
        Annotated[float, Gt(0.0), Le(1000.0)] | None,
        Input("Height over the surface where the log does not state it.", "m"),
    ] = None
    motors: Annotated[
        tuple[Annotated[int, Ge(1)], ...],
        Input("The log's motor number of each rotor of the rig, as 1,3,2,4."),
    ] = ()
    over: Annotated[
        Literal["thrust", "rpm", "power", "throttle", "distance"] | None,
        Input(
            "Draw runs and recordings in one plot over this.",
            default_text="thrust",
            group="Comparison",
        ),
    ] = None
    at_thrust: Annotated[
        Annotated[float, Gt(0.0), Le(100_000.0)] | None,
        Input("Rank runs and recordings by efficiency at this thrust.", "N"),
    ] = None
    overwrite: Annotated[
        bool, Input("Replace files of these names.", alias="--force", group="Results")
    ] = False


@command_from_inputs(ReportInputs)
def report(inputs: ReportInputs) -> None:
    """Write an HTML report of a run, fit or recording."""
    import sys

    from benchtool.explain.pitch.replay import ReplayInputs
    from benchtool.report.compare.page import compare_runs, comparison_sentence, short_table
    from benchtool.report.report_file import is_mixed, write_report

    given, out = list(inputs.paths), inputs.out
    if len(set(inputs.motors)) < len(inputs.motors):
        raise InputError(
            f"--motors is {format_value(inputs.motors)}; name each motor once, as 1,3,2,4"
        )
    if inputs.rig is not None and not inputs.model:
        raise InputError(f"--rig {inputs.rig} is that of a model; name one with --model")
    beside = ReplayInputs(
        model=inputs.model,
        rig=inputs.rig,
        controller=inputs.controller,
        gains=inputs.gains,
        plate_z_m=inputs.plate_z_m,
        motors=inputs.motors,
        permit=announce_code,
    )
    if out is not None and out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {out} does not end in .html, as the name of a page does")
    one = None
    if inputs.over or inputs.at_thrust is not None or is_mixed(given):
        if inputs.model:
            raise InputError("--model draws a model beside sweeps; leave it out here")
        one = compare_runs(given, inputs.over or "thrust", inputs.at_thrust)
    page = write_report(
        given,
        out,
        comparison=one,
        beside=beside,
        commands=[shlex.join(["benchtool", *sys.argv[1:]])],
        replace=inputs.overwrite,
    )
    if one is not None:
        print(comparison_sentence(one))
        if (table := short_table(one)) is not None:
            from benchtool.commands.terminal.tables import Output, print_table

            print_table(Output(), table)
    print(f"report: {page}", flush=True)
