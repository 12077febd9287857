"""Prediction errors of each channel before and after, against what noise alone leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchtool.core.errors import InputError
from benchtool.report.palette import BLACK, GREY, PALE
from benchtool.report.style import new_figure, styled
from benchtool.report.sweep.overlay import AFTER, BEFORE

LOGARITHMIC_FROM = 12.0
"""Beyond so many times the noise an axis is logarithmic."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GapBar:
    """Hold one channel's errors for drawing, all root mean squares in one unit.

    Attributes:
        channel: for people ("pitch").
        text: the numbers with their unit ("0.91 → 0.31 deg").
        before, after: values; `after` equals `before` where nothing was added.
        before_range, after_range: 95 % intervals.
        floor: what a true model would miss, with its 5 to 95 % range in `floor_range`.
        as_given: of the model as its file states it.
        changed: whether something was added.
    """

    channel: str
    text: str
    before: float
    after: float
    before_range: tuple[float, float]
    after_range: tuple[float, float]
    floor: float
    floor_range: tuple[float, float]
    as_given: float
    changed: bool = True


@styled
def gap_figure(bars: Sequence[GapBar], *, title: str, simulated: bool) -> Figure:
    """Draw a pair of bars per channel in noise floors; the band is what noise alone gives."""
    if not bars:
        raise InputError("a figure of gaps needs at least one channel")
    figure = new_figure(title, simulated=simulated, height_in=1.5 + 0.78 * len(bars))
    axes = figure.subplots()
    largest = max(max(bar.before_range[1], bar.as_given, bar.before) / bar.floor for bar in bars)
    for row, bar in enumerate(bars):
        _bar(axes, row, bar)
    axes.axvline(1.0, color=BLACK, lw=0.9)
    axes.set_yticks(range(len(bars)), [bar.channel for bar in bars])
    axes.set_ylim(len(bars) - 0.45, -0.62)
    if largest > LOGARITHMIC_FROM:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlim(min(0.5, *(0.7 * bar.after / bar.floor for bar in bars)), 4.0 * largest)
    else:
        axes.set_xlim(0.0, 1.45 * max(largest, 1.5))
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("prediction error over the noise floor [–]    (grey: 5 to 95 % of pure noise)")
    handles, labels = axes.get_legend_handles_labels()
    found = dict(zip(labels, handles, strict=True))
    axes.legend(
        list(found.values()), list(found), loc="lower right", ncols=3, bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.2,
    )  # fmt: skip
    return figure


def _bar(axes: Axes, row: int, bar: GapBar) -> None:
    low, high = (edge / bar.floor for edge in bar.floor_range)
    axes.fill_between(
        [low, high], row - 0.46, row + 0.46, color=PALE, linewidth=0.0, zorder=0.5,
        gid="noise-floor",
    )  # fmt: skip
    pairs = [("before", bar.before, bar.before_range, BEFORE)]
    if bar.changed:
        pairs.append(("after", bar.after, bar.after_range, AFTER))
    else:
        pairs = [("adjusted within tolerance", bar.before, bar.before_range, AFTER)]
    step = 0.4 if len(pairs) == 2 else 0.0
    for place, (label, value, span, color) in enumerate(pairs):
        y = row + (place - 0.5) * step
        axes.barh(
            y, value / bar.floor, height=0.34, color=color, label=label,
            hatch="//" if label == "before" else None, edgecolor="white", linewidth=0.0,
        )  # fmt: skip
        axes.plot([edge / bar.floor for edge in span], [y, y], color=BLACK, lw=1.1, zorder=3.0)
    axes.plot(
        bar.as_given / bar.floor, row - 0.5 * step, marker="D", ms=4.5, mfc="white", color=GREY,
        ls="none", label="as the file states it", zorder=3.2,
    )  # fmt: skip
    end = max(bar.before, bar.before_range[1], bar.as_given if bar.as_given > bar.before else 0.0)
    axes.annotate(
        bar.text, (end / bar.floor, row), xytext=(7.0, 0.0), textcoords="offset points",
        va="center", fontsize=8.2, color=BLACK,
    )  # fmt: skip
