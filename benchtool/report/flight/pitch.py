"""Pitch angle against time under several controllers, green while a rotor is over the plate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.report.fit.lengths import refuse_unequal
from benchtool.report.palette import BLUE, GREY, VERMILION
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]

OVER = "#bfe3c8"
"""Background while a rotor is over the plate, as in the paper's figures 26 to 28."""

PANEL_IN = 1.55


@dataclass(frozen=True, slots=True, eq=False)
class PitchTrace:
    """Hold one run for drawing.

    Attributes:
        label: heading of its panel ("observer").
        time_s, pitch_deg, reference_deg: (m,) each.
        covered: (m,) how far the plate is in, 0 to 1.
        away_deg: (m,) the same run with the plate parked (out of ground effect); None without.
    """

    label: str
    time_s: Array
    pitch_deg: Array
    reference_deg: Array
    covered: Array
    away_deg: Array | None = None

    def __post_init__(self) -> None:
        refuse_unequal(
            f"the run {self.label!r}",
            time_s=self.time_s,
            pitch_deg=self.pitch_deg,
            reference_deg=self.reference_deg,
            covered=self.covered,
            away_deg=self.away_deg,
        )


@styled
def pitch_figure(traces: Sequence[PitchTrace], *, title: str, simulated: bool) -> Figure:
    """Draw one panel per controller, all with the same axes, as in the paper's figures 26 to 28.

    Args:
        traces: runs, from top to bottom.
        title: one line that says what is to be seen.
        simulated: whether no physical bench gave the runs.
    """
    if not traces:
        raise InputError("a figure of pitch needs at least one run")
    figure = new_figure(title, simulated=simulated, height_in=1.0 + PANEL_IN * len(traces))
    panels = figure.subplots(len(traces), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for axes, trace in zip(panels, traces, strict=True):
        for start, end in spans(trace.time_s, trace.covered > 0.0):
            axes.axvspan(start, end, color=OVER, linewidth=0.0, zorder=0.4, gid="over-plate")
        if np.ptp(trace.reference_deg) > 0.0:
            axes.plot(
                trace.time_s, trace.reference_deg, color=GREY, lw=1.0, ls="--", label="wanted"
            )
        if trace.away_deg is not None:
            axes.plot(trace.time_s, trace.away_deg, color=BLUE, lw=0.9, label="plate away (OGE)")
        axes.plot(
            trace.time_s, trace.pitch_deg, color=VERMILION, lw=1.2, label="with the plate (IGE)"
        )
        axes.set_title(trace.label)
        axes.set_ylabel("pitch [deg]\n(nose down +)")
    panels[-1].set_xlabel("time [s]    (green: a rotor is over the plate)")
    panels[0].set_xlim(float(traces[0].time_s[0]), float(traces[0].time_s[-1]))
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure


def spans(time_s: Array, inside: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return begin and end of every stretch in which `inside` holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]])))
    last = len(time_s) - 1
    return [
        (float(time_s[begin]), float(time_s[min(end, last)]))
        for begin, end in zip(edges[::2], edges[1::2], strict=True)
    ]
