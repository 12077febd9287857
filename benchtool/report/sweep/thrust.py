"""Thrust against rotor speed, one colour per plate distance, with what the model leaves over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.core.units import from_si
from benchtool.report.fit.lengths import refuse_unequal
from benchtool.report.palette import BLACK, GREY
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]


def _no_values() -> Array:
    return np.empty(0)


@dataclass(frozen=True, slots=True, eq=False)
class ThrustSeries:
    """Hold the thrust measured at one plate distance.

    Attributes:
        z_over_R: plate distance over rotor radius; infinite out of ground effect.
        speed_rad_s, thrust_N, sd_N: (m,) rotor speed, thrust, its standard deviation (nan: none).
        predicted_N: (m,) the model at the measured points; empty when there is no model.
        line_speed_rad_s, line_N: (l,) the model's line; empty when there is none.
        named: legend entry where no plate is meant; the plate's distance gives it when empty.
    """

    z_over_R: float
    speed_rad_s: Array
    thrust_N: Array
    sd_N: Array
    predicted_N: Array = field(default_factory=_no_values)
    line_speed_rad_s: Array = field(default_factory=_no_values)
    line_N: Array = field(default_factory=_no_values)
    named: str = ""

    def __post_init__(self) -> None:
        refuse_unequal(
            f"the thrust series {self.label}",
            speed_rad_s=self.speed_rad_s,
            thrust_N=self.thrust_N,
            sd_N=self.sd_N,
            predicted_N=self.predicted_N if self.predicted_N.size else None,
        )
        refuse_unequal(
            f"the model line {self.label}",
            line_speed_rad_s=self.line_speed_rad_s,
            line_N=self.line_N,
        )

    @property
    def label(self) -> str:
        """Legend entry."""
        if self.named:
            return self.named
        return f"$z/R$ = {self.z_over_R:.3g}" if isfinite(self.z_over_R) else "out of ground effect"


@styled
def thrust_figure(series: Sequence[ThrustSeries], *, title: str, simulated: bool) -> Figure:
    """Draw thrust against rotor speed at each distance and, below, measured minus model."""
    ordered = sorted(series, key=lambda item: item.z_over_R)
    with_model = any(item.predicted_N.size for item in ordered)
    figure = new_figure(title, simulated=simulated, height_in=5.6 if with_model else 4.4)
    rows = figure.subplots(
        2 if with_model else 1,
        1,
        sharex=True,
        squeeze=False,
        gridspec_kw={"height_ratios": [2.4, 1.0] if with_model else [1.0]},
    )[:, 0]
    near = [item for item in ordered if isfinite(item.z_over_R)]
    shades = mpl.colormaps["viridis"](np.linspace(0.0, 0.88, max(len(near), 1)))
    for index, item in enumerate(ordered):
        color = mpl.colors.to_hex(shades[index]) if isfinite(item.z_over_R) else BLACK
        marker = "o" if isfinite(item.z_over_R) else "s"
        rpm = from_si(item.speed_rad_s, "rpm")
        rows[0].errorbar(
            rpm, item.thrust_N, yerr=item.sd_N, fmt=marker, ms=4.2, color=color, label=item.label
        )
        rows[0].plot(from_si(item.line_speed_rad_s, "rpm"), item.line_N, color=color, lw=1.2)
        if item.predicted_N.size:
            left_N = item.thrust_N - item.predicted_N
            rows[1].errorbar(rpm, left_N, yerr=item.sd_N, fmt=marker, ms=4.2, color=color)
    rows[0].set_ylabel("thrust [N]")
    rows[0].legend(loc="upper left", ncols=2 if len(ordered) > 6 else 1)
    if with_model:
        rows[1].axhline(0.0, color=GREY, linewidth=0.9)
        rows[1].set_ylabel("measured −\nmodel [N]")
        figure.align_ylabels(list(rows))
    rows[-1].set_xlabel("rotor speed [rpm]")
    return figure
