"""Drawn geometry and schemes: figures 7, 10, 11, 16, 19 and 29.

Run: python docs/examples/paper/drawings.py [FOLDER]
"""

from __future__ import annotations

from math import cos, inf, sin

import numpy as np
from look import BLACK, BLUE, GREEN, GREY, OVER, VERMILION, arrow, new_figure, save
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

import benchtool as bt

SOLID = "#d9cdb8"  # obstacles and ground
OBSTACLE_X_M, DEPTH_M = (3.0, 5.0), 0.6  # extent and height of the obstacle (section 3.1)
GOALS_M = {
    "case 1: flying over the obstacle": 7.0,
    "case 2: hovering with one rotor over the edge": 2.8,
}
RIG = bt.load_rig("pquad")
RADIUS_M = RIG.propulsion.radius_m
Z_M = 2.0 * RADIUS_M
FRONT_M = float(RIG.disc_positions_m[:, 0].max())

Point = tuple[float, float]


def partial_effect() -> Figure:
    """Draw figure 7: a vehicle with its front over the obstacle, from above and from the side."""
    figure = new_figure("One rotor over the obstacle (Fig. 7)", 8.2, 3.9, simulated=False)
    x_m, edge = GOALS_M["case 2: hovering with one rotor over the edge"], OBSTACLE_X_M[0]
    front = x_m + FRONT_M
    above, side = figure.subplots(1, 2)
    above.add_patch(Rectangle((edge, -0.5), 0.6, 1.0, fc=SOLID, ec=GREY))
    rotors(above, x_m, edge, inf)
    above.text(edge + 0.17, 0.36, "obstacle", ha="center", fontsize=9)
    above.set(title="from above: one rotor over the edge", ylabel="$y$ [m]", ylim=(-0.47, 0.47))
    obstacle(side)
    vehicle(side, RIG, x_m, Z_M)
    measure(side, (front + 0.06, 0.0), (front + 0.06, Z_M), "$z$")
    arrow(side, (front, Z_M + 0.02), (front, Z_M + 0.2), color=VERMILION, linewidth=2.2)
    side.text(front - 0.02, Z_M + 0.16, "more thrust", ha="right", fontsize=9, color=VERMILION)
    side.set(title="from the side: the wall pushes the nose up", ylim=(-0.35, Z_M + 0.35))
    side.set_ylabel("height over the obstacle [m]")
    for axes in (above, side):
        axes.set(xlabel="$x$ [m]", xlim=(x_m - 0.45, edge + 0.35), aspect="equal")
    return figure


def environment_map() -> Figure:
    """Draw figure 10: an environment map from above, and from the side, with the path."""
    figure = new_figure("The environment map of the flights (Fig. 10)", 7.0, 4.6, simulated=False)
    x_m, y_m = np.linspace(-1.0, 8.0, 181), np.linspace(-1.5, 1.5, 61)
    over = (x_m >= OBSTACLE_X_M[0]) & (x_m <= OBSTACLE_X_M[1])
    height_m = np.where(over, 0.0, -DEPTH_M)
    above, side = figure.subplots(2, 1, sharex=True, height_ratios=(1.4, 1.0))
    shading = above.pcolormesh(
        x_m, y_m, np.tile(height_m, (len(y_m), 1)), cmap="cividis", shading="nearest",
        rasterized=True,
    )  # fmt: skip
    path_m = (0.0, 7.0)
    above.plot(path_m, (0.0, 0.0), color=VERMILION, linewidth=2.0)
    for x, name in zip(path_m, "AB", strict=True):
        above.text(x, 0.12, name, color="white", fontweight="bold")
    above.set_ylabel("$y$ [m]")
    above.grid(False)
    figure.colorbar(shading, ax=above, label="height over the obstacle [m]", pad=0.01)
    side.fill_between(x_m, height_m, -DEPTH_M - 0.15, color=SOLID, step="mid")
    side.plot(path_m, (Z_M, Z_M), color=VERMILION, linewidth=2.0)
    side.text(0.0, Z_M + 0.04, "path of the rotors from A to B", color=VERMILION)
    side.text(4.0, -0.3, "obstacle", ha="center", va="center")
    side.set(xlabel="$x$ [m]", ylabel="height over the\nobstacle [m]", xlim=(-1.0, 8.0))
    side.set_ylim(top=Z_M + 0.2)
    return figure


