"""In which order a sweep was measured, and whether its load cell stood still meanwhile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.core.units import from_si
from benchtool.report.fit.lengths import refuse_unequal
from benchtool.report.palette import GREY, PALE, VERMILION
from benchtool.report.style import new_figure, styled
from benchtool.report.sweep.sweep import KIND_COLORS

Array = NDArray[np.float64]

MOST_TICKS = 6
"""Plate distances that are written beside their axis; more would touch each other."""

MARKERS = {"measure": "o", "reference": "s", "anchor": "D"}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Order:
    """Hold the order of a run and what tells drift.

    Attributes:
        time_s: (v,) middle of each visit since the run began.
        z_over_R: (v,) plate distance over the rotor radius.
        kind: (v,) as in points.csv.
        anchor_s, anchor_N, anchor_se_N: (a,) anchors: change of thrust since the first, brought to
            its rotor speed.
        tare_s, tare_N, tare_se_N: (t,) what the load cell showed after each tare.
        residual_N: largest rest that the plan allows; nan where it states none.
    """

    time_s: Array
    z_over_R: Array
    kind: tuple[str, ...]
    anchor_s: Array
    anchor_N: Array
    anchor_se_N: Array
    tare_s: Array
    tare_N: Array
    tare_se_N: Array
    residual_N: float = float("nan")

    def __post_init__(self) -> None:
        refuse_unequal("the order of a run", time_s=self.time_s, z_over_R=self.z_over_R)
        refuse_unequal(
            "its anchors", anchor_s=self.anchor_s, anchor_N=self.anchor_N, se=self.anchor_se_N
        )
        refuse_unequal("its tares", tare_s=self.tare_s, tare_N=self.tare_N, se=self.tare_se_N)


@styled
def order_figure(order: Order, *, title: str, simulated: bool) -> Figure:
    """Draw plate distances in the order of measurement; below, anchors and tares."""
    figure = new_figure(title, simulated=simulated, height_in=4.8)
    places, drift = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": [1.3, 1.0]})
    for kind in dict.fromkeys(order.kind):
        rows = np.array([item == kind for item in order.kind])
        places.plot(
            order.time_s[rows] / 60.0, order.z_over_R[rows], MARKERS.get(kind, "o"), ms=4.8,
            color=KIND_COLORS.get(kind, GREY), label=kind,
        )  # fmt: skip
    places.plot(order.time_s / 60.0, order.z_over_R, color=PALE, lw=0.9, zorder=1.0)
    places.set_yscale("log")
    known = np.unique(order.z_over_R[np.isfinite(order.z_over_R)].round(2))
    kept = known[np.unique(np.linspace(0, len(known) - 1, MOST_TICKS).astype(int))]
    places.set_yticks(kept, [f"{value:g}" for value in kept])
    places.minorticks_off()
    places.set_ylabel("plate $z/R$ [–]")
    drift.axhline(0.0, color=GREY, lw=0.9)
    if np.isfinite(order.residual_N):
        limit = from_si(order.residual_N, "mN")
        drift.axhspan(-limit, limit, color=PALE, alpha=0.5, lw=0.0, zorder=0.4, gid="tare-limit")
    drift.errorbar(
        order.anchor_s / 60.0, from_si(order.anchor_N, "mN"), yerr=from_si(order.anchor_se_N, "mN"),
        fmt="D-", ms=4.8, lw=0.9, color=KIND_COLORS["anchor"], label="anchor since the first",
    )  # fmt: skip
    drift.errorbar(
        order.tare_s / 60.0, from_si(order.tare_N, "mN"), yerr=from_si(order.tare_se_N, "mN"),
        fmt="v", ms=5.5, color=VERMILION, label="left after a tare",
    )  # fmt: skip
    drift.set_ylabel("change of the\nload cell [mN]")
    drift.set_xlabel("time [min]    (grey band: what the plan lets a tare leave)")
    figure.align_ylabels([places, drift])
    handles, labels = [], []
    for axes in (places, drift):
        more = axes.get_legend_handles_labels()
        handles += more[0]
        labels += more[1]
    figure.legend(handles, labels, loc="outside lower center", ncols=5)
    return figure
