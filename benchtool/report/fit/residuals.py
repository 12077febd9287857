"""Standardised residuals four ways: against distance, against time, as a histogram, as runs."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.report.fit.lengths import refuse_unequal
from benchtool.report.palette import BLUE, GREY, ORANGE, PALE, VERMILION
from benchtool.report.runs import runs_of_sign
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Hold what a fit leaves over.

    Attributes:
        z_over_R: (m,) plate distance over rotor radius; infinite out of ground effect.
        time_s: (m,) when each point was measured; gives the order.
        standardised: (m,) measured minus model over the standard error.
    """

    z_over_R: Array
    time_s: Array
    standardised: Array

    def __post_init__(self) -> None:
        refuse_unequal(
            "a residual figure",
            z_over_R=self.z_over_R,
            time_s=self.time_s,
            standardised=self.standardised,
        )


@styled
def residual_figure(residuals: Residuals, *, title: str, simulated: bool) -> Figure:
    """Draw the residuals in four panels, in the order in which they were measured."""
    figure = new_figure(title, simulated=simulated, height_in=5.8)
    (distance, histogram), (order, runs) = figure.subplots(
        2, 2, gridspec_kw={"width_ratios": [1.5, 1.0]}
    )
    in_order = np.argsort(residuals.time_s, kind="stable")
    _against_distance(distance, residuals)
    _as_histogram(histogram, residuals.standardised)
    _against_order(order, residuals.standardised[in_order])
    _as_runs(runs, residuals.standardised[in_order])
    return figure


def _zero_and_two_sd(axes: Axes) -> None:
    axes.axhspan(-2.0, 2.0, color=PALE, alpha=0.45, linewidth=0.0, zorder=0)
    axes.axhline(0.0, color=GREY, linewidth=0.9)


def _against_distance(axes: Axes, residuals: Residuals) -> None:
    _zero_and_two_sd(axes)
    z, values = residuals.z_over_R, residuals.standardised
    near = np.isfinite(z)
    # Out of ground effect has no place on the axis of distances: it stands behind the last one.
    parked = 1.12 * float(z[near].max()) if near.any() else 1.0
    shown = np.where(near, z, parked)
    axes.plot(shown, values, "o", color=BLUE, ms=3.6, alpha=0.55, mew=0.0, gid="residuals")
    for place in np.unique(shown):
        here = values[shown == place]
        if here.size > 1:
            axes.errorbar(
                place,
                here.mean(),
                yerr=here.std(ddof=1) / sqrt(here.size),
                fmt="D",
                color=VERMILION,
                ms=4.0,
                label="mean of a distance, ± its standard error",
            )
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        axes.legend(handles[:1], labels[:1], loc="upper right", fontsize=7.6)
        axes.margins(y=0.16)
    if not near.all():
        ticks = [tick for tick in axes.get_xticks() if 0.0 <= tick <= z[near].max(initial=0.0)]
        axes.set_xticks([*ticks, parked], [*(f"{tick:g}" for tick in ticks), "OGE"])
    axes.set_title("against distance")
    axes.set_xlabel("$z/R$ [–]")
    axes.set_ylabel("standardised residual [–]")


def _against_order(axes: Axes, values: Array) -> None:
    _zero_and_two_sd(axes)
    number = np.arange(1, values.size + 1)
    axes.plot(number, values, "o", color=BLUE, ms=3.6, alpha=0.55, mew=0.0)
    window = max(5, values.size // 10)
    if values.size > 2 * window:
        mean = np.convolve(values, np.full(window, 1.0 / window), mode="valid")
        middle = number[: mean.size] + (window - 1) / 2.0
        axes.plot(middle, mean, color=VERMILION, label=f"mean of {window} in a row")
        axes.legend(loc="upper right", fontsize=7.6)
        axes.margins(y=0.16)
    axes.set_title("against the order in time")
    axes.set_xlabel("point, in the order measured")
    axes.set_ylabel("standardised residual [–]")


def _as_histogram(axes: Axes, values: Array) -> None:
    finite = values[np.isfinite(values)]
    reach = max(3.5, float(np.abs(finite).max(initial=0.0)))
    edges = np.linspace(-reach, reach, 2 * max(6, min(20, round(sqrt(finite.size)))) + 1)
    axes.hist(finite, bins=list(edges), density=True, color=BLUE, alpha=0.55, label="residuals")
    at = np.linspace(-reach, reach, 241)
    axes.plot(at, np.exp(-0.5 * at**2) / sqrt(2.0 * pi), color=VERMILION, label="normal, sd 1")
    axes.set_ylim(0.0, 1.32 * axes.get_ylim()[1])
    axes.legend(loc="upper right", fontsize=7.6)
    axes.set_title(f"n = {finite.size}, sd = {finite.std(ddof=min(1, finite.size - 1)):.2f}")
    axes.set_xlabel("standardised residual [–]")
    axes.set_ylabel("density [–]")


def _as_runs(axes: Axes, values: Array) -> None:
    runs = runs_of_sign(values)
    axes.bar(
        runs.starts + 1,
        runs.signs * runs.lengths,
        width=runs.lengths,
        align="edge",
        color=[BLUE if sign > 0 else ORANGE for sign in runs.signs],
        linewidth=0.0,
    )
    axes.axhline(0.0, color=GREY, linewidth=0.9)
    axes.set_title(
        f"{runs.count} runs, {runs.expected:.0f} ± {runs.sd:.0f} expected\n({runs.verdict})",
        fontsize=9.0,
    )
    axes.set_xlabel("point, in the order measured")
    axes.set_ylabel("run length, with sign")
