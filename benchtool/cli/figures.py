"""`benchtool figures`: one's own runs laid out as in the paper's figures 3, 4, 6 and 8."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    single: Annotated[Path | None, typer.Option(help="Recipe folder of one rotor.")] = None,
    second: Annotated[
        Path | None, typer.Option(help="Recipe folder of one rotor of another rig.")
    ] = None,
    three: Annotated[Path | None, typer.Option(help="Recipe folder of three rotors.")] = None,
    quad: Annotated[Path | None, typer.Option(help="Recipe folder of the quadrotor.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for the figures.")] = Path("figures"),
) -> None:
    """Draw runs in the layout of the paper's figures 3, 4, 6, 8."""
    from benchtool.recipes.paper_layouts import Series, paper_layouts
    from benchtool.report.files import refuse_existing, save_figure

    drawn = paper_layouts(Series(single=single, second=second, three=three, quad=quad))
    refuse_existing([out / f"{name}.svg" for name in drawn])
    for name, figure in drawn.items():
        paths = save_figure(figure, out / name)
        print(f"written: {paths[0]} and {paths[1].suffix.removeprefix('.')}")
