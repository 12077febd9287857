"""Flights and bench runs of the paper's figures 12 to 15, 17, 18, 20 to 24 and 26 to 30.

Run: python docs/examples/paper/flights.py [FOLDER]
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from look import BLUE, DASHED, GREEN, GREY, OVER, VERMILION, new_figure, retitled, save
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import benchtool as bt

OBSTACLE_X_M = (3.0, 5.0)
GYRO_NOISE_RAD_S = 0.015  # section 3.2
UNTIL_S = 60.0  # end of the figures' time axis: afterwards nothing new happens
FOCUS_M = {"edge": (2.1, 3.5)}  # limits of the position axis
CASES = {"over": "flying over the obstacle", "edge": "hovering at its edge"}
CONTROLLERS = {"pid": "PID", "observer": "PID + observer", "feedforward": "PID + feedforward"}
SLOW_INTEGRAL = {"gains.attitude.k_i_theta_per_s2": 0.5}

STICTION = (
    "Steps and flat lines: dry friction in the hinge, 1/5 of the plate's moment, holds the\n"
    "vehicle still; the wakes' random torque, 1/20, does not move it alone."
)


@cache
def shipped(case: str, z_over_R: float, speed_m_s: float, gains: str) -> Any:
    """Return a shipped flight under PID, out of ground effect and in it."""
    return bt.simulate_flight(
        ("pid",), case=case, z_over_r=z_over_R, speed_m_s=speed_m_s, gains=(gains,)
    ).found


def fly(
    name: str,
    control: str = "pid",
    z_over_R: float | None = 2.0,
    speed_m_s: float = 0.2,
    gains: str = "s3",
    **changes: Any,
) -> Any:
    """Return a shipped flight with fields of its case changed; z/R None is over nothing."""
    free, near = shipped(name, z_over_R or 2.0, speed_m_s, gains)
    flown = free if z_over_R is None else near
    if control == "pid" and not changes:
        return flown
    return bt.fly(replace(flown.case, control=control, **changes))


def arrival(flown: Any) -> str:
    """Return when a flight arrived, or what happened in its place."""
    measures = flown.measures
    if measures.ending == "struck":
        return "strikes the obstacle"
    if measures.arrives:
        return f"{measures.arrives_s:.1f} s"
    return f"never, x {measures.range_m[0]:.2f} to {measures.range_m[1]:.2f} m"


def draw_flights(
    title: str, flights: Mapping[str, Any], free: Any = None, focus_m: Any = None
) -> Figure:
    """Draw flights side by side: position above, pitch below; grey is PID over nothing."""
    count = len(flights)
    figure = new_figure(title, 7.0 if count < 3 else 3.05 * count, 5.3)
    panels = figure.subplots(2, count, sharex="col", sharey="row", squeeze=False)
    for (label, flown), (upper, lower) in zip(flights.items(), panels.T, strict=True):
        flight = flown.flight
        time_s, covered = flight["time_s"], flight["coverage1"] > 1e-3
        for disc in range(2, 5):
            covered = covered | (flight[f"coverage{disc}"] > 1e-3)
        for axes in (upper, lower):
            bands = {"color": OVER, "lw": 0, "label": "a rotor is over the obstacle"}
            axes.fill_between(
                time_s, 0, 1, where=covered, transform=axes.get_xaxis_transform(), **bands
            )
        if free is not None:
            upper.plot(free.flight["time_s"], free.flight["x_m"], color=GREY, lw=1.3)
            grey_deg = np.degrees(free.flight["pitch_rad"])
            label_free = "PID, out of ground effect"
            lower.plot(free.flight["time_s"], grey_deg, color=GREY, lw=1.1, label=label_free)
        for edge_m in OBSTACLE_X_M:
            if edge_m <= float(flight["x_m"].max()) + 0.5:
                upper.axhline(edge_m, color=GREEN, lw=0.9, ls=":")
        upper.axhline(flown.case.goals[-1].x_m, color=GREY, lw=1.1, ls=DASHED)
        upper.plot(time_s, flight["x_m"], color=BLUE)
        wanted_deg = np.degrees(flight["pitch_ref_rad"])
        lower.plot(time_s, wanted_deg, color=VERMILION, lw=0.9, label="pitch command")
        lower.plot(time_s, np.degrees(flight["pitch_rad"]), color=BLUE, lw=1.3, label="flight")
        if flown.measures.ending != "flown":
            upper.plot(time_s[-1], flight["x_m"][-1], "X", color=VERMILION, ms=9)
        upper.set_title(f"{label}\narrival: {arrival(flown)}", linespacing=1.35)
        lower.set(xlabel="time [s]", xlim=(0.0, UNTIL_S))
    panels[0][0].set_ylabel("position $x$ [m]")
    panels[1][0].set_ylabel("pitch, nose down [deg]")
    if focus_m is not None:
        panels[0][0].set_ylim(*focus_m)
    figure.legend(*panels[1][0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def heights(number: int, control: str, case: str) -> Figure:
    """Draw one controller far from the obstacle and at two heights over it."""
    flights = {
        "out of ground effect": fly(case, control, None),
        "z/R = 3": fly(case, control, 3.0),
        "z/R = 2": fly(case, control),
    }
    title = f"{CONTROLLERS[control]}: {CASES[case]}, 0.2 m/s (Fig. {number})"
    free = None if control == "pid" else fly(case, "pid", None)
    return draw_flights(title, flights, free, FOCUS_M.get(case))


def fast() -> Figure:
    """Draw figure 14: five times as fast, both cases under PID."""
    flights = {
        "(a) hovering at the edge": fly("edge", speed_m_s=1.0),
        "(b) flying over the obstacle": fly("over", speed_m_s=1.0),
    }
    return draw_flights("PID at 1 m/s, z/R = 2 (Fig. 14)", flights)


def noise() -> Figure:
    """Draw figure 15: the oscillation at the edge does not come from the sensors' noise."""
    flights = {
        "without noise": fly("edge", speed_m_s=1.0),
        "with noise": fly("edge", speed_m_s=1.0, gyro_noise_rad_s=GYRO_NOISE_RAD_S),
    }
    title = "PID with gyro noise of 0.015 rad/s, 1 m/s, z/R = 2: no wider than without (Fig. 15)"
    return draw_flights(title, flights, focus_m=FOCUS_M["edge"])


