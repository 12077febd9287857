"""All the paper's figures that can be simulated, computed or drawn, by file name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import sqrt

import numpy as np

from benchtool.commands.paper.claims import Flights
from benchtool.core.rig import Rig
from benchtool.physics.body_lift import quad_body_lift_factor
from benchtool.physics.images import quad_factor, single_rotor_factor
from benchtool.physics.multirotor import three_rotor_average_factor
from benchtool.report.attitude_study import attitude_moments
from benchtool.report.blocks import Box, Wire, block_figure
from benchtool.report.files import Figure
from benchtool.report.flight.figures import extra_figures, flight_figures
from benchtool.report.flight.pitch_study import pitch_study, study_figure
from benchtool.report.flow_study import flow_pictures
from benchtool.report.geometry import (
    Sketch,
    cases_figure,
    map_figure,
    partial_effect_figure,
    plate_figure,
)
from benchtool.report.sweep.ground_effect import Curve, ratio_figure
from benchtool.simulate.flight.cases import (
    GOAL_EDGE_M,
    GOAL_OVER_M,
    OBSTACLE_X_M,
    plate_under_front,
)
from benchtool.simulate.pitch.setup import PitchSetup, changed, pitch_setup

K_B = 2.0
"""Body lift coefficient of the paper's figure 6."""


def paper_figures(flights: Flights) -> Iterator[tuple[str, Figure]]:
    """Give every figure with its file name, in the paper's order."""
    yield from ratio_figures(flights.rig).items()
    yield "fig05-flow", flow_pictures()
    yield from geometry_figures(flights.rig).items()
    yield "fig09-attitude", attitude_moments(flights.rig)
    yield from flight_figures(flights).items()
    yield from block_figures().items()
    yield from bench_figures().items()
    yield from extra_figures(flights).items()


def ratio_figures(rig: Rig) -> dict[str, Figure]:
    """Draw figures 3, 4, 6 and 8 as model curves: the measured points are not public."""
    radius = rig.propulsion.radius_m
    spacing = float(sorted(set(rig.disc_distances_m[0].round(9)))[1])
    ratio = np.linspace(0.5, 6.0, 221)
    z = ratio * radius
    half = quad_body_lift_factor(radius, z, spacing, spacing / sqrt(2.0), K_B)
    whole = quad_body_lift_factor(radius, z, spacing, spacing * sqrt(2.0), K_B)
    one = Curve(ratio, single_rotor_factor(radius, z), "one rotor, eq. (2)", "single_rotor")
    four = Curve(ratio, quad_factor(radius, z, spacing), "four rotors, eq. (3)", "quad")
    some = Curve(
        ratio, three_rotor_average_factor(radius, z, spacing), "three rotors", "three_rotors"
    )
    lifted = Curve(ratio, half, "eq. (4), $b$ half the diagonal", "body_lift", "fit")
    printed = Curve(ratio, whole, "eq. (4), $b$ the diagonal (printed)", "body_lift", "other")

    def draw(title: str, *curves: Curve) -> Figure:
        return ratio_figure(
            (), curves, title=title + " – model curves", simulated=False, basis="equal_rpm2"
        )

    return {
        "fig03-single-rotor": draw("One rotor of any size (Fig. 3)", one),
        "fig04-quad-and-single": draw("A quadrotor against one rotor (Fig. 4)", one, four),
        "fig06-body-lift": draw("A quadrotor with body lift (Fig. 6)", one, four, lifted, printed),
        "fig08-three-rotors": draw("Three rotors of a quadrotor (Fig. 8)", one, some),
    }


def geometry_figures(rig: Rig) -> dict[str, Figure]:
    """Draw figures 7, 10, 11, and the set-up of figure 29."""
    sketch = Sketch(
        rotors_m=rig.disc_positions_m,
        names=tuple(rotor.name for rotor in rig.rotors[: rig.n_discs]),
        radius_m=rig.propulsion.radius_m,
        obstacle_m=OBSTACLE_X_M,
    )
    z_m = 2.0 * rig.propulsion.radius_m
    x, y = np.linspace(-1.0, 8.0, 181), np.linspace(-1.5, 1.5, 61)
    over = (x[:, None] >= OBSTACLE_X_M[0]) & (x[:, None] <= OBSTACLE_X_M[1])
    height = np.where(over, 0.0, -0.6) + 0.0 * y
    path = np.array([[0.0, 0.0, z_m], [GOAL_OVER_M, 0.0, z_m]])
    radius, arm = rig.propulsion.radius_m, float(rig.disc_positions_m[:, 0].max())
    plate = plate_under_front(radius, arm).blocks[0]
    comes, come, goes, gone = plate.times_s
    return {
        "fig07-partial-effect": partial_effect_figure(
            sketch, x_m=GOAL_EDGE_M, z_m=z_m, title="One rotor over the obstacle (Fig. 7)"
        ),
        "fig10-map": map_figure(
            x, y, height, path_m=path, title="The environment map of the flights (Fig. 10)"
        ),
        "fig11-cases": cases_figure(
            sketch,
            goals_m=[
                ("case 1: flying over the obstacle", GOAL_OVER_M),
                ("case 2: hovering with one rotor over the edge", GOAL_EDGE_M),
            ],
            z_m=z_m,
            title="The two cases, z/R = 2 (Fig. 11)",
        ),
        "fig29-plate-set-up": plate_figure(
            replace(sketch, obstacle_m=plate.x_m),
            half_width_m=plate.y_m[1],
            away_m=plate.slide_m[0],
            z_m=z_m,
            when=(f"comes at {comes:g} to {come:g} s", f"goes at {goes:g} to {gone:g} s"),
            title="Free hover with a plate moved under one rotor and withdrawn (Fig. 29)",
        ),
    }


