"""Overlay figure of one channel: measurement, predictions of both models, residuals."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from benchtool.core.units import Array
from benchtool.explain.findings import Overlay
from benchtool.explain.result import Explanation
from benchtool.report.answer.figures import AFTER, BEFORE, find_channel_label
from benchtool.report.figure import figure
from benchtool.report.palette import BLACK, PALE
from benchtool.report.panels import legend_below, spread, stack_panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


AXES = {"time_s": "time [s]", "z_over_R": "$z/R$ [–]"}  # labels of x axes


OVERLAY = (
    "Measurement and predictions on the validation recording; below: residuals. Grey band: noise "
    "floor."
)


def overlay_caption(window_s: float) -> str:
    """Return the caption of an overlay; with windows (s) it explains the spikes."""
    if not window_s:
        return OVERLAY
    return (
        f"{OVERLAY} Predictions restart every {window_s:g} s from the measured state, which causes "
        f"the spikes."
    )


@figure(
    title=lambda answer, overlay: (
        f"{find_channel_label(overlay.channel).title.capitalize()} on the validation "
        f"{'recording' if answer.bench == 'pitch' else 'sweep'}"
    ),
    caption=lambda answer, _: overlay_caption(answer.window_s),
    each=lambda answer: {item.channel: item for item in answer.overlays},
    height_in=3.7,
)
def overlay(figure: Figure, answer: Explanation, overlay: Overlay) -> None:
    """Draw one channel over its residuals; right column: enlarged where the old model is worst."""
    if answer.bench != "pitch":
        panels = stack_panels(figure, (1.8, 1.0))
        _overlay_column(panels, answer, overlay, as_lines=False)
        legend_below(figure, panels[:1], 3)
        return
    grid = figure.subplots(
        2, 2, sharex="col",
        gridspec_kw={"height_ratios": [1.8, 1.0], "width_ratios": [2.0, 1.0]},
    )  # fmt: skip
    for column in (0, 1):
        _overlay_column(list(grid[:, column]), answer, overlay, as_lines=True)
    first, last = worst_stretch(overlay.at, overlay.measured - overlay.before)
    grid[1, 1].set_xlim(first, last)
    grid[1, 1].sharey(grid[1, 0])
    rows = (overlay.at >= first) & (overlay.at <= last)
    factor = find_channel_label(overlay.channel).factor
    signals = (overlay.measured, overlay.before, overlay.after)
    visible = factor * np.concatenate([signal[rows] for signal in signals])
    if np.isfinite(visible).any() and np.nanmax(visible) > np.nanmin(visible):
        low, high = float(np.nanmin(visible)), float(np.nanmax(visible))
        margin = 0.06 * (high - low)
        grid[0, 1].set_ylim(low - margin, high + margin)
    for axes in grid[:, 0]:
        axes.axvspan(first, last, color=PALE, alpha=0.6, linewidth=0.0, zorder=0.3)
    for axes in grid[:, 1]:
        axes.set_ylabel("")
    grid[0, 0].set_title("whole recording")
    grid[0, 1].set_title("largest error, enlarged")
    grid[1, 1].locator_params(axis="x", nbins=4)
    legend_below(figure, [grid[0, 0]], 3)


def worst_stretch(at: Array, error: Array) -> tuple[float, float]:
    """Return start and end of the nan-free interval with the largest mean square error."""
    is_gap = ~np.isfinite(at)
    interval_ids = np.cumsum(is_gap)
    intervals = [(interval_ids == interval_id) & ~is_gap for interval_id in np.unique(interval_ids)]
    intervals = [rows for rows in intervals if np.isfinite(error[rows]).any()]
    if not intervals:
        return 0.0, 1.0
    worst = at[max(intervals, key=lambda rows: np.nanmean(error[rows] ** 2))]
    return float(worst[0]), float(worst[-1])


def _overlay_column(
    panels: list[Axes], answer: Explanation, overlay: Overlay, as_lines: bool
) -> None:
    display = find_channel_label(overlay.channel)
    measured = display.factor * overlay.measured
    simulated = [
        ("simulated, old model", display.factor * overlay.before, BEFORE, "^"),
        ("simulated, new model", display.factor * overlay.after, AFTER, "s"),
    ]
    if not answer.effects:
        simulated = [("simulated", display.factor * overlay.before, AFTER, "s")]
    values, residuals = panels
    style: dict[str, Any] = {"lw": 0.9, "zorder": 2.0, "rasterized": True}
    if not as_lines:
        style = {"lw": 0.8, "zorder": 2.4, "marker": "o", "ls": "", "ms": 3.4}
    values.plot(overlay.at, measured, color=BLACK, label="measured", **style)
    floors = [
        display.factor * gap.floor
        for gap in answer.gaps
        if overlay.channel.startswith(gap.channel) and isfinite(gap.floor)
    ]
    spread(residuals, floors[0] if floors else float("nan"), "noise-floor")
    for label, model, color, marker in simulated:
        style = {"color": color, "label": label}
        if as_lines:
            dashes = "--" if color == BEFORE else "-"
            values.plot(overlay.at, model, lw=1.2, ls=dashes, zorder=2.2, rasterized=True, **style)
            residuals.plot(overlay.at, measured - model, lw=0.8, rasterized=True, **style)
        else:
            values.plot(
                overlay.at, model, f"{marker}-", ms=5.0, mfc="none", lw=0.8, zorder=2.2, **style
            )
            residuals.plot(overlay.at, measured - model, marker, ms=4.5, mfc="none", **style)
    values.set_ylabel(f"{display.title} [{display.unit}]")
    residuals.set_ylabel(f"measured −\nsimulated [{display.unit}]", fontsize=8.4)
    residuals.set_xlabel(AXES.get(overlay.axis, overlay.axis))
