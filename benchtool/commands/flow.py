"""`benchtool flow`: the flow below a quadrotor as a picture and as a table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, add_completion=False)

Spacing = Annotated[float, typer.Option("--spacing-R", help="Rotor spacing in radii.", min=2.0)]
Height = Annotated[float, typer.Option("--z-over-r", help="Height in rotor radii.", min=0.5)]


@app.callback()
def _group() -> None:
    """Picture the flow below a quadrotor."""


@app.command("table")
def table(spacing_r: Spacing = 2.65, z_over_r: Height = 2.0) -> None:
    """Print the upward velocity between the rotors, in induced velocities."""
    from benchtool.physics.wake_picture import Hover
    from benchtool.report.paper.curves import centre_line_lines

    for line in centre_line_lines(Hover.quad(spacing_r, z_over_r)):
        print(line)
    print("sources: the model behind eq. (2) to (4); rings: a prescribed wake, not CFD")


@app.command("picture")
def picture(
    spacing_r: Spacing = 2.65,
    z_over_r: Height = 2.0,
    out: Annotated[Path, typer.Option(help="Folder for the figure.")] = Path("figures"),
) -> None:
    """Draw sources with images beside vortex rings with images (Fig. 5)."""
    from benchtool.physics.wake_picture import Hover
    from benchtool.report.figure import drawn
    from benchtool.report.files import save_figure

    block = drawn("paper.flow", Hover.quad(spacing_r, z_over_r))["fig05-flow"]
    for path in save_figure(block.figure, out / "fig05-flow"):
        print(f"written: {path}")
