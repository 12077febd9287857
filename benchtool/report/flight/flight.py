"""Flights near an obstacle: position and pitch against time, green where rotors are over it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from benchtool.core.array import Array
from benchtool.report.figure import Page, figure
from benchtool.report.palette import BLUE, GREEN, GREY, VERMILION
from benchtool.report.panels import DASHED, DOTTED, OVER, spans
from benchtool.simulate.flight.study import Flown, name_of, obstacle_extent, verdict


def flights_width(columns: int) -> float:
    """Return the width of flights side by side, inches."""
    return 7.0 if columns < 3 else 3.05 * columns


def draw_flights(
    figure: Figure,
    flights: Mapping[str, Flown],
    *,
    beside: tuple[str, Flown] | None = None,
    obstacle_m: tuple[float, float] | None = None,
    focus_m: tuple[float, float] | None = None,
    until_s: float | None = None,
) -> None:
    """Draw flights side by side: position above, pitch below, on common axes.

    Args:
        figure: empty.
        flights: one column each, under its heading.
        beside: legend and flight out of ground effect, drawn in grey in every column.
        obstacle_m: extent of the obstacle along x, marked at the position's axis.
        focus_m: limits of the position axis.
        until_s: end of the time axis, where all that happens has happened.
    """
    axes = figure.subplots(
        2, len(flights), sharex="col", sharey="row", squeeze=False, height_ratios=[1.15, 1.0]
    )
    last_s = until_s or float(max(flown.flight["time_s"][-1] for flown in flights.values()))
    for column, (label, flown) in enumerate(flights.items()):
        upper, lower = axes[0][column], axes[1][column]
        grey = None if beside is None else beside[1]
        _position(upper, flown, grey, obstacle_m)
        _pitch(lower, flown, grey)
        upper.set_title(f"{label}\n{verdict(flown)}", linespacing=1.35)
        lower.set_xlabel("time [s]")
        lower.set_xlim(0.0, last_s)
    axes[0][0].set_ylabel("position $x$ [m]")
    axes[1][0].set_ylabel("pitch, nose down [deg]")
    if focus_m is not None:
        axes[0][0].set_ylim(*focus_m)
    _legend(figure, None if beside is None else beside[0], obstacle_m is not None)


def _position(
    axes: Axes, flown: Flown, beside: Flown | None, obstacle_m: tuple[float, float] | None
) -> None:
    _shade(axes, flown)
    x_m = flown.flight["x_m"]
    for edge in obstacle_m or ():
        if edge <= float(x_m.max()) + 0.5:
            axes.axhline(edge, color=GREEN, linewidth=0.9, linestyle=DOTTED)
    axes.axhline(flown.case.goals[-1].x_m, color=GREY, linewidth=1.1, linestyle=DASHED)
    if beside is not None:
        axes.plot(beside.flight["time_s"], beside.flight["x_m"], color=GREY, linewidth=1.3)
    axes.plot(flown.flight["time_s"], x_m, color=BLUE)
    _strike(axes, flown, x_m)


def _pitch(axes: Axes, flown: Flown, beside: Flown | None) -> None:
    _shade(axes, flown)
    axes.axhline(0.0, color=GREY, linewidth=0.7)
    if beside is not None:
        grey_deg = np.degrees(beside.flight["pitch_rad"])
        axes.plot(beside.flight["time_s"], grey_deg, color=GREY, linewidth=1.1)
    time_s, pitch_deg = flown.flight["time_s"], np.degrees(flown.flight["pitch_rad"])
    wanted_deg = np.degrees(flown.flight["pitch_ref_rad"])
    axes.plot(time_s, wanted_deg, color=VERMILION, linewidth=0.9, alpha=0.85)
    axes.plot(time_s, pitch_deg, color=BLUE, linewidth=1.3)
    _strike(axes, flown, pitch_deg)


def _strike(axes: Axes, flown: Flown, values: Array) -> None:
    """Mark where a flight that struck something ends."""
    if flown.flight.ending != "flown":
        axes.plot(
            flown.flight["time_s"][-1], values[-1], marker="X", markersize=9, color=VERMILION,
            zorder=5, markeredgecolor="white",
        )  # fmt: skip


def _shade(axes: Axes, flown: Flown) -> None:
    """Colour the background while any rotor is over the obstacle."""
    discs = range(1, flown.case.vehicle.rig.n_discs + 1)
    covered = np.sum([flown.flight[f"coverage{i}"] for i in discs], axis=0)
    for begin, end in spans(flown.flight["time_s"], covered > 1e-3):
        axes.axvspan(begin, end, color=OVER, lw=0, zorder=0.1)


def _legend(figure: Figure, beside: str | None, obstacle: bool) -> None:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=BLUE, label="flight"),
        Line2D([], [], color=VERMILION, linewidth=1.0, label="pitch command"),
        Line2D([], [], color=GREY, linestyle=DASHED, linewidth=1.1, label="goal"),
    ]
    if beside is not None:
        handles.insert(1, Line2D([], [], color=GREY, linewidth=1.3, label=beside))
    if obstacle:
        handles.append(Line2D([], [], color=GREEN, linestyle=DOTTED, label="obstacle's edges"))
    handles.append(Patch(color=OVER, label="a rotor is over the obstacle"))
    one_row = len(handles) <= 5 and figure.get_figwidth() > 7.5
    figure.legend(handles=handles, loc="outside lower center", ncols=5 if one_row else 3)


def _title(flights: Sequence[Flown]) -> str:
    case = flights[1].case
    height = case.start_m[2] / case.vehicle.rig.propulsion.radius_m
    return f"{case.title}, z/R = {height:.3g}, gains {case.gains.name}"


@figure(
    page="flight",
    name="flight",
    title=_title,
    caption="Position and pitch under each controller; grey: the same flight with PID out of "
    "ground effect; green: a rotor is over the obstacle.",
    simulated=True,
    height_in=5.3,
    width_in=lambda flights: flights_width(len(flights) - 1),
)
def flight(figure: Figure, flights: Sequence[Flown]) -> None:
    """Draw a case under each controller; the first flight is the one out of ground effect."""
    free, *others = flights
    draw_flights(
        figure,
        {name_of(flown): flown for flown in others},
        beside=("PID out of ground effect", free),
        obstacle_m=obstacle_extent(others[0].case),
    )


FLIGHT = Page("flight", [("The flight", ["flight"])])
