"""Measurement and two simulations on one channel, and closer where the old one is worst."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.report.fit.lengths import refuse_unequal
from benchtool.report.palette import BLACK, BLUE, GREY, ORANGE, PALE
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]

BEFORE, AFTER = ORANGE, BLUE
"""Colours of a model before and after something was added, in every figure of an explanation."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Curves:
    """Hold one channel for drawing.

    Attributes:
        label: of the axis, with its unit ("pitch [deg]").
        place: label of the other axis ("time [s]").
        at: (n,) places on it; nan where lines break.
        measured, before, after: (n,) in the label's unit.
        floor: root mean square that noise alone leaves; nan where nobody knows.
        as_lines: whether neighbours belong together (time), or each point stands by itself.
        changed: whether `after` is another model than `before`.
    """

    label: str
    place: str
    at: Array
    measured: Array
    before: Array
    after: Array
    floor: float = float("nan")
    as_lines: bool = True
    changed: bool = True

    def __post_init__(self) -> None:
        refuse_unequal(
            f"the overlay of {self.label}",
            at=self.at,
            measured=self.measured,
            before=self.before,
            after=self.after,
        )


@styled
def overlay_figure(curves: Curves, *, title: str, simulated: bool) -> Figure:
    """Draw one channel over its residuals; beside it, closer, where the old model is worst."""
    figure = new_figure(title, simulated=simulated, height_in=3.7)
    if not curves.as_lines:
        axes = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": [1.8, 1.0]})
        _values(axes[0], curves)
        _residuals(axes[1], curves)
        _legend(figure, axes[0])
        return figure
    panels = figure.subplots(
        2, 2, sharex="col",
        gridspec_kw={"height_ratios": [1.8, 1.0], "width_ratios": [2.0, 1.0]},
    )  # fmt: skip
    for column in (0, 1):
        _values(panels[0, column], curves)
        _residuals(panels[1, column], curves)
    first, last = worst_stretch(curves)
    panels[1, 1].set_xlim(first, last)
    panels[1, 1].sharey(panels[1, 0])
    _fit_height(panels[0, 1], curves, (curves.at >= first) & (curves.at <= last))
    for axes in panels[:, 0]:
        axes.axvspan(first, last, color=PALE, alpha=0.6, linewidth=0.0, zorder=0.3)
    for axes in panels[:, 1]:
        axes.set_ylabel("")
    panels[0, 0].set_title("whole recording")
    panels[0, 1].set_title("closer, where it is worst")
    panels[1, 1].locator_params(axis="x", nbins=4)
    _legend(figure, panels[0, 0])
    return figure


def _fit_height(axes: Axes, curves: Curves, rows: NDArray[np.bool_]) -> None:
    """Let the rows that a closer look shows fill its height."""
    shown = np.concatenate([curves.measured[rows], curves.before[rows], curves.after[rows]])
    if np.isfinite(shown).any() and np.nanmax(shown) > np.nanmin(shown):
        room = 0.06 * float(np.nanmax(shown) - np.nanmin(shown))
        axes.set_ylim(float(np.nanmin(shown)) - room, float(np.nanmax(shown)) + room)


def _legend(figure: Figure, axes: Axes) -> None:
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)


def worst_stretch(curves: Curves) -> tuple[float, float]:
    """Return begin and end of the unbroken stretch in which `before` is farthest off."""
    broken = ~np.isfinite(curves.at)
    number = np.cumsum(broken)
    worst, best = (0.0, 1.0), -1.0
    for piece in np.unique(number):
        rows = (number == piece) & ~broken
        error = (curves.measured - curves.before)[rows]
        if not np.isfinite(error).any():
            continue
        size = float(np.nanmean(error**2))
        if size > best:
            at = curves.at[rows]
            worst, best = (float(at[0]), float(at[-1])), size
    return worst


def _values(axes: Axes, curves: Curves) -> None:
    both = (("measured", curves.measured, BLACK, "o"), *_simulations(curves))
    for label, values, color, marker in both:
        if not curves.as_lines:
            measured = label == "measured"
            axes.plot(
                curves.at, values, marker=marker, color=color, ms=3.4 if measured else 5.0,
                mfc=color if measured else "none", label=label, lw=0.8,
                ls="none" if measured else "-", zorder=2.4 if measured else 2.2,
            )  # fmt: skip
            continue
        measured = label == "measured"
        axes.plot(
            curves.at, values, color=color, label=label, rasterized=True,
            lw=0.9 if measured else 1.2, ls="--" if color == BEFORE else "-",
            zorder=2.0 if measured else 2.2,
        )  # fmt: skip
    axes.set_ylabel(curves.label)


def _residuals(axes: Axes, curves: Curves) -> None:
    if np.isfinite(curves.floor):
        axes.axhspan(
            -curves.floor, curves.floor, color=PALE, linewidth=0.0, zorder=0.4, gid="noise-floor"
        )
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    for label, values, color, marker in _simulations(curves):
        error = curves.measured - values
        if curves.as_lines:
            axes.plot(curves.at, error, color=color, lw=0.8, label=label, rasterized=True)
        else:
            axes.plot(curves.at, error, marker, color=color, ms=4.5, mfc="none", label=label)
    unit = curves.label[curves.label.find("[") :] if "[" in curves.label else ""
    axes.set_ylabel(f"measured −\nsimulated {unit}".strip(), fontsize=8.4)
    axes.set_xlabel(curves.place)


def _simulations(curves: Curves) -> tuple[tuple[str, Array, str, str], ...]:
    if not curves.changed:
        return (("simulated", curves.before, AFTER, "s"),)
    return (
        ("simulated, old model", curves.before, BEFORE, "^"),
        ("simulated, new model", curves.after, AFTER, "s"),
    )
