"""Block diagrams of the controllers, figures 16 and 19: what each strategy adds to the cascade."""

from __future__ import annotations

from typing import Any, Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from benchtool.report.figure import figure
from benchtool.report.palette import BLACK, BLUE, GREY, VERMILION
from benchtool.report.panels import arrow
from benchtool.report.paper.flights import Flies

Kind = Literal["law", "plant", "added"]

_LOOKS = {"law": ("#e8f1f8", BLUE), "plant": ("#f1ece2", GREY), "added": ("#fbe6d9", VERMILION)}
"""Face and edge of a block; what a strategy adds to the baseline is orange."""

HALF = 0.34
"""Half the height of a block."""

Point = tuple[float, float]


def _box(
    axes: Axes, text: str, x: float, y: float = 0.0, width: float = 1.5, kind: Kind = "law"
) -> None:
    face, edge = _LOOKS[kind]
    axes.add_patch(
        FancyBboxPatch(
            (x - 0.5 * width, y - HALF), width, 2.0 * HALF, facecolor=face, edgecolor=edge,
            boxstyle="round,pad=0.0,rounding_size=0.06", linewidth=1.4,
        )
    )  # fmt: skip
    axes.text(x, y, text, ha="center", va="center", fontsize=8.6, linespacing=1.25)


def _wire(axes: Axes, *points: Point, label: str = "", added: bool = False) -> None:
    """Join points with an arrow at the last; the label stands over the first segment."""
    color = VERMILION if added else BLACK
    xs, ys = zip(*points, strict=True)
    axes.plot(xs[:-1], ys[:-1], color=color, linewidth=1.2)
    look: dict[str, Any] = {"color": color, "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0}
    arrow(axes, points[-2], points[-1], **look)
    if label:
        x, y = 0.5 * (xs[0] + xs[1]), 0.5 * (ys[0] + ys[1])
        axes.text(x, y + 0.07, label, ha="center", fontsize=8.6, va="bottom", color=color)


def _cascade(axes: Axes, effect: str) -> None:
    """Draw the baseline: loops, mixer and vehicle, with the effect that acts on it."""
    for text, x, width, kind in (
        ("position and\nvelocity loops", 0.0, 1.5, "law"),
        ("attitude and\nrate loops", 2.3, 1.5, "law"),
        ("mixer\neq. (9)", 5.3, 1.2, "law"),
        ("rotors and\nvehicle", 8.6, 1.5, "plant"),
    ):
        _box(axes, text, x, width=width, kind=kind)  # type: ignore[arg-type]
    _box(axes, effect, 8.6, 1.35, 1.9, "plant")
    _wire(axes, (-1.6, 0.0), (-0.75, 0.0), label="goal")
    _wire(axes, (0.75, 0.0), (1.55, 0.0), label="pitch")
    _wire(axes, (9.35, 0.0), (10.2, 0.0), label="$q,\\ \\dot q$")
    _wire(axes, (9.8, 0.0), (9.8, -2.1), (0.0, -2.1), (0.0, -HALF))
    _wire(axes, (2.3, -2.1), (2.3, -HALF))
    _wire(axes, (8.6, 1.05), (8.6, HALF))
    axes.set_xlim(-2.0, 10.3)
    axes.set_ylim(-2.7, 1.95)
    axes.set_axis_off()


@figure(
    page="paper",
    name="fig16-observer-scheme",
    title="Estimated torque controller (Fig. 16)",
    caption="What the torque observer adds to the cascade is orange.",
    simulated=False,
    height_in=3.3,
    width_in=10.0,
)
def observer_scheme(figure: Figure, flights: Flies) -> None:
    """Draw figure 16."""
    axes = figure.subplots()
    _cascade(axes, "ground effect $F_{GE}$")
    _box(axes, "torque observer\neq. (12), momentum form", 5.3, -1.15, 2.5, "added")
    _box(axes, "−", 3.75, 0.0, 0.4, "added")
    _wire(axes, (3.05, 0.0), (3.55, 0.0))
    _wire(axes, (3.95, 0.0), (4.7, 0.0), label="torque")
    _wire(axes, (5.9, 0.0), (7.85, 0.0), label="rotor speeds")
    _wire(axes, (4.3, 0.0), (4.3, -0.81), added=True)
    _wire(axes, (9.8, -1.15), (6.55, -1.15), label="rates", added=True)
    _wire(axes, (4.05, -1.15), (3.75, -1.15), (3.75, -HALF), added=True)


@figure(
    page="paper",
    name="fig19-feedforward-scheme",
    title="Feedforward controller (Fig. 19)",
    caption="What feedforward adds to the cascade is orange.",
    simulated=False,
    height_in=3.3,
    width_in=10.0,
)
def feedforward_scheme(figure: Figure, flights: Flies) -> None:
    """Draw figure 19."""
    axes = figure.subplots()
    _cascade(axes, "ground effect $f_{GE}$")
    _box(axes, "divide by\n$\\hat f_{GE}$", 7.0, 0.0, 1.0, "added")
    _box(axes, "model of the effect\neq. (2) to (4), areas", 7.0, -1.15, 2.1, "added")
    _box(axes, "map, or range sensor\nunder each rotor", 4.1, -1.15, 2.1, "added")
    _wire(axes, (3.05, 0.0), (4.7, 0.0), label="torque")
    _wire(axes, (5.9, 0.0), (6.5, 0.0))
    _wire(axes, (7.5, 0.0), (7.85, 0.0))
    _wire(axes, (5.15, -1.15), (5.95, -1.15), label="heights", added=True)
    _wire(axes, (7.0, -0.81), (7.0, -HALF), added=True)
    _wire(axes, (4.1, -2.1), (4.1, -1.49), added=True)
