"""`benchtool report`: one self-contained page, and PDF, of a run, fit, explanation or recording."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer


def command(
    paths: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="PATH...",
            help="A run, fit or explain folder, or a recording; several sweeps are compared.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="The HTML file; report.html in the folder, or beside the recording."),
    ] = None,
    pdf: Annotated[bool, typer.Option("--pdf", help="Write a PDF beside it, too.")] = False,
    model: Annotated[
        str, typer.Option(help="Model to draw beside the data: name, file or fit folder.")
    ] = "",
    controller: Annotated[
        str, typer.Option(help="Controller that flew a log: pid, observer, feedforward, ...")
    ] = "",
    gains: Annotated[str, typer.Option(help="Its gain set: s3, s1a, stiff or a file.")] = "",
    plate_z_m: Annotated[
        float | None,
        typer.Option("--plate-z-m", help="Height over the surface where the log does not tell."),
    ] = None,
    motors: Annotated[
        str,
        typer.Option(help="The log's motor number of each rotor of the rig, as 1,3,2,4."),
    ] = "",
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace files of these names.")
    ] = False,
    # The older name of --overwrite.
    force: Annotated[bool, typer.Option("--force", hidden=True)] = False,
) -> None:
    """Write a report page, and PDF, of a run, fit or recording"""
    import sys

    from benchtool.cli.announce_code import announce_code
    from benchtool.cli.show_report import working
    from benchtool.errors import InputError, WouldOverwrite
    from benchtool.recipes.replayed import Beside
    from benchtool.recipes.report_file import TAKES, print_report, usual_out, write_report

    given, replace = list(paths or []), overwrite or force
    if not given:
        raise InputError(f"nothing to report: name {TAKES}")
    beside = Beside(
        model=model,
        controller=controller,
        gains=gains,
        plate_z_m=plate_z_m,
        motors=_motors(motors),
        permit=announce_code,
    )
    target = _html(out) if out is not None else None
    paper = (target or usual_out(given)).with_suffix(".pdf")
    if pdf and paper.exists() and not replace:
        # Before the work, so that a page is not written for a refusal.
        raise WouldOverwrite(str(paper), "--overwrite")
    page = write_report(
        given,
        target,
        beside=beside,
        commands=[shlex.join(["benchtool", *sys.argv[1:]])],
        replace=replace,
    )
    print(f"report: {page}", flush=True)
    if pdf:
        with working(f"printing {page.with_suffix('.pdf').name}") as tell:
            printed = print_report(page, replace=replace, tell=tell)
        print(f"report: {printed}")


def _html(out: Path) -> Path:
    from benchtool.errors import InputError

    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(
            f"--out {out} does not end in .html; a PDF is written beside it with --pdf"
        )
    return out


def _motors(text: str) -> tuple[int, ...]:
    from benchtool.errors import InputError

    try:
        numbers = tuple(int(word) for word in text.split(",") if word.strip())
    except ValueError:
        numbers = ()
    if text and (not numbers or min(numbers) < 1 or len(set(numbers)) < len(numbers)):
        raise InputError(
            f"--motors {text!r}: write the log's motor number of each rotor of the rig, for "
            f"example 1,3,2,4"
        )
    return numbers