def early(offset_m: float) -> Any:
    """Fly to the edge with a feedforward map that has the edge too early."""
    return fly("edge", "feedforward", map_offset_m=(-offset_m, 0.0, 0.0))


def map_errors() -> Figure:
    """Draw figure 22: how far a map may be off before feedforward does harm."""
    flights = {
        "true map": fly("edge", "feedforward"),
        "(a) 5 cm early": early(0.05),
        "(b) 15 cm early": early(0.15),
    }
    title = "Feedforward with a map that has the edge too early, z/R = 2 (Fig. 22)"
    return draw_flights(title, flights, focus_m=FOCUS_M["edge"])


def compared(title: str, case: str) -> Figure:
    """Draw a case under each controller."""
    study = bt.simulate_flight(tuple(CONTROLLERS), case=case)
    return retitled(study.plot("flight"), title or f"{study.found[1].case.title}, z/R = 2")


def bench(title: str, *controllers: str, **options: Any) -> Figure:
    """Draw the pitch bench under these controllers."""
    figure = retitled(bt.simulate_pitch(controllers, gains=("s3",), **options).plot("pitch"), title)
    figure.axes[-1].set_xlabel(f"{figure.axes[-1].get_xlabel()}\n{STICTION}")
    return figure


def draw_pitch(axes: Axes, title: str, time_s: Any, pitch: Any, reference: Any, over: Any) -> None:
    """Draw pitch and its reference (rad) while a plate comes and goes."""
    style = {"color": OVER, "lw": 0, "transform": axes.get_xaxis_transform()}
    axes.fill_between(time_s, 0, 1, where=over, **style)
    axes.plot(time_s, np.degrees(reference), color=GREY, lw=1.0, ls="--", label="reference")
    axes.plot(time_s, np.degrees(pitch), color=VERMILION, lw=1.2, label="pitch")
    axes.set(title=title, ylabel="pitch [deg]\n(nose down +)")


