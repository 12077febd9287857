"""Drawn geometry: the vehicle half over an obstacle, the map, the two cases, a tilted vehicle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from numpy.typing import NDArray

from benchtool.report.palette import BLACK, BLUE, GREEN, GREY, VERMILION
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]

SOLID = "#d9cdb8"
"""Colour of obstacles and ground."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sketch:
    """Hold the lengths of a drawing, in m: rotor places (n, 2), radius, obstacle along x."""

    rotors_m: Array
    names: tuple[str, ...]
    radius_m: float
    obstacle_m: tuple[float, float]
    depth_m: float = 0.6


@styled
def partial_effect_figure(sketch: Sketch, *, x_m: float, z_m: float, title: str) -> Figure:
    """Draw figure 7: a vehicle with its front over the obstacle, from above and from the side."""
    figure = new_figure(title, simulated=False, height_in=3.9, width_in=8.2)
    above, side = figure.subplots(1, 2, width_ratios=[1.0, 1.0])
    edge = sketch.obstacle_m[0]
    above.add_patch(Rectangle((edge, -0.5), 0.6, 1.0, facecolor=SOLID, edgecolor=GREY))
    for (rx, ry), name in zip(sketch.rotors_m, sketch.names, strict=True):
        over = x_m + rx + sketch.radius_m > edge
        above.plot([x_m, x_m + rx], [0.0, ry], color=BLACK, linewidth=2.0, zorder=1)
        _disc(above, (x_m + rx, ry), sketch.radius_m, name, over)
    above.text(edge + 0.17, 0.36, "obstacle", ha="center", fontsize=9)
    above.set_title("from above: one rotor over the edge")
    above.set_xlim(x_m - 0.45, edge + 0.35)
    above.set_ylim(-0.47, 0.47)
    above.set_xlabel("$x$ [m]")
    above.set_ylabel("$y$ [m]")
    _ground(side, sketch.obstacle_m, sketch.depth_m)
    _vehicle(side, sketch, x_m, z_m, 0.0)
    front = x_m + float(sketch.rotors_m[:, 0].max())
    _measure(side, (front + 0.06, 0.0), (front + 0.06, z_m), "$z$")
    side.annotate(
        "", (front, z_m + 0.2), (front, z_m + 0.02),
        arrowprops={"arrowstyle": "-|>", "color": VERMILION, "linewidth": 2.2},
    )  # fmt: skip
    side.text(front - 0.02, z_m + 0.16, "more thrust", ha="right", fontsize=9, color=VERMILION)
    side.set_xlim(x_m - 0.45, edge + 0.35)
    side.set_ylim(-0.35, z_m + 0.35)
    side.set_title("from the side: the wall pushes the nose up")
    side.set_xlabel("$x$ [m]")
    side.set_ylabel("height over the obstacle [m]")
    for axes in (above, side):
        axes.set_aspect("equal")
    return figure


@styled
def cases_figure(
    sketch: Sketch, *, goals_m: Sequence[tuple[str, float]], z_m: float, title: str
) -> Figure:
    """Draw figure 11: where each case starts and where it goes, from the side."""
    figure = new_figure(title, simulated=False, height_in=1.7 * len(goals_m) + 0.8)
    axes = np.atleast_1d(figure.subplots(len(goals_m), 1, sharex=True))
    for each, (name, goal) in zip(axes, goals_m, strict=True):
        _ground(each, sketch.obstacle_m, sketch.depth_m)
        for x, ghost in ((0.0, True), (goal, False)):
            _vehicle(each, sketch, x, z_m, 0.0, ghost)
        each.annotate(
            "", (goal - 0.35, z_m + 0.28), (0.35, z_m + 0.28),
            arrowprops={"arrowstyle": "-|>", "color": BLUE, "linewidth": 1.5},
        )  # fmt: skip
        each.text(0.0, z_m + 0.26, "A", ha="center", fontweight="bold")
        each.text(goal, z_m + 0.26, "B", ha="center", fontweight="bold")
        each.set_title(name)
        each.set_xlim(-0.6, 7.6)
        each.set_ylim(-sketch.depth_m, z_m + 0.6)
        each.set_ylabel("height [m]")
        each.set_aspect("equal")
    axes[-1].set_xlabel("$x$ [m]")
    return figure


