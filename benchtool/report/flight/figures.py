"""The flights of the paper's figures 12 to 15, 17, 18, 20 to 24 and 30, as simulated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchtool.commands.paper.claims import Flights
from benchtool.report.files import Figure
from benchtool.report.flight.flight import FlightTrace, flight_figure
from benchtool.report.flight.pitch import PitchTrace, pitch_figure
from benchtool.report.flight.pitch_study import PitchStudy, pitch_study
from benchtool.report.flight.study import CONTROL_NAMES, Flown, trace_of
from benchtool.report.flight.table import GYRO_NOISE_RAD_S
from benchtool.simulate.flight.cases import OBSTACLE_X_M
from benchtool.simulate.pitch.setup import changed, pitch_setup

OVER_UNTIL_S, EDGE_UNTIL_S = 60.0, 60.0
"""What is drawn of the flights: afterwards nothing new happens."""

OFF = "out of ground effect"


def flight_figures(flights: Flights) -> dict[str, Figure]:
    """Return the figures by file name."""

    def over(title: str, *columns: tuple[str, Flown], beside: Flown | None = None) -> Figure:
        return _figure(title, columns, beside, OVER_UNTIL_S)

    def edge(title: str, *columns: tuple[str, Flown], beside: Flown | None = None) -> Figure:
        return _figure(title, columns, beside, EDGE_UNTIL_S, (2.1, 3.5))

    fly = flights.fly
    free, edge_free = fly("over", "pid", None), fly("edge", "pid", None)
    out: dict[str, Figure] = {}
    for number, control, case in (
        (12, "pid", "over"),
        (13, "pid", "edge"),
        (17, "observer", "over"),
        (18, "observer", "edge"),
        (20, "feedforward", "over"),
        (21, "feedforward", "edge"),
    ):
        draw, grey = (over, free) if case == "over" else (edge, edge_free)
        what = "flying over the obstacle" if case == "over" else "hovering at its edge"
        out[f"fig{number}-{control}-{case}"] = draw(
            f"{CONTROL_NAMES[control]}: {what}, 0.2 m/s (Fig. {number})",
            (OFF, fly(case, control, None)),
            ("z/R = 3", fly(case, control, 3.0)),
            ("z/R = 2", fly(case, control, 2.0)),
            beside=grey if control != "pid" else None,
        )
    out["fig14-pid-1-m-s"] = flight_figure(
        [
            trace_of(fly("edge", speed_m_s=1.0), "(a) hovering at the edge"),
            trace_of(fly("over", speed_m_s=1.0), "(b) flying over the obstacle"),
        ],
        title="PID at 1 m/s, z/R = 2 (Fig. 14)",
        beside=None,
        obstacle_m=OBSTACLE_X_M,
        until_s=30.0,
    )
    out["fig15-pid-noise"] = edge(
        "PID with gyro noise of 0.015 rad/s, 1 m/s, z/R = 2: no wider than without (Fig. 15)",
        ("without noise", fly("edge", speed_m_s=1.0)),
        ("with noise", fly("edge", speed_m_s=1.0, gyro_noise_rad_s=GYRO_NOISE_RAD_S)),
    )
    out["fig22-map-errors"] = edge(
        "Feedforward with a map that has the edge too early, z/R = 2 (Fig. 22)",
        ("true map", fly("edge", "feedforward")),
        ("(a) 5 cm early", fly("edge", "feedforward", map_offset_m=(-0.05, 0.0, 0.0))),
        ("(b) 15 cm early", fly("edge", "feedforward", map_offset_m=(-0.15, 0.0, 0.0))),
    )
    for number, case in ((23, "over"), (24, "edge")):
        draw, grey = (over, free) if case == "over" else (edge, edge_free)
        what = "flying over the obstacle" if case == "over" else "hovering at its edge"
        out[f"fig{number}-comparison-{case}"] = draw(
            f"Controllers compared: {what}, z/R = 2 (Fig. {number})",
            *((CONTROL_NAMES[c], fly(case, c)) for c in ("pid", "observer", "feedforward")),
            beside=grey,
        )
    out["fig30-plate-in-flight"] = free_and_hinged(flights)
    return out


def extra_figures(flights: Flights) -> dict[str, Figure]:
    """Return the cases that the paper's planar picture leaves out."""
    out = {}
    for case in ("oblique", "corner", "gust", "ramp"):
        columns = [
            (CONTROL_NAMES[c], flights.fly(case, c)) for c in ("pid", "observer", "feedforward")
        ]
        title = flights.fly(case).case.title + ", z/R = 2"
        out[f"extra-{case}"] = _figure(title, columns, None, 60.0, obstacle=False)
    return out


def free_and_hinged(flights: Flights) -> Figure:
    """Draw figure 30: a plate under the front rotor, in free hover and on the hinge."""
    traces = []
    for control, label in (("pid", "PID"), ("observer", "PID + observer")):
        hover = flights.fly("plate", control).flight
        traces.append(
            PitchTrace(
                label=f"free hover, {label}: the vehicle may drift",
                time_s=hover["time_s"],
                pitch_deg=np.degrees(hover["pitch_rad"]),
                reference_deg=0.0 * hover["pitch_rad"],
                covered=(hover["coverage1"] > 1e-3).astype(float),
            )
        )
    names = ("pid", "observer")
    hinged = pitch_study(pitch_setup(gains="s3", controllers=names), 1)
    slow = changed(
        pitch_setup(gains="s3", controllers=("pid",)), {"gains.attitude.k_i_theta_per_s2": 0.5}
    )
    for name, study in (("PID", hinged), ("PID with a slow integral", pitch_study(slow, 1))):
        traces.append(_hinge_trace(study, f"on the hinge with its friction, {name}"))
    return pitch_figure(
        traces, title="A plate under one rotor: free and hinged (Fig. 30)",
        simulated=True,
    )  # fmt: skip


def _hinge_trace(study: PitchStudy, label: str) -> PitchTrace:
    run = study.runs[0]
    return PitchTrace(
        label=label,
        time_s=run.time_s,
        pitch_deg=np.degrees(run.column("true_theta_rad")),
        reference_deg=np.degrees(run.column("reference_rad")),
        covered=run.column("plate_share"),
    )


def _figure(
    title: str,
    columns: Sequence[tuple[str, Flown]],
    beside: Flown | None,
    until_s: float,
    focus_m: tuple[float, float] | None = None,
    obstacle: bool = True,
) -> Figure:
    traces = [trace_of(flown, label) for label, flown in columns]
    grey: FlightTrace | None = None if beside is None else trace_of(beside, f"PID, {OFF}")
    return flight_figure(
        traces,
        title=title,
        beside=grey,
        obstacle_m=OBSTACLE_X_M if obstacle else None,
        focus_m=focus_m,
        until_s=until_s,
    )
