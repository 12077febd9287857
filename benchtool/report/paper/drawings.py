"""Drawn geometry: figures 7, 10, 11 and 29, and the tilted vehicle of figure 9."""

from __future__ import annotations

from math import cos, sin

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from benchtool.core.rig import Rig
from benchtool.report.figure import figure
from benchtool.report.palette import BLACK, BLUE, GREEN, GREY, VERMILION
from benchtool.report.panels import OVER, arrow, rows_of
from benchtool.report.paper.flights import Flies
from benchtool.simulate.flight.cases import (
    GOAL_EDGE_M,
    GOAL_OVER_M,
    OBSTACLE_X_M,
    plate_under_front,
)

SOLID = "#d9cdb8"
"""Colour of obstacles and ground."""

DEPTH_M = 0.6
"""Height of the obstacle's wall."""


def _z_m(rig: Rig) -> float:
    return 2.0 * rig.propulsion.radius_m


def _front_m(rig: Rig) -> float:
    return float(rig.disc_positions_m[:, 0].max())


@figure(
    page="paper",
    name="fig07-partial-effect",
    title="One rotor over the obstacle (Fig. 7)",
    caption="A vehicle with its front over the obstacle, from above and from the side.",
    simulated=False,
    height_in=3.9,
    width_in=8.2,
)
def partial_effect(figure: Figure, flights: Flies) -> None:
    """Draw figure 7: a vehicle with its front over the obstacle, from above and from the side."""
    rig, x_m, edge = flights.rig, GOAL_EDGE_M, OBSTACLE_X_M[0]
    z_m, front = _z_m(rig), x_m + _front_m(rig)
    above, side = figure.subplots(1, 2, width_ratios=[1.0, 1.0])
    above.add_patch(Rectangle((edge, -0.5), 0.6, 1.0, facecolor=SOLID, edgecolor=GREY))
    _rotors(above, rig, x_m, edge, np.inf)
    above.text(edge + 0.17, 0.36, "obstacle", ha="center", fontsize=9)
    above.set_title("from above: one rotor over the edge")
    above.set_ylim(-0.47, 0.47)
    above.set_ylabel("$y$ [m]")
    _obstacle(side)
    _vehicle(side, rig, x_m, z_m)
    _measure(side, (front + 0.06, 0.0), (front + 0.06, z_m), "$z$")
    arrow(side, (front, z_m + 0.02), (front, z_m + 0.2), color=VERMILION, linewidth=2.2)
    side.text(front - 0.02, z_m + 0.16, "more thrust", ha="right", fontsize=9, color=VERMILION)
    side.set_ylim(-0.35, z_m + 0.35)
    side.set_title("from the side: the wall pushes the nose up")
    side.set_ylabel("height over the obstacle [m]")
    for axes in (above, side):
        axes.set_xlabel("$x$ [m]")
        axes.set_xlim(x_m - 0.45, edge + 0.35)
        axes.set_aspect("equal")