@styled
def plate_figure(
    sketch: Sketch,
    *,
    half_width_m: float,
    away_m: float,
    z_m: float,
    when: tuple[str, str],
    title: str,
) -> Figure:
    """Draw figure 29: a plate that comes under the front rotor in free hover, and goes again.

    Args:
        sketch: the vehicle; its obstacle is the plate where it stands under the rotor.
        half_width_m: of the plate along y.
        away_m: how far along x it stands before and after.
        z_m: height of the rotors over the plate.
        when: when it comes, and when it goes.
        title: of the figure.
    """
    figure = new_figure(title, simulated=False, height_in=4.9)
    above, side = figure.subplots(2, 1, sharex=True, height_ratios=[1.0, 0.85])
    near, length = sketch.obstacle_m[0], sketch.obstacle_m[1] - sketch.obstacle_m[0]
    thick = 0.03
    for shift, face, line in ((away_m, "none", "--"), (0.0, SOLID, "-")):
        for axes, low, high in (
            (above, -half_width_m, 2.0 * half_width_m),
            (side, -thick, thick),
        ):
            axes.add_patch(
                Rectangle((near + shift, low), length, high, facecolor=face, edgecolor=GREY,
                          linestyle=line)
            )  # fmt: skip
    front = float(sketch.rotors_m[:, 0].max())
    for (rx, ry), name in zip(sketch.rotors_m, sketch.names, strict=True):
        over = rx + sketch.radius_m > near and abs(ry) < half_width_m
        above.plot([0.0, rx], [0.0, ry], color=BLACK, linewidth=2.0, zorder=1)
        _disc(above, (rx, ry), sketch.radius_m, name, over)
    _vehicle(side, sketch, 0.0, z_m, 0.0)
    _measure(side, (front + 0.06, 0.0), (front + 0.06, z_m), "$z$")
    end = sketch.obstacle_m[1]
    for axes, y in ((above, 0.0), (side, 0.16)):
        for offset, (text, begins, ends) in zip(
            (0.04, -0.08),
            ((when[0], end + away_m - 0.1, end + 0.1), (when[1], end + 0.1, end + away_m - 0.1)),
            strict=True,
        ):
            axes.annotate(
                "", (ends, y + offset), (begins, y + offset),
                arrowprops={"arrowstyle": "-|>", "color": BLUE, "linewidth": 1.5},
            )  # fmt: skip
            if axes is above:
                axes.text(end + 0.5 * away_m, y + offset + 0.03, text, ha="center", fontsize=9)
    side.annotate(
        "", (front, z_m + 0.24), (front, z_m + 0.03),
        arrowprops={"arrowstyle": "-|>", "color": VERMILION, "linewidth": 2.2},
    )  # fmt: skip
    side.text(front + 0.04, z_m + 0.16, "more thrust: nose up, and a drift back", fontsize=9,
              color=VERMILION)  # fmt: skip
    above.set_title("from above: one rotor over the plate")
    above.set_ylabel("$y$ [m]")
    above.set_ylim(-0.42, 0.42)
    side.set_title("from the side: nothing else is in reach of the wakes")
    side.set_ylim(-0.12, z_m + 0.34)
    side.set_ylabel("height [m]")
    side.set_xlabel("$x$ [m]")
    side.set_xlim(-0.45, end + away_m + 0.08)
    for axes in (above, side):
        axes.set_aspect("equal")
    return figure


