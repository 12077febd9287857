"""`benchtool flow`: the flow below a quadrotor as a picture and as a table."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le

from benchtool.commands.declared import declared
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class FlowInputs(Inputs):
    """What both commands of `benchtool flow` take."""

    spacing_R: Annotated[
        float, Ge(2.0), Le(1000.0), Input("Rotor spacing in radii.", option="spacing-R")
    ] = 2.65
    z_over_R: Annotated[
        float, Ge(0.5), Le(1000.0), Input("Height in rotor radii.", option="z-over-r")
    ] = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureInputs(Inputs):
    """What `benchtool flow picture` takes."""

    flow: FlowInputs = FlowInputs()
    out: Annotated[Path, Input("Folder for the figure.")] = Path("figures")


@declared(FlowInputs)
def table(inputs: FlowInputs) -> None:
    """Print the upward velocity between the rotors, in induced velocities."""
    from benchtool.physics.wake_picture import Hover
    from benchtool.report.paper.curves import centre_line_lines

    for line in centre_line_lines(Hover.quad(inputs.spacing_R, inputs.z_over_R)):
        print(line)
    print("sources: the model behind eq. (2) to (4); rings: a prescribed wake, not CFD")


@declared(PictureInputs)
def picture(inputs: PictureInputs) -> None:
    """Draw sources with images beside vortex rings with images (Fig. 5)."""
    from benchtool.physics.wake_picture import Hover
    from benchtool.report.figure import drawn
    from benchtool.report.files import save_figure

    hover = Hover.quad(inputs.flow.spacing_R, inputs.flow.z_over_R)
    block = drawn("paper.flow", hover)["fig05-flow"]
    for path in save_figure(block.figure, inputs.out / "fig05-flow"):
        print(f"written: {path}")
