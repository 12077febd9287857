"""Model curves of the paper: figures 3, 4, 6 and 8, the flow (5) and restoring moments (9)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import sqrt
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from benchtool.core.array import Array
from benchtool.core.rig import Rig
from benchtool.physics.body_lift import quad_body_lift_factor
from benchtool.physics.conditions import Conditions
from benchtool.physics.images import quad_factor, single_rotor_factor, three_rotor_average_factor
from benchtool.physics.wake_picture import Hover, source_velocity, vortex_velocity
from benchtool.report.figure import Page, figure, is_simulated
from benchtool.report.palette import BLACK, BLUE, CYCLE, GREY, VERMILION, Role
from benchtool.report.panels import DASHED
from benchtool.report.paper.drawings import draw_tilted
from benchtool.report.paper.flights import Flies
from benchtool.report.paper.layouts import measured_points
from benchtool.report.ratio import Curve, draw_ratio, factor_over
from benchtool.simulate.flight.rigid_body import GRAVITY_M_S2
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.pitch.attitude import READINGS, hover_authority_Nm, restoring_moment_Nm

K_B = 2.0
"""Body lift coefficient of the paper's figure 6."""


def ratio_curves(rig: Rig) -> dict[str, Curve]:
    """Return the curves of figures 3, 4, 6 and 8: the paper's measured points are not public."""
    radius = rig.propulsion.radius_m
    spacing = float(sorted(set(rig.disc_distances_m[0].round(9)))[1])
    ratio = np.linspace(0.5, 6.0, 221)
    z = ratio * radius
    half, whole = (
        quad_body_lift_factor(radius, z, spacing, spacing * share, K_B)
        for share in (1.0 / sqrt(2.0), sqrt(2.0))
    )
    three = three_rotor_average_factor(radius, z, spacing)
    on = np.where(np.arange(rig.n_rotors) == rig.n_rotors - 1, 0.0, 1.0)[:, None]
    lifted = np.asarray(factor_over(FlightVehicle.of_rig(rig).model, on, ratio), float)
    return {
        "one": Curve(ratio, single_rotor_factor(radius, z), "one rotor, eq. (2)", "single_rotor"),
        "four": Curve(ratio, quad_factor(radius, z, spacing), "four rotors, eq. (3)", "quad"),
        "three": Curve(ratio, three, "three rotors, eq. (3) without one", "three_rotors"),
        "three_lifted": Curve(
            ratio,
            lifted,
            "with two thirds of the body lift, as in the flights",
            "three_rotors",
            "fit",
        ),
        "half": Curve(ratio, half, "eq. (4), $b$ half the diagonal", "model", "fit"),
        "whole": Curve(ratio, whole, "eq. (4), $b$ the diagonal (printed)", "model", "other"),
    }


ONE: tuple[str, str, Role] = ("single", "one rotor", "single_rotor")
SECOND: tuple[str, str, Role] = ("second", "", "second_rig")
THREE: tuple[str, str, Role] = ("three", "three rotors", "three_rotors")
FOUR: tuple[str, str, Role] = ("quad", "quadrotor", "quad")


def _ratio(
    names: Sequence[str], measured: Sequence[tuple[str, str, Role]]
) -> Callable[[Figure, Flies], None]:
    def draw(figure: Figure, flights: Flies) -> None:
        curves = ratio_curves(flights.rig)
        points = measured_points(flights.fits, measured)
        draw_ratio(figure, points, [curves[name] for name in names], "equal_rpm2")

    return draw


def _of_simulated(measured: Sequence[tuple[str, str, Role]]) -> Callable[[Flies], bool]:
    names = {name for name, *_ in measured}
    return lambda flights: is_simulated([fit for key, fit in flights.fits.items() if key in names])