def cases() -> Figure:
    """Draw figure 11: where each case starts and where it goes, from the side."""
    figure = new_figure("The two cases, z/R = 2 (Fig. 11)", 7.0, 4.2, simulated=False)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, (name, goal) in zip(panels, GOALS_M.items(), strict=True):
        obstacle(axes)
        vehicle(axes, RIG, 0.0, Z_M, alpha=0.35)
        vehicle(axes, RIG, goal, Z_M)
        arrow(axes, (0.35, Z_M + 0.28), (goal - 0.35, Z_M + 0.28), color=BLUE)
        for x, letter in ((0.0, "A"), (goal, "B")):
            axes.text(x, Z_M + 0.26, letter, ha="center", fontweight="bold")
        axes.set(title=name, xlim=(-0.6, 7.6), ylim=(-DEPTH_M, Z_M + 0.6), ylabel="height [m]")
        axes.set_aspect("equal")
    panels[-1].set_xlabel("$x$ [m]")
    return figure


def plate_set_up() -> Figure:
    """Draw figure 29: a plate that comes under the front rotor in free hover, and goes again."""
    title = "Free hover with a plate moved under one rotor and withdrawn (Fig. 29)"
    figure = new_figure(title, 7.0, 4.9, simulated=False)
    flight = bt.simulate_flight(("pid",), case="plate", duration_s=1.0).found[1]
    (plate,) = flight.case.below.blocks
    (near, end), half_width_m, away_m = plate.x_m, plate.y_m[1], plate.slide_m[0]
    comes, come, goes, gone = plate.times_s
    above, side = figure.subplots(2, 1, sharex=True, height_ratios=(1.0, 0.85))
    thick = 0.03
    for shift, face, line in ((away_m, "none", "--"), (0.0, SOLID, "-")):
        for axes, low, high in ((above, -half_width_m, 2.0 * half_width_m), (side, -thick, thick)):
            corner = (near + shift, low)
            axes.add_patch(Rectangle(corner, end - near, high, fc=face, ec=GREY, linestyle=line))
    rotors(above, 0.0, near, half_width_m)
    vehicle(side, RIG, 0.0, Z_M)
    measure(side, (FRONT_M + 0.06, 0.0), (FRONT_M + 0.06, Z_M), "$z$")
    far, close = end + away_m - 0.1, end + 0.1
    for offset, text, begins, ends in (
        (0.04, f"comes at {comes:g} to {come:g} s", far, close),
        (-0.08, f"goes at {goes:g} to {gone:g} s", close, far),
    ):
        arrow(above, (begins, offset), (ends, offset), color=BLUE)
        arrow(side, (begins, 0.16 + offset), (ends, 0.16 + offset), color=BLUE)
        above.text(end + 0.5 * away_m, offset + 0.03, text, ha="center", fontsize=9)
    arrow(side, (FRONT_M, Z_M + 0.03), (FRONT_M, Z_M + 0.24), color=VERMILION, linewidth=2.2)
    text = "more thrust: nose up, and a drift back"
    side.text(FRONT_M + 0.04, Z_M + 0.16, text, fontsize=9, color=VERMILION)
    above.set(title="from above: one rotor over the plate", ylabel="$y$ [m]", ylim=(-0.42, 0.42))
    side.set(title="from the side: nothing else is in reach of the wakes", xlabel="$x$ [m]")
    side.set(ylabel="height [m]", xlim=(-0.45, end + away_m + 0.08), ylim=(-0.12, Z_M + 0.34))
    for axes in (above, side):
        axes.set_aspect("equal")
    return figure


