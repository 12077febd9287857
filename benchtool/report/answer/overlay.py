"""One channel of an answer over its residuals: the measurement and what both models predict."""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchtool.core.array_type import Array
from benchtool.explain.answer import ExplainResult, channel_words
from benchtool.explain.engine.evidence import Overlay
from benchtool.report.answer.figures import AFTER, BEFORE
from benchtool.report.figure import figure
from benchtool.report.palette import BLACK, PALE
from benchtool.report.panels import legend_below, rows_of, spread

AXES = {"time_s": "time [s]", "z_over_R": "$z/R$ [–]"}  # labels of what an overlay is drawn against


OVERLAY = (
    "Measurement and predictions on the check recording; below, what is left over. The grey band "
    "is the noise floor."
)


def overlay_caption(window_s: float) -> str:
    """Say what an overlay shows, and where its jumps come from with windows of so many seconds."""
    if not window_s:
        return OVERLAY
    return (
        f"{OVERLAY} Each prediction restarts every {window_s:g} s from the measured state: that is "
        f"what the spikes are."
    )


def _overlay_title(answer: ExplainResult, overlay: Overlay) -> str:
    what = "recording" if answer.verdict.bench == "pitch" else "sweep"
    title = channel_words(overlay.channel, overlay.unit).title.capitalize()
    return f"{title} on the check {what}"


@figure(
    title=_overlay_title,
    caption=lambda answer, _: overlay_caption(answer.verdict.window_s),
    each=lambda answer: {item.channel: item for item in answer.explanation.overlays},
    height_in=3.7,
)
def overlay(figure: Figure, answer: ExplainResult, overlay: Overlay) -> None:
    """Draw one channel over its residuals; beside it, closer, where the old model is worst."""
    if answer.verdict.bench != "pitch":
        panels = rows_of(figure, (1.8, 1.0))
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
    factor = channel_words(overlay.channel, overlay.unit).factor
    shown = factor * np.concatenate(
        [overlay.measured[rows], overlay.before[rows], overlay.after[rows]]
    )
    if np.isfinite(shown).any() and np.nanmax(shown) > np.nanmin(shown):
        room = 0.06 * float(np.nanmax(shown) - np.nanmin(shown))
        grid[0, 1].set_ylim(float(np.nanmin(shown)) - room, float(np.nanmax(shown)) + room)
    for axes in grid[:, 0]:
        axes.axvspan(first, last, color=PALE, alpha=0.6, linewidth=0.0, zorder=0.3)
    for axes in grid[:, 1]:
        axes.set_ylabel("")
    grid[0, 0].set_title("whole recording")
    grid[0, 1].set_title("closer, where it is worst")
    grid[1, 1].locator_params(axis="x", nbins=4)
    legend_below(figure, [grid[0, 0]], 3)


def worst_stretch(at: Array, error: Array) -> tuple[float, float]:
    """Return begin and end of the stretch, unbroken by nan in `at`, with the largest error."""
    broken = ~np.isfinite(at)
    number = np.cumsum(broken)
    worst, best = (0.0, 1.0), -1.0
    for piece in np.unique(number):
        rows = (number == piece) & ~broken
        if not np.isfinite(error[rows]).any():
            continue
        size = float(np.nanmean(error[rows] ** 2))
        if size > best:
            worst, best = (float(at[rows][0]), float(at[rows][-1])), size
    return worst


def _overlay_column(
    panels: list[Axes], answer: ExplainResult, overlay: Overlay, as_lines: bool
) -> None:
    words = channel_words(overlay.channel, overlay.unit)
    measured = words.factor * overlay.measured
    simulated = [
        ("simulated, old model", words.factor * overlay.before, BEFORE, "^"),
        ("simulated, new model", words.factor * overlay.after, AFTER, "s"),
    ]
    if not answer.has_model:
        simulated = [("simulated", words.factor * overlay.before, AFTER, "s")]
    values, left = panels
    if as_lines:
        values.plot(
            overlay.at, measured, color=BLACK, label="measured", rasterized=True, lw=0.9, zorder=2.0
        )
    else:
        values.plot(
            overlay.at, measured, "o", color=BLACK, ms=3.4, label="measured", lw=0.8, zorder=2.4
        )
    floors = [
        words.factor * gap.floor
        for gap in answer.verdict.gaps
        if overlay.channel.startswith(gap.channel) and isfinite(gap.floor)
    ]
    spread(left, floors[0] if floors else float("nan"), "noise-floor")
    for label, model, color, marker in simulated:
        look: dict[str, Any] = {"color": color, "label": label}
        if as_lines:
            dashes = "--" if color == BEFORE else "-"
            values.plot(overlay.at, model, lw=1.2, ls=dashes, zorder=2.2, rasterized=True, **look)
            left.plot(overlay.at, measured - model, lw=0.8, rasterized=True, **look)
        else:
            values.plot(
                overlay.at, model, f"{marker}-", ms=5.0, mfc="none", lw=0.8, zorder=2.2, **look
            )
            left.plot(overlay.at, measured - model, marker, ms=4.5, mfc="none", **look)
    values.set_ylabel(f"{words.title} [{words.unit}]")
    left.set_ylabel(f"measured −\nsimulated [{words.unit}]", fontsize=8.4)
    left.set_xlabel(AXES.get(overlay.axis, overlay.axis))