for _name, _title, _curves, _measured in (
    ("fig03-single-rotor", "One rotor of any size (Fig. 3)", ["one"], [ONE, SECOND]),
    (
        "fig04-quad-and-single",
        "A quadrotor against one rotor (Fig. 4)",
        ["one", "four"],
        [ONE, FOUR],
    ),
    (
        "fig06-body-lift",
        "A quadrotor with body lift (Fig. 6)",
        ["one", "four", "half", "whole"],
        [ONE, FOUR],
    ),
    (
        "fig08-three-rotors",
        "Three rotors of a quadrotor (Fig. 8)",
        ["one", "three", "three_lifted"],
        [THREE],
    ),
):
    figure(
        page="paper",
        name=_name,
        title=f"{_title} – model curves",
        caption=(
            "The closed formulae with the rig's own lengths; nothing is fitted. Points are the "
            "runs of recipes, where some were given."
        ),
        simulated=_of_simulated(_measured),
    )(_ratio(_curves, _measured))


@figure(
    page="paper",
    name="fig09-attitude",
    title="{0.rig.name}: ground effect turns a tilted vehicle back (Fig. 9)",
    caption=(
        "Restoring moment about the centre against tilt, with T = m g/4 of each rotor, under each "
        "reading of the formulae; the first is the method of images."
    ),
    simulated=True,
    height_in=7.6,
    width_in=3.6 * (len(READINGS) + 1) / 2,
)
def attitude(figure: Figure, flights: Flies) -> None:
    """Draw figure 9: a sketch, then the moment against tilt for each reading, on one scale."""
    rig, heights = flights.rig, np.array([1.0, 1.5, 2.0, 3.0, 5.0])
    tilt_deg = np.linspace(0.0, 10.0, 41)
    moments_mNm = [
        1e3 * restoring_moment_Nm(rig, heights, np.radians(tilt_deg), name) for name in READINGS
    ]
    axes = figure.subplots(2, (1 + len(READINGS)) // 2).ravel()
    draw_tilted(axes[0], rig, 0.24, np.radians(10.0))
    for panel, reading, moments in zip(axes[1:], READINGS.values(), moments_mNm, strict=True):
        for height, moment, color in zip(heights, moments, CYCLE, strict=False):
            panel.plot(tilt_deg, moment, color=color, label=f"$z/R$ = {height:g}")
        panel.axhline(
            1e3 * level_moment_Nm(rig, 1), color=GREY, linestyle=DASHED, lw=1.1,
            label="level, one covered\nrotor at $z/R$ = 2",
        )  # fmt: skip
        panel.set_title(reading.title)
        panel.set_xlabel("tilt [deg]")
        panel.set_ylim(0.0, 1.05 * max(float(each.max()) for each in moments_mNm))
        panel.set_xlim(0.0, float(tilt_deg[-1]))
        panel.set_ylabel("restoring moment [mN m]")
    axes[1].legend(loc="upper left")
    whole_mNm = 1e3 * hover_authority_Nm(rig)
    share = axes[-1].secondary_yaxis(
        "right", functions=(lambda m: 100.0 * m / whole_mNm, lambda p: p * whole_mNm / 100.0)
    )
    share.set_ylabel("per cent of hover authority")


def level_moment_Nm(rig: Rig, covered: int) -> float:
    """Return the moment of a level plus quadrotor with its front discs wholly covered (section 3).

    One is the front alone, three the front and both sides; the surface is at z/R = 2.
    """
    model = FlightVehicle.of_rig(rig).model
    x_m = rig.disc_positions_m[:, 0]
    front = np.argsort(-x_m, kind="stable")[:covered]
    conditions = Conditions.of(
        rig,
        speed_rad_s=np.ones(rig.n_rotors),
        plate_z_m=np.array([2.0 * rig.propulsion.radius_m]),
        coverage=np.isin(np.arange(rig.n_discs), front).astype(float)[:, None],
    )
    values = model.parameters.values_array()
    factors = np.ravel(model.disc_factors(model.flow(conditions, values), values))
    return float(rig.body.mass_kg * GRAVITY_M_S2 / rig.n_discs * x_m @ (factors - 1.0))


FIELDS = {
    "sources and images (the model behind eq. 2 to 4)": source_velocity,
    "vortex rings and images: prescribed wake, not CFD": vortex_velocity,
}

REACH_R, TOP_R = 4.0, 2.6
"""Extent of the picture along the diagonal, to either side, and in height."""

HEIGHTS_R = (0.25, 0.5, 1.0, 1.5, 1.75, 2.0)
"""Heights of the centre-line table."""


def centre_line(hover: Hover, height_R: Array, field: Callable[..., Array]) -> Array:
    """Return the upward velocity on the axis of the body (n,), in v_h."""
    zero = np.zeros_like(height_R)
    upward: Array = field(hover, np.array([zero, zero, height_R]))[2]
    return upward


def centre_line_lines(hover: Hover) -> list[str]:
    """Return the centre-line table of both fields, in v_h."""
    heights = np.array([h for h in HEIGHTS_R if h <= hover.height])
    lines = ["height/R            " + "".join(f"{h:>8.2f}" for h in heights)]
    for name, field in zip(("sources + images", "vortex rings"), FIELDS.values(), strict=True):
        values = centre_line(hover, heights, field)
        lines.append(f"{name:<20}" + "".join(f"{v:>+8.3f}" for v in values))
    return lines


@figure(
    page="paper.flow",
    name="fig05-flow",
    title="Flow below a quadrotor at z/R = {0.height:g}, diagonal plane (Fig. 5)",
    caption="Streamlines over vertical velocity, and the velocity between the rotors.",
    simulated=True,
    height_in=7.4,
    width_in=9.4,
)
def flow(figure: Figure, hover: Hover) -> None:
    """Draw streamlines over vertical velocity of each field, and both centre lines."""
    parts: Any = figure.subfigures(2, 1, height_ratios=[1.55, 1.0])
    upper, lower = parts
    along, height = np.linspace(-REACH_R, REACH_R, 161), np.linspace(0.0, TOP_R, 66)
    s, z = np.meshgrid(along, height)
    axes: Sequence[Axes] = upper.subplots(len(FIELDS), 1, sharex=True)
    shading: Any = None
    for each, (label, field) in zip(axes, FIELDS.items(), strict=True):
        velocity = field(hover, np.array([s / sqrt(2.0), s / sqrt(2.0), z]))
        shading = each.pcolormesh(
            along, height, velocity[2], cmap="RdBu_r", shading="gouraud",
            norm=TwoSlopeNorm(0.0, -1.3, 0.65), rasterized=True,
        )  # fmt: skip
        each.streamplot(
            along, height, (velocity[0] + velocity[1]) / sqrt(2.0), velocity[2], color=BLACK,
            linewidth=0.65, density=(1.8, 1.0), arrowsize=0.7, broken_streamlines=True,
        )  # fmt: skip
        rotor_at = float(np.hypot(*hover.places[0]))
        for side in (-rotor_at, rotor_at):
            each.plot([side - 1.0, side + 1.0], [hover.height] * 2, color=BLACK, linewidth=3.2)
        body = Rectangle((-0.5, hover.height - 0.12), 1.0, 0.24, facecolor=GREY, edgecolor="white")
        each.add_patch(body)
        each.axhline(0.0, color=BLACK, linewidth=3.0)
        each.set_title(label)
        each.set_ylabel("height / $R$")
        each.set_ylim(0.0, TOP_R)
        each.set_xlim(-REACH_R, REACH_R)
        each.grid(False)
    axes[-1].set_xlabel("along the diagonal / $R$")
    bar = upper.colorbar(shading, ax=axes, shrink=0.8, pad=0.01)
    bar.set_label("upward velocity / $v_h$")
    _centre_lines(lower.subplots(), hover, height)


def _centre_lines(axes: Axes, hover: Hover, height: Array) -> None:
    below = height[height <= hover.height + 1e-9]
    for (label, field), color in zip(FIELDS.items(), (BLUE, VERMILION), strict=True):
        axes.plot(below, centre_line(hover, below, field), color=color, label=label)
    axes.axhline(0.0, color=GREY, linewidth=0.9)
    axes.set_xlabel("height on the centre line / $R$")
    axes.set_ylabel("upward velocity / $v_h$")
    axes.set_title("Between the rotors: only the vortex rings show the fountain")
    axes.legend(loc="center")


FLOW = Page("paper.flow", [("The flow below a quadrotor", ["fig05-flow"])])
