"""`benchtool report`: one self-contained page of a run, fit, explanation or recording."""

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
        typer.Option(
            help="The HTML file; report.html in the folder, or beside the recording. With --layout "
            "paper, the folder of the figures."
        ),
    ] = None,
    layout: Annotated[
        str, typer.Option(help="page, or paper: the paper's figures 3, 4, 6, 8 from recipes.")
    ] = "page",
    single: Annotated[Path | None, typer.Option(help="Paper: recipe folder of one rotor.")] = None,
    second: Annotated[
        Path | None, typer.Option(help="Paper: recipe folder of one rotor of another rig.")
    ] = None,
    three: Annotated[Path | None, typer.Option(help="Paper: recipe folder of 3 rotors.")] = None,
    quad: Annotated[
        Path | None, typer.Option(help="Paper: recipe folder of the quadrotor.")
    ] = None,
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
    """Write a report page of a run, fit or recording"""
    import sys

    from benchtool.commands.terminal.announce_code import announce_code
    from benchtool.core.errors import InputError, UnknownChoice
    from benchtool.explain.pitch.replayed import Beside
    from benchtool.report.report_file import TAKES, write_report

    given, replace = list(paths or []), overwrite or force
    recipes = {"single": single, "second": second, "three": three, "quad": quad}
    named = [f"--{name}" for name, folder in recipes.items() if folder is not None]
    if layout not in ("page", "paper"):
        raise UnknownChoice("layout", layout, ("page", "paper"))
    if layout == "paper":
        if given:
            raise InputError(
                f"--layout paper takes recipe folders by --single, --second, --three and --quad, "
                f"not {given[0]}"
            )
        _draw_paper(recipes, out or Path("figures"), replace)
        return
    if named:
        raise InputError(f"{named[0]} needs --layout paper")
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
    if out is not None and out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {out} does not end in .html, as the name of a page does")
    page = write_report(
        given,
        out,
        beside=beside,
        commands=[shlex.join(["benchtool", *sys.argv[1:]])],
        replace=replace,
    )
    print(f"report: {page}", flush=True)


def _draw_paper(recipes: dict[str, Path | None], out: Path, replace: bool) -> None:
    from benchtool.report.files import refuse_existing, save_figure
    from benchtool.report.paper.layouts import paper_layouts

    drawn = paper_layouts(recipes)
    if not replace:
        refuse_existing([out / f"{name}.svg" for name in drawn])
    for name, block in drawn.items():
        paths = save_figure(block.figure, out / name, replace=replace)
        print(f"written: {paths[0]} and {paths[1].suffix.removeprefix('.')}")


def _motors(text: str) -> tuple[int, ...]:
    from benchtool.core.errors import InputError

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