@styled
def map_figure(x_m: Array, y_m: Array, height_m: Array, *, path_m: Array, title: str) -> Figure:
    """Draw figure 10: an environment map from above, and from the side, with the path."""
    figure = new_figure(title, simulated=False, height_in=4.6)
    above, side = figure.subplots(2, 1, sharex=True, height_ratios=[1.4, 1.0])
    shading = above.pcolormesh(
        x_m, y_m, height_m.T, cmap="cividis", shading="nearest", rasterized=True
    )
    above.plot(path_m[:, 0], path_m[:, 1], color=VERMILION, linewidth=2.0)
    above.text(path_m[0, 0], path_m[0, 1] + 0.12, "A", color="white", fontweight="bold")
    above.text(path_m[-1, 0], path_m[-1, 1] + 0.12, "B", color="white", fontweight="bold")
    above.set_ylabel("$y$ [m]")
    above.grid(False)
    figure.colorbar(shading, ax=above, label="height [m]", pad=0.01)
    middle = height_m[:, len(y_m) // 2]
    side.fill_between(x_m, middle, float(np.nanmin(middle)) - 0.15, color=SOLID, step="mid")
    side.plot(path_m[:, 0], path_m[:, 2], color=VERMILION, linewidth=2.0)
    side.set_xlabel("$x$ [m]")
    side.set_ylabel("height [m]")
    side.set_xlim(float(x_m[0]), float(x_m[-1]))
    return figure


def draw_tilted(axes: Axes, sketch: Sketch, z_m: float, tilt_rad: float) -> None:
    """Draw a tilted vehicle over level ground with the moment that turns it back."""
    reach = 0.52
    axes.add_patch(Rectangle((-reach, -0.09), 2.0 * reach, 0.09, facecolor=SOLID, edgecolor=GREY))
    _vehicle(axes, sketch, 0.0, z_m, tilt_rad)
    arm = float(sketch.rotors_m[:, 0].max())
    for side, length, color in ((1.0, 0.26, VERMILION), (-1.0, 0.17, BLUE)):
        x, z = side * arm * cos(tilt_rad), z_m - side * arm * sin(tilt_rad)
        axes.annotate(
            "", (x + length * sin(tilt_rad), z + length * cos(tilt_rad)), (x, z),
            arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 2.0},
        )  # fmt: skip
        _measure(axes, (x, 0.0), (x, z), "")
    axes.annotate(
        "", (-0.1, z_m + 0.17), (0.12, z_m + 0.15),
        arrowprops={
            "arrowstyle": "-|>", "color": BLACK, "linewidth": 1.6, "connectionstyle": "arc3,rad=0.5"
        },
    )  # fmt: skip
    axes.text(0.0, z_m + 0.27, "restoring\nmoment", ha="center", fontsize=9)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-0.09, z_m + 0.4)
    axes.set_aspect("equal")
    axes.set_axis_off()


def _ground(axes: Axes, obstacle: tuple[float, float], depth: float) -> None:
    axes.add_patch(
        Rectangle((obstacle[0], -depth), obstacle[1] - obstacle[0], depth, facecolor=SOLID,
                  edgecolor=GREY)
    )  # fmt: skip


def _disc(axes: Axes, place: tuple[float, float], radius: float, name: str, over: bool) -> None:
    """Draw a rotor disc from above; green where it is over something."""
    axes.add_patch(
        Circle(place, radius, facecolor="#bfe3c8" if over else "white",
               edgecolor=GREEN if over else GREY, linewidth=1.6, zorder=2)
    )  # fmt: skip
    axes.text(*place, name, ha="center", va="center", fontsize=8.5, zorder=3)


def _vehicle(
    axes: Axes, sketch: Sketch, x: float, z: float, tilt: float, ghost: bool = False
) -> None:
    alpha = 0.35 if ghost else 1.0
    c, s = cos(tilt), sin(tilt)
    reach = float(np.abs(sketch.rotors_m[:, 0]).max())
    axes.plot(
        [x - reach * c, x + reach * c], [z + reach * s, z - reach * s], color=BLACK, lw=2.0,
        alpha=alpha,
    )  # fmt: skip
    for rx in sorted(set(sketch.rotors_m[:, 0])):
        low, high = rx - sketch.radius_m, rx + sketch.radius_m
        axes.plot(
            [x + low * c, x + high * c], [z - low * s, z - high * s], color=BLUE, lw=3.2,
            alpha=alpha, solid_capstyle="round",
        )  # fmt: skip


def _measure(axes: Axes, low: tuple[float, float], high: tuple[float, float], name: str) -> None:
    axes.annotate("", high, low, arrowprops={"arrowstyle": "<->", "color": GREY, "linewidth": 1.1})
    axes.text(low[0] + 0.015, 0.5 * (low[1] + high[1]), name, fontsize=10, va="center")
