"""Parameters of named effects in tolerances, so that all of them fit on one axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from benchtool.core.errors import InputError
from benchtool.report.palette import BLACK, GREY, PALE
from benchtool.report.style import new_figure, styled
from benchtool.report.sweep.overlay import AFTER


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectSize:
    """Hold one parameter for drawing, in tolerances from where its effect is absent.

    Attributes:
        label: effect and parameter.
        text: value and interval with their unit, as people read them.
        value: likeliest.
        low, high: 95 % interval.
    """

    label: str
    text: str
    value: float
    low: float
    high: float


@styled
def effect_size_figure(sizes: Sequence[EffectSize], *, title: str, simulated: bool) -> Figure:
    """Draw a point with its interval per parameter; the band is what would not have mattered."""
    if not sizes:
        raise InputError("a figure of effect sizes needs at least one parameter")
    figure = new_figure(title, simulated=simulated, height_in=1.25 + 0.5 * len(sizes))
    axes = figure.subplots()
    axes.axvspan(-1.0, 1.0, color=PALE, linewidth=0.0, zorder=0.4, gid="tolerance")
    axes.axvline(0.0, color=GREY, lw=0.9)
    reach = 1.25 * max(1.6, *(max(abs(size.low), abs(size.high)) for size in sizes))
    for row, size in enumerate(sizes):
        side = "right" if size.value > 0.4 * reach else "center"
        side = "left" if size.value < -0.4 * reach else side
        axes.errorbar(
            size.value, row, xerr=[[size.value - size.low], [size.high - size.value]], fmt="o",
            color=AFTER, lw=1.8, capsize=3.5,
        )  # fmt: skip
        axes.annotate(
            size.text, (size.value, row), xytext=(0.0, 8.0), textcoords="offset points",
            ha=side, fontsize=8.4, color=BLACK,
        )  # fmt: skip
    axes.set_yticks(range(len(sizes)), [size.label for size in sizes])
    axes.set_ylim(len(sizes) - 0.4, -0.75)
    least, most = min(size.low for size in sizes), max(size.high for size in sizes)
    axes.set_xlim(-reach if least < 0.0 else -1.6, reach if most > 0.0 else 1.6)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("distance from absent, in tolerances [–]    (grey: would not have mattered)")
    return figure
