"""Residuals of a fit; structure in them indicates an incomplete model."""

from __future__ import annotations

from itertools import groupby
from math import pi, sqrt

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.fit.run_recipe import FitOutput
from benchtool.fit.statistics import expected_runs
from benchtool.physics.conditions import OUT_OF_GROUND_EFFECT_M
from benchtool.report.figure import figure
from benchtool.report.palette import BLUE, GREY, ORANGE, VERMILION
from benchtool.report.panels import points, spread


def standardised(fit: FitOutput) -> Array:
    """Return measured minus model over the standard error (m,) of the used points."""
    result, problem = fit.results[0], fit.problem
    predicted = problem.predicted(np.array([result[name].value for name in problem.shape_names]))
    noise = None if problem.noise_name is None else result[problem.noise_name].value
    return problem.whitening(noise)(fit.data.observed[fit.data.rows] - predicted)


@figure(
    title="Residuals: {0.recipe.name}",
    caption="Measured minus model over the standard error: against distance, in the order of "
    "measurement, as a histogram, and as runs of equal sign.",
    height_in=5.8,
)
def residuals(figure: Figure, fit: FitOutput) -> None:
    """Draw residuals over distance and order, as histogram and as sign runs."""
    rows, data, values = fit.data.rows, fit.data, standardised(fit)
    (distance, histogram), (order, runs) = figure.subplots(
        2, 2, gridspec_kw={"width_ratios": [1.5, 1.0]}
    )
    far = np.where(
        data.conditions.plate_z_m[rows] >= OUT_OF_GROUND_EFFECT_M, np.inf, data.z_over_R[rows]
    )
    in_order = np.argsort(data.conditions.time_s[rows], kind="stable")
    _against_distance(distance, far, values)
    _as_histogram(histogram, values)
    _against_order(order, values[in_order])
    _as_runs(runs, values[in_order])


def _against_distance(axes: Axes, z: Array, values: Array) -> None:
    spread(axes, 2.0, alpha=0.45)
    near = np.isfinite(z)
    # Points out of ground effect are drawn behind the last distance of the axis.
    parked = 1.12 * float(z[near].max()) if near.any() else 1.0
    drawn_z = np.where(near, z, parked)
    axes.plot(drawn_z, values, "o", color=BLUE, ms=3.6, alpha=0.55, mew=0.0, gid="residuals")
    for distance in np.unique(drawn_z):
        group = values[drawn_z == distance]
        if group.size > 1:
            error = group.std(ddof=1) / sqrt(group.size)
            label = "mean per distance ± standard error"
            points(axes, distance, group.mean(), error, VERMILION, "D", ms=4.0, label=label)
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
    spread(axes, 2.0, alpha=0.45)
    number = np.arange(1, values.size + 1)
    axes.plot(number, values, "o", color=BLUE, ms=3.6, alpha=0.55, mew=0.0)
    window = max(5, values.size // 10)
    if values.size > 2 * window:
        mean = np.convolve(values, np.full(window, 1.0 / window), mode="valid")
        middle = number[: mean.size] + (window - 1) / 2.0
        axes.plot(middle, mean, color=VERMILION, label=f"moving mean of {window}")
        axes.legend(loc="upper right", fontsize=7.6)
        axes.margins(y=0.16)
    axes.set_title("against order of measurement")
    axes.set_xlabel("point, in order of measurement")
    axes.set_ylabel("standardised residual [–]")


def _as_histogram(axes: Axes, values: Array) -> None:
    finite = values[np.isfinite(values)]
    reach = max(3.5, float(np.abs(finite).max(initial=0.0)))
    edges = np.linspace(-reach, reach, 2 * max(6, min(20, round(sqrt(finite.size)))) + 1)
    axes.hist(finite, bins=list(edges), density=True, color=BLUE, alpha=0.55, label="residuals")
    grid = np.linspace(-reach, reach, 241)
    axes.plot(grid, np.exp(-0.5 * grid**2) / sqrt(2.0 * pi), color=VERMILION, label="normal, sd 1")
    axes.set_ylim(0.0, 1.32 * axes.get_ylim()[1])
    axes.legend(loc="upper right", fontsize=7.6)
    axes.set_title(f"n = {finite.size}, sd = {finite.std(ddof=min(1, finite.size - 1)):.2f}")
    axes.set_xlabel("standardised residual [–]")
    axes.set_ylabel("density [–]")


def _as_runs(axes: Axes, values: Array) -> None:
    lengths = runs_of_sign(values)
    starts = np.cumsum([0, *np.abs(lengths[:-1])])
    axes.bar(
        starts + 1, lengths, width=np.abs(lengths), align="edge", linewidth=0.0,
        color=[BLUE if length > 0 else ORANGE for length in lengths],
    )  # fmt: skip
    axes.axhline(0.0, color=GREY, linewidth=0.9)
    expected, sd = expected_runs(values >= 0.0)
    axes.set_title(
        f"{len(lengths)} runs, {expected:.0f} ± {sd:.0f} expected\n"
        f"({judge_runs(len(lengths), expected, sd)})",
        fontsize=9.0,
    )
    axes.set_xlabel("point, in order of measurement")
    axes.set_ylabel("run length, with sign")


def runs_of_sign(residuals: Array) -> NDArray[np.intp]:
    """Return the signed length of each run of equal sign (r,); zeros count as positive."""
    signs = np.where(residuals >= 0.0, 1, -1)
    return np.array([sign * len(list(run)) for sign, run in groupby(signs)], np.intp)


def judge_runs(count: int, expected: float, sd: float) -> str:
    """Return a phrase for the runs test at three standard deviations."""
    if sd == 0.0 or abs(count - expected) <= 3.0 * sd:
        return "consistent with independent residuals"
    return "too few: positive correlation" if count < expected else "too many: alternating signs"