def plate_in_flight() -> Figure:
    """Draw figure 30: a plate under the front rotor, in free hover and on the hinge."""
    figure = new_figure("A plate under one rotor: free and hinged (Fig. 30)", 7.0, 7.2)
    panels = figure.subplots(4, 1, sharex=True, sharey=True)
    for axes, control in zip(panels, ("pid", "observer"), strict=False):
        hover, title = fly("plate", control).flight, f"free hover, {CONTROLLERS[control]}"
        over = hover["coverage1"] > 1e-3
        pitch, reference = hover["pitch_rad"], hover["pitch_ref_rad"]
        draw_pitch(axes, f"{title}: the vehicle may drift", hover["time_s"], pitch, reference, over)
    for axes, title, settings in (
        (panels[2], "PID", {}),
        (panels[3], "PID with a slow integral", SLOW_INTEGRAL),
    ):
        (run,) = bt.simulate_pitch(("pid",), gains=("s3",), set=settings).found.runs
        pitch, reference = run.column("true_theta_rad"), run.column("reference_rad")
        title, over = f"on the hinge with its friction, {title}", run.column("plate_share") > 0.0
        draw_pitch(axes, title, run.time_s, pitch, reference, over)
    panels[0].legend(loc="upper right", ncols=2)
    panels[-1].set_xlabel(f"time [s]    (green: a rotor is over the plate)\n{STICTION}")
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    "fig12-pid-over": lambda: heights(12, "pid", "over"),
    "fig13-pid-edge": lambda: heights(13, "pid", "edge"),
    "fig14-pid-1-m-s": fast,
    "fig15-pid-noise": noise,
    "fig17-observer-over": lambda: heights(17, "observer", "over"),
    "fig18-observer-edge": lambda: heights(18, "observer", "edge"),
    "fig20-feedforward-over": lambda: heights(20, "feedforward", "over"),
    "fig21-feedforward-edge": lambda: heights(21, "feedforward", "edge"),
    "fig22-map-errors": map_errors,
    "fig23-comparison-over": lambda: compared(
        "Controllers compared: flying over the obstacle, z/R = 2 (Fig. 23)", "over"
    ),
    "fig24-comparison-edge": lambda: compared(
        "Controllers compared: hovering at its edge, z/R = 2 (Fig. 24)", "edge"
    ),
    "fig26a-bench-pquad": lambda: bench(
        "pquad: plate under one rotor, PID + integral (Fig. 26a)", "pid", set=SLOW_INTEGRAL
    ),
    "fig26b-bench-amuse": lambda: bench(
        "amuse: plate under one rotor, PID + integral (Fig. 26b)",
        "pid",
        rig="amuse",
        set=SLOW_INTEGRAL,
    ),
    "fig27-bench-feedforward": lambda: bench(
        "Bench: PID without and with feedforward (Fig. 27)", "pid", "feedforward"
    ),
    "fig27-bench-switched": lambda: bench(
        "Bench: feedforward switched on at 20 s (Fig. 27)", "feedforward", schedule="switch"
    ),
    "fig28-bench-observer": lambda: bench(
        "Bench: PID without and with observer (Fig. 28)", "pid", "observer"
    ),
    "fig30-plate-in-flight": plate_in_flight,
    "extra-oblique": lambda: compared("", "oblique"),
    "extra-corner": lambda: compared("", "corner"),
    "extra-gust": lambda: compared("", "gust"),
    "extra-ramp": lambda: compared("", "ramp"),
}
"""The extra cases are those that the paper's planar picture leaves out."""

if __name__ == "__main__":
    save(FIGURES)
