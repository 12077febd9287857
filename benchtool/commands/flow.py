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
    from benchtool.report.flow_study import table_lines

    for line in table_lines(spacing_r, z_over_r):
        print(line)
    print("sources: the model behind eq. (2) to (4); rings: a prescribed wake, not CFD")


@app.command("picture")
def picture(
    spacing_r: Spacing = 2.65,
    z_over_r: Height = 2.0,
    out: Annotated[Path, typer.Option(help="Folder for the figure.")] = Path("figures"),
) -> None:
    """Draw sources with images beside vortex rings with images (Fig. 5)."""
    from benchtool.report.files import save_figure
    from benchtool.report.flow_study import flow_pictures

    for path in save_figure(flow_pictures(spacing_r, z_over_r), out / "fig05-flow"):
        print(f"written: {path}")
