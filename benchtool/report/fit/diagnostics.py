"""Diagnostic figures of a fit: residuals, pairs of parameters, and traces of the ensembles.

Structure in the residuals indicates an incomplete model.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from math import pi, sqrt

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import ScalarFormatter
from numpy.typing import NDArray

from benchtool.core.fit_result import Estimate, FitResult
from benchtool.core.units import Array
from benchtool.fit.run_recipe import FitOutput
from benchtool.fit.statistics import expected_runs
from benchtool.physics.conditions import OUT_OF_GROUND_EFFECT_M
from benchtool.report.figure import figure
from benchtool.report.fit.tables import name_with_unit
from benchtool.report.numbers import with_statistical
from benchtool.report.palette import BLUE, CYCLE, GREY, ORANGE, VERMILION
from benchtool.report.panels import points, spread, stack_panels


def standardised(fit: FitOutput) -> Array:
    """Return measured minus model over the standard error (m,) of the used points."""
    problem, values = fit.problem, fit.results[0].values
    return problem.whitening(problem.split(values)[1])(problem.residuals(values))


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
    for axes in (distance, order):
        spread(axes, 2.0, alpha=0.45)
        axes.set_ylabel("standardised residual [–]")
    _against_distance(distance, far, values)
    _as_histogram(histogram, values)
    _against_order(order, values[in_order])
    _as_runs(runs, values[in_order])


def _against_distance(axes: Axes, z: Array, values: Array) -> None:
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
    axes.set(title="against distance", xlabel="$z/R$ [–]")


def _against_order(axes: Axes, values: Array) -> None:
    number = np.arange(1, values.size + 1)
    axes.plot(number, values, "o", color=BLUE, ms=3.6, alpha=0.55, mew=0.0)
    window = max(5, values.size // 10)
    if values.size > 2 * window:
        mean = np.convolve(values, np.full(window, 1.0 / window), mode="valid")
        middle = number[: mean.size] + (window - 1) / 2.0
        axes.plot(middle, mean, color=VERMILION, label=f"moving mean of {window}")
        axes.legend(loc="upper right", fontsize=7.6)
        axes.margins(y=0.16)
    axes.set(title="against order of measurement", xlabel="point, in order of measurement")


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
    axes.set(xlabel="standardised residual [–]", ylabel="density [–]")


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
    axes.set(xlabel="point, in order of measurement", ylabel="run length, with sign")


def runs_of_sign(residuals: Array) -> NDArray[np.intp]:
    """Return the signed length of each run of equal sign (r,); zeros count as positive."""
    signs = np.where(residuals >= 0.0, 1, -1)
    return np.array([sign * len(list(run)) for sign, run in groupby(signs)], np.intp)


def judge_runs(count: int, expected: float, sd: float) -> str:
    """Return a phrase for the runs test at three standard deviations."""
    if sd == 0.0 or abs(count - expected) <= 3.0 * sd:
        return "consistent with independent residuals"
    return "too few: positive correlation" if count < expected else "too many: alternating signs"


SIGMAS_2D = (1.0, 2.0)  # contours of a plane normal: 39 % and 86 % of the draws
_LEVELS = tuple(1.0 - float(np.exp(-0.5 * sigma**2)) for sigma in SIGMAS_2D)
SHOWN_STEPS = 600  # maximum number of steps drawn per chain, evenly spaced
SHOWN_WALKERS = 12  # maximum number of walkers drawn per ensemble


def sampled(fit: FitOutput) -> list[FitResult]:
    """Return the results with posterior draws; the figures show the last."""
    return [item for item in fit.results if item.method == "emcee" and len(item.samples)]


def _size(fit: FitOutput) -> float:
    return max(4.6, 1.4 + 1.25 * len(sampled(fit)[-1].estimates))


def _labels(result: FitResult) -> list[str]:
    return [
        "\n".join(name_with_unit(item.name, item.unit).rsplit(".", 1)) for item in result.estimates
    ]


@figure(
    title="Posterior: {0.recipe.name}",
    caption="Pairwise posterior draws; marker: least-squares estimate.",
    when=lambda fit: bool(sampled(fit)),
    height_in=_size,
    width_in=_size,
    layout=None,
)
def corner(figure: Figure, fit: FitOutput) -> None:
    """Draw posterior draws pairwise with the least-squares estimate."""
    import corner as corner_plot  # type: ignore[import-untyped]

    result = sampled(fit)[-1]
    n = len(result.estimates)
    marks = [other.values for other in fit.results if other.method == "least_squares"][-1:]
    figure.subplots(n, n, squeeze=False)
    corner_plot.corner(
        result.samples, fig=figure, labels=_labels(result), range=_ranges(result.samples, marks),
        color=BLUE, bins=32, smooth=1.0, levels=_LEVELS, plot_datapoints=False,
        fill_contours=True, quantiles=[0.16, 0.5, 0.84], show_titles=False, max_n_ticks=3,
        hist_kwargs={"linewidth": 1.3},
    )  # fmt: skip
    _tidy(figure, result.estimates)
    handles = [Line2D([], [], color=BLUE, label="posterior: 1 and 2 sd; dashed: 16, 50, 84 %")]
    for values in marks:
        if n > 1:
            corner_plot.overplot_lines(
                figure, values, color=VERMILION, linestyle="-", linewidth=1.2
            )
        else:  # corner marks nothing on a single histogram
            figure.axes[0].axvline(values[0], color=VERMILION, linestyle="-", linewidth=1.2)
        handles.append(Line2D([], [], color=VERMILION, linestyle="-", label="least squares"))
    top = 1.0 - 0.42 / figure.get_figheight()
    figure.legend(handles=handles, loc="upper right", bbox_to_anchor=(0.99, top))


def _ranges(samples: Array, marks: Sequence[Array]) -> list[tuple[float, float]]:
    """Return axis limits that include 99.7 % of the draws and all marked values."""
    low, high = np.percentile(samples, [0.15, 99.85], axis=0)
    for values in marks:
        low, high = np.fmin(low, values), np.fmax(high, values)
    span = np.where(high > low, high - low, np.maximum(np.abs(high), 1.0) * 1e-6)
    return list(zip(low - 0.04 * span, high + 0.04 * span, strict=True))


def _tidy(figure: Figure, estimates: Sequence[Estimate]) -> None:
    """Adjust margins and labels, and put the table's values above each histogram."""
    n, height_in = len(estimates), figure.get_figheight()
    figure.subplots_adjust(
        left=1.10 / height_in, bottom=1.10 / height_in, right=1.0 - 0.45 / height_in,
        top=1.0 - (1.05 if n == 1 else 0.75) / height_in, wspace=0.09, hspace=0.09,
    )  # fmt: skip
    for index, item in enumerate(estimates):
        text = with_statistical(item.value, item.combined_sd, item.sd).partition(" (stat")[0]
        title = "\n".join(filter(None, (text, item.bound)))
        figure.axes[index * n + index].set_title(title, loc="left", fontsize=9.0)
    for axes in figure.axes:
        box = axes.get_position()
        axes.xaxis.set_label_coords(0.5, -0.68 / (box.height * height_in))
        axes.yaxis.set_label_coords(-0.68 / (box.width * height_in), 0.5)
        axes.grid(visible=False)
        axes.tick_params(labelsize=8.4)
        for axis in (axes.xaxis, axes.yaxis):
            axis.offsetText.set_fontsize(8.4)
            formatter = axis.get_major_formatter()
            if isinstance(formatter, ScalarFormatter):
                formatter.set_powerlimits((-3, 4))


