"""The calibration of a load cell: counts against known force, and what the line leaves over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.core.units import from_si
from benchtool.report.fit.lengths import refuse_unequal
from benchtool.report.palette import BLUE, GREY, ORANGE
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationPoints:
    """Hold the loadings of a calibration in the order in which they were made.

    Attributes:
        force_N: (m,) known force.
        counts: (m,) mean raw reading.
        calibrated_N: (m,) the reading through the fitted calibration.
        loading: (m,) True while masses are added, False while they are taken off.
    """

    force_N: Array
    counts: Array
    calibrated_N: Array
    loading: NDArray[np.bool_]

    def __post_init__(self) -> None:
        refuse_unequal(
            "a calibration figure",
            force_N=self.force_N,
            counts=self.counts,
            calibrated_N=self.calibrated_N,
            loading=self.loading.astype(float),
        )


@styled
def calibration_figure(points: CalibrationPoints, *, title: str, simulated: bool) -> Figure:
    """Draw counts against force with the line, and below the residuals up and down.

    A gap between the two ways in the lower panel is hysteresis; an arch is a bent line.
    """
    figure = new_figure(title, simulated=simulated, height_in=5.2)
    line, left = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": [1.6, 1.0]})
    order = np.argsort(points.calibrated_N, kind="stable")
    line.plot(points.calibrated_N[order], points.counts[order], color=GREY, lw=1.2, label="line")
    residual_mN = from_si(points.calibrated_N - points.force_N, "mN")
    for rows, marker, color, label in (
        (points.loading, "^", BLUE, "masses added"),
        (~points.loading, "v", ORANGE, "masses taken off"),
    ):
        if rows.any():
            line.plot(points.force_N[rows], points.counts[rows], marker, color=color, label=label)
            left.plot(
                points.force_N[rows], residual_mN[rows], marker + "-", color=color, lw=0.8, ms=5.0
            )
    left.axhline(0.0, color=GREY, linewidth=0.9)
    line.set_ylabel("reading [counts]")
    line.legend(loc="upper left")
    left.set_ylabel("reading −\nforce [mN]")
    left.set_xlabel("known force [N]")
    figure.align_ylabels([line, left])
    return figure