@figure(
    page="paper",
    name="fig10-map",
    title="The environment map of the flights (Fig. 10)",
    caption="Heights from above, and from the side, with the path.",
    simulated=False,
    height_in=4.6,
)
def environment_map(figure: Figure, flights: Flies) -> None:
    """Draw figure 10: an environment map from above, and from the side, with the path."""
    x_m, y_m, z_m = np.linspace(-1.0, 8.0, 181), np.linspace(-1.5, 1.5, 61), _z_m(flights.rig)
    over = (x_m[:, None] >= OBSTACLE_X_M[0]) & (x_m[:, None] <= OBSTACLE_X_M[1])
    height_m = np.where(over, 0.0, -DEPTH_M) + 0.0 * y_m
    above, side = rows_of(figure, (1.4, 1.0))
    shading = above.pcolormesh(
        x_m, y_m, height_m.T, cmap="cividis", shading="nearest", rasterized=True
    )
    path_m = (0.0, GOAL_OVER_M)
    above.plot(path_m, (0.0, 0.0), color=VERMILION, linewidth=2.0)
    for place, name in zip(path_m, "AB", strict=True):
        above.text(place, 0.12, name, color="white", fontweight="bold")
    above.set_ylabel("$y$ [m]")
    above.grid(False)
    figure.colorbar(shading, ax=above, label="height over the obstacle [m]", pad=0.01)
    middle = height_m[:, len(y_m) // 2]
    side.fill_between(x_m, middle, float(middle.min()) - 0.15, color=SOLID, step="mid")
    side.plot(path_m, (z_m, z_m), color=VERMILION, linewidth=2.0)
    side.text(path_m[0], z_m + 0.04, "path of the rotors from A to B", color=VERMILION)
    side.text(4.0, -0.3, "obstacle", ha="center", va="center")
    side.set_xlabel("$x$ [m]")
    side.set_ylabel("height over the\nobstacle [m]")
    side.set_ylim(top=z_m + 0.2)
    side.set_xlim(float(x_m[0]), float(x_m[-1]))


CASES = {
    "case 1: flying over the obstacle": GOAL_OVER_M,
    "case 2: hovering with one rotor over the edge": GOAL_EDGE_M,
}


@figure(
    page="paper",
    name="fig11-cases",
    title="The two cases, z/R = 2 (Fig. 11)",
    caption="Where each case starts and where it goes, from the side.",
    simulated=False,
    height_in=1.7 * len(CASES) + 0.8,
)
def cases(figure: Figure, flights: Flies) -> None:
    """Draw figure 11: where each case starts and where it goes, from the side."""
    rig, z_m = flights.rig, _z_m(flights.rig)
    panels = rows_of(figure, [1.0] * len(CASES))
    for axes, (name, goal) in zip(panels, CASES.items(), strict=True):
        _obstacle(axes)
        _vehicle(axes, rig, 0.0, z_m, alpha=0.35)
        _vehicle(axes, rig, goal, z_m)
        arrow(axes, (0.35, z_m + 0.28), (goal - 0.35, z_m + 0.28), color=BLUE)
        for place, letter in ((0.0, "A"), (goal, "B")):
            axes.text(place, z_m + 0.26, letter, ha="center", fontweight="bold")
        axes.set_title(name)
        axes.set_xlim(-0.6, 7.6)
        axes.set_ylim(-DEPTH_M, z_m + 0.6)
        axes.set_ylabel("height [m]")
        axes.set_aspect("equal")
    panels[-1].set_xlabel("$x$ [m]")


@figure(
    page="paper",
    name="fig29-plate-set-up",
    title="Free hover with a plate moved under one rotor and withdrawn (Fig. 29)",
    caption="A plate that comes under the front rotor in free hover, and goes again.",
    simulated=False,
    height_in=4.9,
)
def plate_set_up(figure: Figure, flights: Flies) -> None:
    """Draw figure 29: a plate that comes under the front rotor in free hover, and goes again."""
    rig, z_m, front = flights.rig, _z_m(flights.rig), _front_m(flights.rig)
    plate = plate_under_front(rig.propulsion.radius_m, front).blocks[0]
    (near, end), half_width_m, away_m = plate.x_m, plate.y_m[1], plate.slide_m[0]
    comes, come, goes, gone = plate.times_s
    above, side = rows_of(figure, (1.0, 0.85))
    thick = 0.03
    for shift, face, line in ((away_m, "none", "--"), (0.0, SOLID, "-")):
        for axes, low, high in ((above, -half_width_m, 2.0 * half_width_m), (side, -thick, thick)):
            outline = Rectangle((near + shift, low), end - near, high, facecolor=face,
                                edgecolor=GREY, linestyle=line)  # fmt: skip
            axes.add_patch(outline)
    _rotors(above, rig, 0.0, near, half_width_m)
    _vehicle(side, rig, 0.0, z_m)
    _measure(side, (front + 0.06, 0.0), (front + 0.06, z_m), "$z$")
    far, close = end + away_m - 0.1, end + 0.1
    for offset, text, begins, ends in (
        (0.04, f"comes at {comes:g} to {come:g} s", far, close),
        (-0.08, f"goes at {goes:g} to {gone:g} s", close, far),
    ):
        arrow(above, (begins, offset), (ends, offset), color=BLUE)
        arrow(side, (begins, 0.16 + offset), (ends, 0.16 + offset), color=BLUE)
        above.text(end + 0.5 * away_m, offset + 0.03, text, ha="center", fontsize=9)
    arrow(side, (front, z_m + 0.03), (front, z_m + 0.24), color=VERMILION, linewidth=2.2)
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


def draw_tilted(axes: Axes, rig: Rig, z_m: float, tilt_rad: float) -> None:
    """Draw a tilted vehicle over level ground with the moment that turns it back."""
    reach, arm = 0.52, _front_m(rig)
    axes.add_patch(Rectangle((-reach, -0.09), 2.0 * reach, 0.09, facecolor=SOLID, edgecolor=GREY))
    _vehicle(axes, rig, 0.0, z_m, tilt_rad)
    for side, length, color in ((1.0, 0.26, VERMILION), (-1.0, 0.17, BLUE)):
        x, z = side * arm * cos(tilt_rad), z_m - side * arm * sin(tilt_rad)
        tip = (x + length * sin(tilt_rad), z + length * cos(tilt_rad))
        arrow(axes, (x, z), tip, color=color, linewidth=2.0)
        _measure(axes, (x, 0.0), (x, z), "")
    arrow(axes, (0.12, z_m + 0.15), (-0.1, z_m + 0.17), linewidth=1.6,
          connectionstyle="arc3,rad=0.5")  # fmt: skip
    axes.text(0.0, z_m + 0.27, "restoring\nmoment", ha="center", fontsize=9)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-0.09, z_m + 0.4)
    axes.set_aspect("equal")
    axes.set_axis_off()


