"""Flow below a quadrotor in the diagonal plane: two pictures and the centre line beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from benchtool.report.palette import BLACK, BLUE, GREY, VERMILION
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FlowPicture:
    """Hold one velocity field in the diagonal plane, in v_h over R.

    Attributes:
        label: heading.
        along_R: places along the diagonal (nx,).
        height_R: heights above ground (nz,).
        across: velocity along the diagonal (nz, nx).
        upward: vertical velocity (nz, nx).
        centre: vertical velocity on the centre line (nz,).
    """

    label: str
    along_R: Array
    height_R: Array
    across: Array
    upward: Array
    centre: Array


@styled
def flow_figure(
    pictures: Sequence[FlowPicture], *, rotor_at_R: float, rotor_height_R: float, title: str
) -> Figure:
    """Draw streamlines over vertical velocity, one field beside the other, and their centre lines.

    Args:
        pictures: the fields.
        rotor_at_R: distance of the rotor axes from the centre along the diagonal.
        rotor_height_R: height of the rotor plane.
        title: one line.
    """
    figure = new_figure(title, simulated=True, height_in=7.4, width_in=9.4)
    parts: Any = figure.subfigures(2, 1, height_ratios=[1.55, 1.0])
    upper, lower = parts
    axes = upper.subplots(len(pictures), 1, sharex=True)
    shading: Any = None
    for each, picture in zip(np.atleast_1d(axes), pictures, strict=True):
        shading = each.pcolormesh(
            picture.along_R, picture.height_R, picture.upward, cmap="RdBu_r", shading="gouraud",
            norm=TwoSlopeNorm(0.0, -1.3, 0.65), rasterized=True,
        )  # fmt: skip
        each.streamplot(
            picture.along_R, picture.height_R, picture.across, picture.upward, color=BLACK,
            linewidth=0.65, density=(1.8, 1.0), arrowsize=0.7, broken_streamlines=True,
        )  # fmt: skip
        _vehicle(each, rotor_at_R, rotor_height_R)
        each.set_title(picture.label)
        each.set_ylabel("height / $R$")
        each.set_ylim(0.0, float(picture.height_R[-1]))
        each.set_xlim(float(picture.along_R[0]), float(picture.along_R[-1]))
        each.grid(False)
    np.atleast_1d(axes)[-1].set_xlabel("along the diagonal / $R$")
    bar = upper.colorbar(shading, ax=axes, shrink=0.8, pad=0.01)
    bar.set_label("upward velocity / $v_h$")
    _centre_lines(lower.subplots(), pictures, rotor_height_R)
    return figure


def _vehicle(axes: Axes, at: float, height: float) -> None:
    for side in (-at, at):
        axes.plot([side - 1.0, side + 1.0], [height, height], color=BLACK, linewidth=3.2)
    axes.add_patch(Rectangle((-0.5, height - 0.12), 1.0, 0.24, facecolor=GREY, edgecolor="white"))
    axes.axhline(0.0, color=BLACK, linewidth=3.0)


def _centre_lines(axes: Axes, pictures: Sequence[FlowPicture], height: float) -> None:
    for picture, color in zip(pictures, (BLUE, VERMILION), strict=False):
        below = picture.height_R <= height + 1e-9
        axes.plot(picture.height_R[below], picture.centre[below], color=color, label=picture.label)
    axes.axhline(0.0, color=GREY, linewidth=0.9)
    axes.set_xlabel("height on the centre line / $R$")
    axes.set_ylabel("upward velocity / $v_h$")
    axes.set_title("Between the rotors: only the vortex rings show the fountain")
    axes.legend(loc="center")