def draw_tilted(axes: Axes, rig: bt.Rig, z_m: float, tilt_rad: float) -> None:
    """Draw a tilted vehicle over level ground with the moment that turns it back (figure 9)."""
    reach = 0.52
    axes.add_patch(Rectangle((-reach, -0.09), 2.0 * reach, 0.09, fc=SOLID, ec=GREY))
    vehicle(axes, rig, 0.0, z_m, tilt_rad)
    for side, length, color in ((1.0, 0.26, VERMILION), (-1.0, 0.17, BLUE)):
        x, z = side * FRONT_M * cos(tilt_rad), z_m - side * FRONT_M * sin(tilt_rad)
        tip = (x + length * sin(tilt_rad), z + length * cos(tilt_rad))
        arrow(axes, (x, z), tip, color=color, linewidth=2.0)
        measure(axes, (x, 0.0), (x, z), "")
    begin, end = (0.12, z_m + 0.15), (-0.1, z_m + 0.17)
    arrow(axes, begin, end, linewidth=1.6, connectionstyle="arc3,rad=0.5")
    axes.text(0.0, z_m + 0.27, "restoring\nmoment", ha="center", fontsize=9)
    axes.set(xlim=(-reach, reach), ylim=(-0.09, z_m + 0.4), aspect="equal")
    axes.set_axis_off()


def obstacle(axes: Axes) -> None:
    """Draw the obstacle from the side."""
    begin, end = OBSTACLE_X_M
    axes.add_patch(Rectangle((begin, -DEPTH_M), end - begin, DEPTH_M, fc=SOLID, ec=GREY))


def rotors(axes: Axes, x_m: float, edge_m: float, half_width_m: float) -> None:
    """Draw the rotor discs from above; green where they are over something."""
    for (rx, ry), rotor in zip(RIG.disc_positions_m, RIG.rotors, strict=True):
        over = x_m + rx + RADIUS_M > edge_m and abs(ry) < half_width_m
        axes.plot([x_m, x_m + rx], [0.0, ry], color=BLACK, linewidth=2.0, zorder=1)
        face, edge = (OVER, GREEN) if over else ("white", GREY)
        axes.add_patch(Circle((x_m + rx, ry), RADIUS_M, fc=face, ec=edge, lw=1.6, zorder=2))
        axes.text(x_m + rx, ry, rotor.name, ha="center", va="center", fontsize=8.5, zorder=3)


def vehicle(
    axes: Axes, rig: bt.Rig, x: float, z: float, tilt: float = 0.0, alpha: float = 1.0
) -> None:
    """Draw the vehicle from the side: its arm and its discs."""
    c, s, radius = cos(tilt), sin(tilt), rig.propulsion.radius_m
    forward = rig.disc_positions_m[:, 0]
    reach = float(np.abs(forward).max())
    arm = ([x - reach * c, x + reach * c], [z + reach * s, z - reach * s])
    axes.plot(*arm, color=BLACK, lw=2.0, alpha=alpha)
    for rx in sorted(set(forward)):
        ends = np.array([rx - radius, rx + radius])
        axes.plot(
            x + ends * c, z - ends * s, color=BLUE, lw=3.2, alpha=alpha, solid_capstyle="round"
        )


def measure(axes: Axes, low: Point, high: Point, name: str) -> None:
    """Draw a dimension line."""
    axes.annotate("", high, low, arrowprops={"arrowstyle": "<->", "color": GREY, "linewidth": 1.1})
    axes.text(low[0] + 0.015, 0.5 * (low[1] + high[1]), name, fontsize=10, va="center")


LAW, PLANT, ADDED = ("#e8f1f8", BLUE), ("#f1ece2", GREY), ("#fbe6d9", VERMILION)
"""Face and edge of a block; what a strategy adds to the baseline is orange."""

HALF = 0.34  # half the height of a block


def block(
    axes: Axes, text: str, x: float, y: float, width: float, look: tuple[str, str] = LAW
) -> None:
    """Draw a block of a diagram with its text."""
    shape = FancyBboxPatch(
        (x - 0.5 * width, y - HALF), width, 2.0 * HALF, fc=look[0], ec=look[1], linewidth=1.4,
        boxstyle="round,pad=0.0,rounding_size=0.06",
    )  # fmt: skip
    axes.add_patch(shape)
    axes.text(x, y, text, ha="center", va="center", fontsize=8.6, linespacing=1.25)