def block_figures() -> dict[str, Figure]:
    """Draw figures 16 and 19: what each strategy adds to the cascade."""
    y = 0.0
    chain = [
        Box(name="position", text="position and\nvelocity loops", x=0.0, y=y),
        Box(name="attitude", text="attitude and\nrate loops", x=2.3, y=y),
        Box(name="mixer", text="mixer\neq. (9)", x=5.3, y=y, width=1.2),
        Box(name="vehicle", text="rotors and\nvehicle", x=8.6, y=y, kind="plant"),
    ]
    back = (
        Wire(points=((-1.6, y), (-0.75, y)), label="goal"),
        Wire(points=((0.75, y), (1.55, y)), label="pitch"),
        Wire(points=((9.35, y), (10.2, y)), label="$q,\\ \\dot q$"),
        Wire(points=((9.8, y), (9.8, -2.1), (0.0, -2.1), (0.0, -0.34))),
        Wire(points=((2.3, -2.1), (2.3, -0.34))),
        Wire(points=((8.6, 1.05), (8.6, 0.34)), label=""),
    )
    seen = [
        *chain,
        Box(name="observer", text="torque observer\neq. (12), momentum form", x=5.3, y=-1.15,
            width=2.5, kind="added"),
        Box(name="ge", text="ground effect $F_{GE}$", x=8.6, y=1.35, kind="plant", width=1.9),
        Box(name="sum", text="−", x=3.75, y=y, width=0.4, kind="added"),
    ]  # fmt: skip
    observer = (
        *back,
        Wire(points=((3.05, y), (3.55, y))),
        Wire(points=((3.95, y), (4.7, y)), label="torque"),
        Wire(points=((5.9, y), (7.85, y)), label="rotor speeds"),
        Wire(points=((4.3, y), (4.3, -0.81)), added=True),
        Wire(points=((9.8, -1.15), (6.55, -1.15)), label="rates", added=True),
        Wire(points=((4.05, -1.15), (3.75, -1.15), (3.75, -0.34)), label="", added=True),
    )
    fed = [
        *chain,
        Box(name="ge", text="ground effect $f_{GE}$", x=8.6, y=1.35, kind="plant", width=1.9),
        Box(name="divide", text="divide by\n$\\hat f_{GE}$", x=7.0, y=y, width=1.0, kind="added"),
        Box(name="model", text="model of the effect\neq. (2) to (4), areas", x=7.0, y=-1.15,
            width=2.1, kind="added"),
        Box(name="map", text="map of what lies\nunder each rotor", x=4.1, y=-1.15, width=2.1,
            kind="added"),
    ]  # fmt: skip
    feedforward = (
        *back,
        Wire(points=((3.05, y), (4.7, y)), label="torque"),
        Wire(points=((5.9, y), (6.5, y))),
        Wire(points=((7.5, y), (7.85, y))),
        Wire(points=((5.15, -1.15), (5.95, -1.15)), label="heights", added=True),
        Wire(points=((7.0, -0.81), (7.0, -0.34)), added=True),
        Wire(points=((4.1, -2.1), (4.1, -1.49)), added=True),
    )
    return {
        "fig16-observer-scheme": block_figure(
            seen, observer, title="Estimated torque controller (Fig. 16)"
        ),
        "fig19-feedforward-scheme": block_figure(
            fed, feedforward, title="Feedforward controller (Fig. 19)"
        ),
    }


def bench_figures() -> dict[str, Figure]:
    """Draw figures 26 to 28 on the simulated pitch bench."""
    slow = {"gains.attitude.k_i_theta_per_s2": 0.5}
    out = {}

    def draw(setup: PitchSetup, title: str) -> Figure:
        figure = study_figure(pitch_study(setup, 1))
        figure.suptitle(title, x=0.012, ha="left", fontsize=11.5, fontweight="bold")
        return figure

    for letter, rig in (("a", "pquad"), ("b", "amuse")):
        setup = changed(pitch_setup(rig=rig, gains="s3", controllers=("pid",)), slow)
        out[f"fig26{letter}-bench-{rig}"] = draw(
            setup, f"{rig}: plate under one rotor, PID + integral (Fig. 26{letter})"
        )
    forward = pitch_setup(gains="s3", controllers=("pid", "feedforward"))
    out["fig27-bench-feedforward"] = draw(
        forward, "Bench: PID without and with feedforward (Fig. 27)"
    )
    switched = pitch_setup(gains="s3", controllers=("feedforward",), schedule="switch")
    out["fig27-bench-switched"] = draw(switched, "Bench: feedforward switched on at 20 s (Fig. 27)")
    seen = pitch_setup(gains="s3", controllers=("pid", "observer"))
    out["fig28-bench-observer"] = draw(seen, "Bench: PID without and with observer (Fig. 28)")
    return out
