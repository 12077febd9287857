"""Thrust in newtons against plate distance, one colour per throttle level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.report.fit.lengths import refuse_unequal
from benchtool.report.palette import CYCLE, GREY
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")


def _no_values() -> Array:
    return np.empty(0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DistanceSeries:
    """Hold the thrust at one throttle level.

    Attributes:
        label: legend entry ("1500 µs").
        z_over_R, thrust_N, error_N: (m,) each; nan where there is no error.
        away_N: thrust out of ground effect; nan where it was not measured.
        line_z_over_R, line_N: (l,) the model's line; empty without a model.
        lower_N, upper_N: (l,) its 95 % band; empty without.
    """

    label: str
    z_over_R: Array
    thrust_N: Array
    error_N: Array
    away_N: float = float("nan")
    line_z_over_R: Array = field(default_factory=_no_values)
    line_N: Array = field(default_factory=_no_values)
    lower_N: Array = field(default_factory=_no_values)
    upper_N: Array = field(default_factory=_no_values)

    def __post_init__(self) -> None:
        refuse_unequal(
            f"the thrust at {self.label}",
            z_over_R=self.z_over_R,
            thrust_N=self.thrust_N,
            error_N=self.error_N,
        )
        refuse_unequal(
            f"the model line at {self.label}",
            line_z_over_R=self.line_z_over_R,
            line_N=self.line_N,
            lower_N=self.lower_N if self.lower_N.size else None,
            upper_N=self.upper_N if self.upper_N.size else None,
        )


@styled
def distance_figure(
    series: Sequence[DistanceSeries], *, title: str, simulated: bool, model: str = ""
) -> Figure:
    """Draw thrust with error bars against plate distance over the model's lines.

    Args:
        series: one per throttle level.
        title: one line.
        simulated: whether the points come from no physical bench.
        model: what the lines are, for the legend; empty without.
    """
    if not series:
        raise InputError("a figure of thrust against distance needs at least one level")
    figure = new_figure(title, simulated=simulated, height_in=4.3)
    axes = figure.subplots()
    banded = False
    for index, item in enumerate(series):
        color = CYCLE[index % len(CYCLE)]
        if item.lower_N.size:
            banded = True
            axes.fill_between(
                item.line_z_over_R, item.lower_N, item.upper_N, color=color, alpha=0.2, lw=0.0,
                gid="band-95",
            )  # fmt: skip
        axes.plot(item.line_z_over_R, item.line_N, color=color, lw=1.2)
        axes.errorbar(
            item.z_over_R, item.thrust_N, yerr=item.error_N, fmt=MARKERS[index % len(MARKERS)],
            color=color, ms=4.6, capsize=3.5, label=item.label, zorder=3,
        )  # fmt: skip
        if np.isfinite(item.away_N):
            axes.axhline(item.away_N, color=color, lw=1.0, ls=(0, (1.2, 1.6)))
    axes.set_xlabel("distance to the plate  $z/R$ [–]")
    axes.set_ylabel("thrust [N]")
    axes.set_xlim(left=0.0)
    handles, _ = axes.get_legend_handles_labels()
    if any(np.isfinite(item.away_N) for item in series):
        handles.append(
            Line2D([], [], color=GREY, lw=1.0, ls=(0, (1.2, 1.6)), label="plate parked (OGE)")
        )
    if model:
        handles.append(Line2D([], [], color=GREY, lw=1.2, label=model))
    if banded:
        handles.append(Patch(facecolor=GREY, alpha=0.3, lw=0.0, label="95 % band of the model"))
    axes.legend(handles=handles, loc="upper right")
    return figure