def wire(axes: Axes, *points: Point, label: str = "", added: bool = False) -> None:
    """Join points with an arrow at the last; the label is over the first segment."""
    color = VERMILION if added else BLACK
    xs, ys = zip(*points, strict=True)
    axes.plot(xs[:-1], ys[:-1], color=color, linewidth=1.2)
    arrow(axes, points[-2], points[-1], color=color, linewidth=1.2, shrinkA=0, shrinkB=0)
    x, y = 0.5 * (xs[0] + xs[1]), 0.5 * (ys[0] + ys[1])
    axes.text(x, y + 0.07, label, ha="center", fontsize=8.6, va="bottom", color=color)


def scheme(title: str, effect: str) -> tuple[Figure, Axes]:
    """Return a figure with the baseline: loops, mixer and vehicle, with the effect on it."""
    figure = new_figure(title, 10.0, 3.3, simulated=False)
    axes = figure.subplots()
    block(axes, "position and\nvelocity loops", 0.0, 0.0, 1.5)
    block(axes, "attitude and\nrate loops", 2.3, 0.0, 1.5)
    block(axes, "mixer\neq. (9)", 5.3, 0.0, 1.2)
    block(axes, "rotors and\nvehicle", 8.6, 0.0, 1.5, PLANT)
    block(axes, effect, 8.6, 1.35, 1.9, PLANT)
    wire(axes, (-1.6, 0.0), (-0.75, 0.0), label="goal")
    wire(axes, (0.75, 0.0), (1.55, 0.0), label="pitch")
    wire(axes, (9.35, 0.0), (10.2, 0.0), label="$q,\\ \\dot q$")
    wire(axes, (9.8, 0.0), (9.8, -2.1), (0.0, -2.1), (0.0, -HALF))
    wire(axes, (2.3, -2.1), (2.3, -HALF))
    wire(axes, (8.6, 1.05), (8.6, HALF))
    axes.set(xlim=(-2.0, 10.3), ylim=(-2.7, 1.95))
    axes.set_axis_off()
    return figure, axes


def observer_scheme() -> Figure:
    """Draw figure 16."""
    figure, axes = scheme("Estimated torque controller (Fig. 16)", "ground effect $F_{GE}$")
    block(axes, "torque observer\neq. (12), momentum form", 5.3, -1.15, 2.5, ADDED)
    block(axes, "−", 3.75, 0.0, 0.4, ADDED)
    wire(axes, (3.05, 0.0), (3.55, 0.0))
    wire(axes, (3.95, 0.0), (4.7, 0.0), label="torque")
    wire(axes, (5.9, 0.0), (7.85, 0.0), label="rotor speeds")
    wire(axes, (4.3, 0.0), (4.3, -0.81), added=True)
    wire(axes, (9.8, -1.15), (6.55, -1.15), label="rates", added=True)
    wire(axes, (4.05, -1.15), (3.75, -1.15), (3.75, -HALF), added=True)
    return figure


def feedforward_scheme() -> Figure:
    """Draw figure 19."""
    figure, axes = scheme("Feedforward controller (Fig. 19)", "ground effect $f_{GE}$")
    block(axes, "divide by\n$\\hat f_{GE}$", 7.0, 0.0, 1.0, ADDED)
    block(axes, "model of the effect\neq. (2) to (4), areas", 7.0, -1.15, 2.1, ADDED)
    block(axes, "map, or range sensor\nunder each rotor", 4.1, -1.15, 2.1, ADDED)
    wire(axes, (3.05, 0.0), (4.7, 0.0), label="torque")
    wire(axes, (5.9, 0.0), (6.5, 0.0))
    wire(axes, (7.5, 0.0), (7.85, 0.0))
    wire(axes, (5.15, -1.15), (5.95, -1.15), label="heights", added=True)
    wire(axes, (7.0, -0.81), (7.0, -HALF), added=True)
    wire(axes, (4.1, -2.1), (4.1, -1.49), added=True)
    return figure


FIGURES = {
    "fig07-partial-effect": partial_effect,
    "fig10-map": environment_map,
    "fig11-cases": cases,
    "fig16-observer-scheme": observer_scheme,
    "fig19-feedforward-scheme": feedforward_scheme,
    "fig29-plate-set-up": plate_set_up,
}

if __name__ == "__main__":
    save(FIGURES)