def _obstacle(axes: Axes) -> None:
    begin, end = OBSTACLE_X_M
    ground = Rectangle((begin, -DEPTH_M), end - begin, DEPTH_M, facecolor=SOLID, edgecolor=GREY)
    axes.add_patch(ground)


def _rotors(axes: Axes, rig: Rig, x_m: float, edge_m: float, half_width_m: float) -> None:
    """Draw the rotor discs from above; green where they are over something."""
    radius = rig.propulsion.radius_m
    for (rx, ry), rotor in zip(rig.disc_positions_m, rig.rotors, strict=False):
        over = x_m + rx + radius > edge_m and abs(ry) < half_width_m
        axes.plot([x_m, x_m + rx], [0.0, ry], color=BLACK, linewidth=2.0, zorder=1)
        disc = Circle(
            (x_m + rx, ry), radius, facecolor=OVER if over else "white",
            edgecolor=GREEN if over else GREY, linewidth=1.6, zorder=2,
        )  # fmt: skip
        axes.add_patch(disc)
        axes.text(x_m + rx, ry, rotor.name, ha="center", va="center", fontsize=8.5, zorder=3)


def _vehicle(
    axes: Axes, rig: Rig, x: float, z: float, tilt: float = 0.0, alpha: float = 1.0
) -> None:
    """Draw the vehicle from the side: its arm and its discs."""
    c, s, radius = cos(tilt), sin(tilt), rig.propulsion.radius_m
    forward = rig.disc_positions_m[:, 0]
    reach = float(np.abs(forward).max())
    axes.plot(
        [x - reach * c, x + reach * c], [z + reach * s, z - reach * s], color=BLACK, lw=2.0,
        alpha=alpha,
    )  # fmt: skip
    for rx in sorted(set(forward)):
        low, high = rx - radius, rx + radius
        axes.plot(
            [x + low * c, x + high * c], [z - low * s, z - high * s], color=BLUE, lw=3.2,
            alpha=alpha, solid_capstyle="round",
        )  # fmt: skip


def _measure(axes: Axes, low: tuple[float, float], high: tuple[float, float], name: str) -> None:
    axes.annotate("", high, low, arrowprops={"arrowstyle": "<->", "color": GREY, "linewidth": 1.1})
    axes.text(low[0] + 0.015, 0.5 * (low[1] + high[1]), name, fontsize=10, va="center")
