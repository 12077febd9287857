"""Flights near an obstacle: position and pitch against time, green where rotors are over it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.report.fit.lengths import refuse_unequal
from benchtool.report.palette import BLUE, GREEN, GREY, VERMILION
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]

OVER = "#bfe3c8"
"""Background while any rotor is over the obstacle."""


@dataclass(frozen=True, slots=True, eq=False)
class FlightTrace:
    """Hold one flight for drawing.

    Attributes:
        label: heading of its column ("PID, z/R = 2").
        time_s, x_m, pitch_deg, pitch_ref_deg: (m,) each.
        covered: (m,) how many discs' worth of area lie over the obstacle.
        goal_m: where it should go.
        verdict: one line that says what happened.
        ended: False when it was cut short (it struck something).
    """

    label: str
    time_s: Array
    x_m: Array
    pitch_deg: Array
    pitch_ref_deg: Array
    covered: Array
    goal_m: float
    verdict: str = ""
    ended: bool = True

    def __post_init__(self) -> None:
        refuse_unequal(
            f"the flight {self.label!r}",
            time_s=self.time_s,
            x_m=self.x_m,
            pitch_deg=self.pitch_deg,
            pitch_ref_deg=self.pitch_ref_deg,
            covered=self.covered,
        )


@styled
def flight_figure(
    traces: Sequence[FlightTrace],
    *,
    title: str,
    beside: FlightTrace | None = None,
    obstacle_m: tuple[float, float] | None = None,
    focus_m: tuple[float, float] | None = None,
    pitch_limit_deg: float | None = None,
    until_s: float | None = None,
) -> Figure:
    """Draw flights side by side: position above, pitch below, on common axes.

    Args:
        traces: one column each.
        title: one line that says what is to be seen.
        beside: a flight out of ground effect, drawn in grey in every column.
        obstacle_m: extent of the obstacle along x, marked at the position's axis.
        focus_m: limits of the position axis.
        pitch_limit_deg: limit of the pitch axis, for flights that strike something.
        until_s: end of the time axis, where all that happens has happened.
    """
    if not traces:
        raise InputError("a flight figure needs a flight; give one or more traces")
    columns = len(traces)
    width = 7.0 if columns < 3 else 3.05 * columns
    figure = new_figure(title, simulated=True, height_in=5.3, width_in=width)
    axes = figure.subplots(
        2, columns, sharex="col", sharey="row", squeeze=False, height_ratios=[1.15, 1.0]
    )
    for column, trace in enumerate(traces):
        upper, lower = axes[0][column], axes[1][column]
        _position(upper, trace, beside, obstacle_m)
        _pitch(lower, trace, beside)
        upper.set_title(
            trace.label + (f"\n{trace.verdict}" if trace.verdict else ""), linespacing=1.35
        )
        lower.set_xlabel("time [s]")
        lower.set_xlim(0.0, until_s or float(max(item.time_s[-1] for item in traces)))
    axes[0][0].set_ylabel("position $x$ [m]")
    axes[1][0].set_ylabel("pitch, nose down [deg]")
    if focus_m is not None:
        axes[0][0].set_ylim(*focus_m)
    if pitch_limit_deg is not None:
        axes[1][0].set_ylim(-pitch_limit_deg, pitch_limit_deg)
    _legend(figure, beside, obstacle_m is not None)
    return figure


def _position(
    axes: Axes, trace: FlightTrace, beside: FlightTrace | None, obstacle: tuple[float, float] | None
) -> None:
    shade(axes, trace)
    if obstacle is not None:
        for edge in obstacle:
            if edge > float(trace.x_m.max()) + 0.5:
                continue
            axes.axhline(edge, color=GREEN, linewidth=0.9, linestyle=(0, (1.5, 1.5)))
    axes.axhline(trace.goal_m, color=GREY, linewidth=1.1, linestyle=(0, (5, 2.2)))
    if beside is not None:
        axes.plot(beside.time_s, beside.x_m, color=GREY, linewidth=1.3)
    axes.plot(trace.time_s, trace.x_m, color=BLUE)
    _strike(axes, trace, trace.x_m)


def _pitch(axes: Axes, trace: FlightTrace, beside: FlightTrace | None) -> None:
    shade(axes, trace)
    axes.axhline(0.0, color=GREY, linewidth=0.7)
    if beside is not None:
        axes.plot(beside.time_s, beside.pitch_deg, color=GREY, linewidth=1.1)
    axes.plot(trace.time_s, trace.pitch_ref_deg, color=VERMILION, linewidth=0.9, alpha=0.85)
    axes.plot(trace.time_s, trace.pitch_deg, color=BLUE, linewidth=1.3)
    _strike(axes, trace, trace.pitch_deg)


def _strike(axes: Axes, trace: FlightTrace, values: Array) -> None:
    if not trace.ended:
        axes.plot(
            trace.time_s[-1], values[-1], marker="X", markersize=9, color=VERMILION, zorder=5,
            markeredgecolor="white",
        )  # fmt: skip


def shade(axes: Axes, trace: FlightTrace) -> None:
    """Colour the background while any rotor is over the obstacle."""
    over = np.concatenate([[False], trace.covered > 1e-3, [False]])
    changes = np.flatnonzero(over[1:] != over[:-1])
    last = len(trace.time_s) - 1
    for begin, end in zip(changes[::2], changes[1::2], strict=True):
        axes.axvspan(
            float(trace.time_s[begin]), float(trace.time_s[min(end, last)]), color=OVER, lw=0,
            zorder=0.1,
        )  # fmt: skip


def _legend(figure: Figure, beside: FlightTrace | None, obstacle: bool) -> None:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=BLUE, label="flight"),
        Line2D([], [], color=VERMILION, linewidth=1.0, label="pitch command"),
        Line2D([], [], color=GREY, linestyle=(0, (5, 2.2)), linewidth=1.1, label="goal"),
    ]
    if beside is not None:
        handles.insert(1, Line2D([], [], color=GREY, linewidth=1.3, label=beside.label))
    if obstacle:
        handles.append(
            Line2D([], [], color=GREEN, linestyle=(0, (1.5, 1.5)), label="obstacle's edges")
        )
    handles.append(Patch(color=OVER, label="a rotor is over the obstacle"))
    one_row = len(handles) <= 5 and figure.get_figwidth() > 7.5
    figure.legend(handles=handles, loc="outside lower center", ncols=5 if one_row else 3)
