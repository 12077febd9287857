"""Where a model disagrees: size of its residuals in each part of the recordings, by stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchtool.core.errors import InputError
from benchtool.report.answer.gap import LOGARITHMIC_FROM
from benchtool.report.palette import BLACK
from benchtool.report.style import new_figure, styled
from benchtool.report.sweep.overlay import AFTER, BEFORE

MOST_REGIMES = 6
"""How many parts of a recording one panel shows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageSizes:
    """Hold one stage for drawing.

    Attributes:
        stage: heading of its panel.
        before, after: root mean square of whitened residuals by regime; 1 is noise.
        marked: the regime that the verdict names; "" for none.
        changed: whether something was added.
    """

    stage: str
    before: Mapping[str, float]
    after: Mapping[str, float]
    marked: str = ""
    changed: bool = True

    @property
    def shown(self) -> list[str]:
        """The regimes that are drawn, the marked one always among them.

        First come those whose mean square the addition took most from; the worst without one.
        """

        def taken(name: str) -> float:
            left = self.after.get(name, 0.0) if self.changed else 0.0
            return float(self.before[name] ** 2 - left**2)

        ranked = sorted(self.before, key=taken, reverse=True)
        shown = ranked[:MOST_REGIMES]
        if self.marked in ranked[MOST_REGIMES:]:
            shown[-1] = self.marked
        return shown


@styled
def disagreement_figure(stages: Sequence[StageSizes], *, title: str, simulated: bool) -> Figure:
    """Draw a panel per stage and a bar per regime; at 1 stands noise alone."""
    drawn = sorted(
        (stage for stage in stages if stage.before), key=lambda stage: -max(stage.before.values())
    )
    if not drawn:
        raise InputError("a figure of disagreements needs at least one stage with a regime")
    rows = [len(stage.shown) for stage in drawn]
    figure = new_figure(
        title, simulated=simulated, height_in=1.1 + 0.3 * sum(rows) + 0.42 * len(drawn)
    )
    panels = figure.subplots(
        len(drawn), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": rows}
    )[:, 0]
    for axes, stage in zip(panels, drawn, strict=True):
        _panel(axes, stage)
    panels[-1].set_xlabel("residual size over the stated noise [–]    (line: noise alone)")
    if max(max(stage.before.values()) for stage in drawn) > LOGARITHMIC_FROM:
        panels[-1].set_xscale("log")
        panels[-1].set_xlim(left=0.5)
        panels[-1].xaxis.set_major_formatter("{x:g}")
    if any(stage.changed for stage in drawn):
        panels[0].legend(
            loc="lower right", ncols=2, bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2
        )  # fmt: skip
    return figure


def _panel(axes: Axes, stage: StageSizes) -> None:
    names = stage.shown
    half = 0.19 if stage.changed else 0.0
    height = 0.36 if stage.changed else 0.6
    places = range(len(names))
    axes.barh(
        [y - half for y in places], [stage.before[name] for name in names], height=height,
        color=BEFORE if stage.changed else AFTER, label="before",
        hatch="//" if stage.changed else None, edgecolor="white", linewidth=0.0,
    )  # fmt: skip
    if stage.changed:
        axes.barh(
            [y + half for y in places], [stage.after.get(name, 0.0) for name in names],
            height=height, color=AFTER, label="after",
        )  # fmt: skip
    axes.axvline(1.0, color=BLACK, lw=1.0)
    axes.set_yticks(places, names)
    for label, name in zip(axes.get_yticklabels(), names, strict=True):
        if name == stage.marked:
            label.set_fontweight("bold")
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.set_title(stage.stage)