@figure(
    title=lambda fit: (
        f"Chains of {sampled(fit)[-1].facts['ensembles'] or 1} ensembles: {sampled(fit)[-1].model}"
    ),
    caption="Traces of independent ensembles; overlapping traces indicate convergence.",
    when=lambda fit: bool(sampled(fit)),
    height_in=lambda fit: 1.0 + 1.45 * len(sampled(fit)[-1].estimates),
)
def chains(figure: Figure, fit: FitOutput) -> None:
    """Draw one trace per parameter with R-hat and autocorrelation time."""
    from benchtool.fit.ensemble import RHAT_LIMIT, check_convergence

    result = sampled(fit)[-1]
    labels, facts = _labels(result), result.facts
    ensembles, walkers = int(facts["ensembles"] or 1), int(facts["walkers"] or 1)
    draws = result.samples.reshape(-1, ensembles, walkers, len(labels))
    steps = len(draws)
    convergence = check_convergence(draws)
    tau_steps = convergence.tau_steps * float(facts["steps_kept"] or 1) / steps
    step_stride, walker_stride = -(-steps // SHOWN_STEPS), -(-walkers // SHOWN_WALKERS)
    rows = stack_panels(figure, [1.0] * len(labels), labels, "step")
    for index, axes in enumerate(rows):
        for ensemble in range(ensembles):
            lines = axes.plot(
                np.arange(0, steps, step_stride),
                draws[::step_stride, ensemble, ::walker_stride, index],
                color=CYCLE[ensemble % len(CYCLE)], linewidth=0.45, alpha=0.5, rasterized=True,
            )  # fmt: skip
            lines[0].set_label(f"ensemble {ensemble + 1}")
        disagree = "" if convergence.rhat[index] <= RHAT_LIMIT else f"  (above {RHAT_LIMIT:g})"
        axes.set_title(
            f"$\\hat{{R}}$ = {convergence.rhat[index]:.4f}{disagree},  "
            f"$\\tau$ = {tau_steps[index]:.0f} steps",
            fontsize=9.0,
        )
        axes.set_xlim(0, max(steps - 1, 1))
    legend = rows[0].legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=ensembles, fontsize=7.8, frameon=False
    )
    for handle in legend.get_lines():
        handle.set(linewidth=2.0, alpha=1.0)
