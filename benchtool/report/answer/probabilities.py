"""How likely each explanation is, as bars, with what was answered marked."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from matplotlib.figure import Figure

from benchtool.core.errors import InputError
from benchtool.report.palette import BLACK, GREY
from benchtool.report.style import new_figure, styled
from benchtool.report.sweep.overlay import AFTER

MOST = 9
"""How many explanations are drawn at most; the rest share one bar."""

VISIBLE = 0.001
"""Less likely ones share that bar, too."""

ALWAYS = ("none", "unknown")
"""Explanations that are drawn however unlikely they are."""


@styled
def probability_figure(
    probabilities: Mapping[str, float], answered: Collection[str], *, title: str, simulated: bool
) -> Figure:
    """Draw one bar per explanation, the likeliest first.

    Args:
        probabilities: by explanation; they sum to 1.
        answered: those of the verdict.
        title: one line that says what is to be seen.
        simulated: whether no physical bench gave the data.
    """
    if not probabilities:
        raise InputError("a figure of probabilities needs at least one explanation")
    shown = _shown(probabilities)
    figure = new_figure(title, simulated=simulated, height_in=1.1 + 0.27 * len(shown))
    axes = figure.subplots()
    places = range(len(shown))
    axes.barh(
        places, list(shown.values()), height=0.64,
        color=[AFTER if name in answered else GREY for name in shown],
    )  # fmt: skip
    for y, value in zip(places, shown.values(), strict=True):
        axes.text(value + 0.012, y, percentage(value), va="center", fontsize=8.6, color=BLACK)
    axes.set_yticks(places, list(shown))
    for label, name in zip(axes.get_yticklabels(), shown, strict=True):
        label.set_fontweight("bold" if name in answered else "normal")
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_xlim(0.0, 1.12)
    axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "25 %", "50 %", "75 %", "100 %"])
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("probability")
    return figure


def percentage(value: float) -> str:
    """Return a probability as people read it, never quite 0."""
    if value < VISIBLE:
        return f"below {100.0 * VISIBLE:g} %"
    if 1.0 - VISIBLE < value < 1.0:
        return f"above {100.0 * (1.0 - VISIBLE):g} %"
    return f"{100.0 * value:.1f} %"


def _shown(probabilities: Mapping[str, float]) -> dict[str, float]:
    ranked = sorted(probabilities, key=lambda name: -probabilities[name])
    kept = [name for name in ranked if probabilities[name] >= VISIBLE][: MOST - 1]
    kept += [name for name in ALWAYS if name in probabilities and name not in kept]
    rest = [name for name in ranked if name not in kept]
    shown = {name: probabilities[name] for name in kept}
    if rest:
        shown[f"{len(rest)} others together"] = sum(probabilities[name] for name in rest)
    return shown
