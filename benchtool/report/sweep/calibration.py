"""The calibration of a load cell: counts against known force, and what the line leaves over."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchtool.core.units import from_si
from benchtool.report.figure import figure
from benchtool.report.palette import BLUE, GREY, ORANGE
from benchtool.report.panels import rows_of


@figure(
    page="sweep.calibration",
    name="calibration",
    title="Calibration {0[id]}",
    caption="The calibration. Above: mean raw reading of each known mass and the line. Below: what "
    "the line leaves over; a gap between the two ways is hysteresis, an arch a bent line.",
    simulated=lambda known: bool(known["simulated"]),
    height_in=5.2,
)
def calibration(figure: Figure, known: Mapping[str, Any]) -> None:
    """Draw counts against force with the line, and below the residuals up and down.

    Args:
        figure: empty.
        known: a calibration as its JSON file and a run's metadata hold it, and whether the load
            cell was a virtual one, as "simulated".
    """
    newtons_per_kg = known["gravity_m_s2"] / known["lever_ratio"]
    force_N = np.array(known["masses_kg"], float) * newtons_per_kg
    counts, residual_N = np.array(known["counts"], float), np.array(known["residuals_N"], float)
    loading = np.arange(len(force_N)) <= int(force_N.argmax())
    line, left = rows_of(figure, (1.6, 1.0))
    order = np.argsort(force_N + residual_N, kind="stable")
    line.plot((force_N + residual_N)[order], counts[order], color=GREY, lw=1.2, label="line")
    for rows, marker, color, label in (
        (loading, "^", BLUE, "masses added"),
        (~loading, "v", ORANGE, "masses taken off"),
    ):
        if rows.any():
            residual_mN = from_si(residual_N[rows], "mN")
            line.plot(force_N[rows], counts[rows], marker, color=color, label=label)
            left.plot(force_N[rows], residual_mN, marker + "-", color=color, lw=0.8, ms=5.0)
    left.axhline(0.0, color=GREY, linewidth=0.9)
    line.set_ylabel("reading [counts]")
    line.legend(loc="upper left")
    left.set_ylabel("reading −\nforce [mN]")
    left.set_xlabel("known force [N]")
    figure.align_ylabels([line, left])
