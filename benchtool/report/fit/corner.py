"""Corner plot: every pair of fitted parameters, with the truth and the least squares beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import corner  # type: ignore[import-untyped]
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import ScalarFormatter
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.report.numbers import value_with_sd
from benchtool.report.palette import BLUE, GREEN, ORANGE, VERMILION
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]

SIGMAS_2D = (1.0, 2.0)
"""Contours at one and two standard deviations of a plane normal: 39 % and 86 % of the draws."""

_LEVELS = tuple(1.0 - float(np.exp(-0.5 * sigma**2)) for sigma in SIGMAS_2D)
_REFERENCE_LOOKS: tuple[tuple[str, Literal["-", "--", ":"]], ...] = (
    (VERMILION, "-"),
    (GREEN, "--"),
    (ORANGE, ":"),
)


@styled
def corner_figure(
    samples: Array,
    names: Sequence[str],
    *,
    title: str,
    simulated: bool,
    references: Mapping[str, Sequence[float]] | None = None,
    notes: Sequence[str] = (),
) -> Figure:
    """Draw posterior draws pair by pair.

    Args:
        samples: (n_samples, n_parameters) draws, each column in its own unit.
        names: axis labels (name with unit) in column order.
        title: one line.
        simulated: whether the fitted data is simulated.
        references: up to three marked points by name ("truth", "least squares"), each
            (n_parameters,); nan where a value is not known.
        notes: (n_parameters,) words below each value, such as the bound that it reaches.
    """
    marked = dict(references or {})
    n = len(names)
    if samples.ndim != 2 or samples.shape[1] != n or len(samples) <= n:
        raise InputError(
            f"a corner plot of {n} parameters needs more than {n} draws of {n} values, "
            f"got samples of shape {samples.shape}; hand over the flattened chain"
        )
    if len(marked) > len(_REFERENCE_LOOKS):
        raise InputError(
            f"a corner plot marks at most {len(_REFERENCE_LOOKS)} points, got {len(marked)}: "
            f"{', '.join(marked)}; leave some out"
        )
    size_in = max(4.6, 1.2 + 1.75 * n)
    figure = new_figure(
        title, simulated=simulated, height_in=size_in, width_in=size_in, layout=None
    )
    figure.subplots(n, n, squeeze=False)
    corner.corner(
        samples,
        fig=figure,
        labels=list(names),
        range=_ranges(samples, marked),
        color=BLUE,
        bins=32,
        smooth=1.0,
        levels=_LEVELS,
        plot_datapoints=False,
        fill_contours=True,
        quantiles=[0.16, 0.5, 0.84],
        show_titles=False,
        max_n_ticks=4,
        hist_kwargs={"linewidth": 1.3},
    )
    _tidy(figure, samples, n, notes or [""] * n)
    handles = [Line2D([], [], color=BLUE, label="posterior: 1 and 2 sd; dashed: 16, 50, 84 %")]
    for (label, values), (color, dashes) in zip(marked.items(), _REFERENCE_LOOKS, strict=False):
        at = [None if np.isnan(value) else float(value) for value in values]
        if n > 1:
            corner.overplot_lines(figure, at, color=color, linestyle=dashes, linewidth=1.2)
        elif at[0] is not None:  # corner marks nothing on a single histogram
            figure.axes[0].axvline(at[0], color=color, linestyle=dashes, linewidth=1.2)
        handles.append(Line2D([], [], color=color, linestyle=dashes, label=label))
    top = 1.0 - 0.42 / size_in
    figure.legend(handles=handles, loc="upper right", bbox_to_anchor=(0.99, top))
    return figure


def _ranges(samples: Array, marked: Mapping[str, Sequence[float]]) -> list[tuple[float, float]]:
    """Reach over 99.7 % of the draws and over every marked value."""
    low, high = np.percentile(samples, [0.15, 99.85], axis=0)
    for values in marked.values():
        low = np.fmin(low, np.asarray(values, float))
        high = np.fmax(high, np.asarray(values, float))
    span = np.where(high > low, high - low, np.maximum(np.abs(high), 1.0) * 1e-6)
    return list(zip(low - 0.04 * span, high + 0.04 * span, strict=True))


def _tidy(figure: Figure, samples: Array, n: int, notes: Sequence[str]) -> None:
    """Give room to labels and titles, and say the median with its spread over each histogram."""
    height_in = figure.get_figheight()
    figure.subplots_adjust(
        left=1.15 / height_in,
        bottom=1.10 / height_in,
        right=1.0 - 0.15 / height_in,
        top=1.0 - (1.05 if n == 1 else 0.75) / height_in,
        wspace=0.09,
        hspace=0.09,
    )
    middle = np.percentile(samples, [16, 50, 84], axis=0)
    for index in range(n):
        axes = figure.axes[index * n + index]
        half = 0.5 * (middle[2, index] - middle[0, index])
        shown = "\n".join(filter(None, (value_with_sd(middle[1, index], half), notes[index])))
        axes.set_title(shown, loc="center", fontsize=8.6)
    for axes in figure.axes:
        box = axes.get_position()
        axes.xaxis.set_label_coords(0.5, -0.68 / (box.height * height_in))
        axes.yaxis.set_label_coords(-0.68 / (box.width * height_in), 0.5)
        axes.grid(visible=False)
        axes.tick_params(labelsize=7.6)
        for axis in (axes.xaxis, axes.yaxis):
            formatter = axis.get_major_formatter()
            if isinstance(formatter, ScalarFormatter):
                formatter.set_powerlimits((-3, 4))
