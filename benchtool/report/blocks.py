"""Block diagrams of the controllers, drawn from lists of boxes and arrows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from benchtool.report.palette import BLACK, BLUE, GREY, VERMILION
from benchtool.report.style import new_figure, styled

Kind = Literal["law", "plant", "added"]

_FACES = {"law": "#e8f1f8", "plant": "#f1ece2", "added": "#fbe6d9"}
_EDGES = {"law": BLUE, "plant": GREY, "added": VERMILION}


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """Place one block: centre in units of the diagram, width, text."""

    name: str
    text: str
    x: float
    y: float
    width: float = 1.5
    kind: Kind = "law"


@dataclass(frozen=True, slots=True, kw_only=True)
class Wire:
    """Join points (x, y) with an arrow at the last; the label stands at the first segment."""

    points: tuple[tuple[float, float], ...]
    label: str = ""
    added: bool = False
    above: bool = True


HALF = 0.34
"""Half the height of a box."""


@styled
def block_figure(boxes: Sequence[Box], wires: Sequence[Wire], *, title: str) -> Figure:
    """Draw a controller; what a strategy adds to the baseline is orange."""
    figure = new_figure(title, simulated=False, height_in=3.3, width_in=10.0)
    axes = figure.subplots()
    for box in boxes:
        _box(axes, box)
    for wire in wires:
        _wire(axes, wire)
    xs = [box.x for box in boxes]
    ys = [y for wire in wires for _, y in wire.points] + [box.y for box in boxes]
    axes.set_xlim(min(xs) - 2.0, max(xs) + 1.7)
    axes.set_ylim(min(ys) - 0.6, max(ys) + 0.6)
    axes.set_axis_off()
    return figure


def _box(axes: Axes, box: Box) -> None:
    axes.add_patch(
        FancyBboxPatch(
            (box.x - 0.5 * box.width, box.y - HALF), box.width, 2.0 * HALF,
            boxstyle="round,pad=0.0,rounding_size=0.06", facecolor=_FACES[box.kind],
            edgecolor=_EDGES[box.kind], linewidth=1.4,
        )
    )  # fmt: skip
    axes.text(box.x, box.y, box.text, ha="center", va="center", fontsize=8.6, linespacing=1.25)


def _wire(axes: Axes, wire: Wire) -> None:
    color = VERMILION if wire.added else BLACK
    xs = [x for x, _ in wire.points]
    ys = [y for _, y in wire.points]
    axes.plot(xs[:-1], ys[:-1], color=color, linewidth=1.2)
    axes.annotate(
        "", wire.points[-1], wire.points[-2],
        arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 1.2, "shrinkA": 0,
                    "shrinkB": 0},
    )  # fmt: skip
    if wire.label:
        x, y = 0.5 * (xs[0] + xs[1]), 0.5 * (ys[0] + ys[1])
        axes.text(
            x, y + (0.07 if wire.above else -0.07), wire.label, ha="center", fontsize=8.6,
            va="bottom" if wire.above else "top", color=color,
        )  # fmt: skip
