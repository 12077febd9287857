"""Figures of an explanation: disagreement, probabilities, parameters, remaining gap."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from benchtool.explain.findings import AlternativeEffects, ChannelGap, Disagreement, FoundParameter
from benchtool.explain.result import Explanation
from benchtool.physics.effects.effect import Subsystem
from benchtool.report.figure import figure
from benchtool.report.numbers import value_with_sd, with_unit
from benchtool.report.palette import BLACK, BLUE, GREY, ORANGE, PALE
from benchtool.report.panels import named_rows, stack_panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


BEFORE, AFTER = ORANGE, BLUE  # colours of the model before and after an effect was added
LOGARITHMIC_FROM = 12.0  # multiple of the noise above which an axis is logarithmic
MAX_REGIMES = 6  # regimes per panel
MAX_BARS = 9  # explanations drawn; the remaining ones share one bar
VISIBLE = 0.001  # less probable explanations share that bar as well
ABOVE_RIGHT: dict[str, Any] = {  # position of a legend
    "loc": "lower right",
    "bbox_to_anchor": (1.0, 1.0),
    "borderaxespad": 0.2,
}
ALWAYS = ("none", "unknown")  # explanations drawn at any probability

STAGE_TITLES: dict[Subsystem, str] = {  # for headings and cells
    "pwm_to_rpm": "from pwm to rpm",
    "rpm_to_thrust": "from rpm to thrust",
    "hinge": "hinge",
    "sensor": "sensor",
    "plate": "plate",
}


class ChannelLabel(NamedTuple):
    """Display title and unit of a channel, with a factor on stored values."""

    title: str
    unit: str
    factor: float = 1.0


_CHANNELS = {
    "theta_rad": ChannelLabel("pitch", "deg", degrees(1.0)),
    "gyro_rad_s": ChannelLabel("pitch rate", "deg/s", degrees(1.0)),
    "thrust_N": ChannelLabel("thrust", "N"),
    "rpm": ChannelLabel("rotor speed", "rpm"),
}


def find_channel_label(channel: str) -> ChannelLabel:
    """Return display title, unit and factor of a channel."""
    rotor = ChannelLabel(f"speed of rotor {channel.removeprefix('rpm')}", "rpm")
    return _CHANNELS.get(channel, rotor)


def _disagreements(answer: Explanation) -> list[Disagreement]:
    """Return the stages with residuals, the largest first."""
    disagreements = [item for item in answer.disagreements if item.by_regime]
    return sorted(disagreements, key=lambda item: -max(item.by_regime.values()))


def _marked(answer: Explanation, item: Disagreement) -> str:
    """Return the regime of a stage named by the verdict, else ""; thrust acts on beam motion."""
    where = answer.where
    if where is None:
        return ""
    if where.stage in {other.stage for other in _disagreements(answer)}:
        return where.regime if item.stage == where.stage else ""
    return where.regime if item.stage != "pwm_to_rpm" else ""


def _regimes(answer: Explanation, item: Disagreement) -> list[str]:
    """Return regimes above noise by improvement, at least one, including the marked one."""
    before, after = item.by_regime, item.after if answer.effects else {}
    marked = _marked(answer, item)
    ranked = sorted(
        before, key=lambda name: before[name] ** 2 - after.get(name, 0.0) ** 2, reverse=True
    )
    above_noise = [name for name in ranked if before[name] > 1.0 or name == marked]
    ranked = above_noise or [max(before, key=lambda name: before[name])]
    visible = ranked[:MAX_REGIMES]
    if marked in ranked[MAX_REGIMES:]:
        visible[-1] = marked
    return visible


@figure(
    name="where",
    title="Where the model disagrees",
    caption="Residual size over the stated noise in each regime of the recordings, regimes above "
    "noise only, ordered by improvement. Bold: regime named by the verdict.",
    when=lambda answer: bool(_disagreements(answer)),
    height_in=lambda answer: (
        1.1 + sum(0.42 + 0.3 * len(_regimes(answer, item)) for item in _disagreements(answer))
    ),
)
def draw_disagreements(figure: Figure, answer: Explanation) -> None:
    """Draw one panel per stage and one bar per regime; 1 is noise alone."""
    stages, changed = _disagreements(answer), bool(answer.effects)
    xlabel = "residual size over the stated noise [–]    (line: noise alone)"
    heights = [len(_regimes(answer, item)) for item in stages]
    panels = stack_panels(figure, heights, xlabel=xlabel)
    half, height = (0.19, 0.36) if changed else (0.0, 0.6)
    for axes, item in zip(panels, stages, strict=True):
        names = _regimes(answer, item)
        positions = np.arange(len(names))
        axes.barh(
            positions - half, [item.by_regime[name] for name in names], height=height,
            color=BEFORE if changed else AFTER, label="before", hatch="//" if changed else None,
            edgecolor="white", linewidth=0.0,
        )  # fmt: skip
        if changed:
            sizes_after = [item.after.get(name, 0.0) for name in names]
            axes.barh(positions + half, sizes_after, height=height, color=AFTER, label="after")
        axes.axvline(1.0, color=BLACK, lw=1.0)
        named_rows(axes, names, [_marked(answer, item)], bottom=0.5, top=0.5)
        axes.set_title(STAGE_TITLES[item.stage])
    if max(stages[0].by_regime.values()) > LOGARITHMIC_FROM:
        panels[-1].set_xscale("log")
        panels[-1].set_xlim(left=0.5)
        panels[-1].xaxis.set_major_formatter("{x:g}")
    if changed:
        panels[0].legend(ncols=2, **ABOVE_RIGHT)


WHICH = "Posterior probability of each candidate; blue: verdict."
WHICH_OF_SEVERAL = (
    "Posterior probability of each candidate in place of one named effect, the other named effects "
    "assumed present; blue: verdict."
)


def shown_explanations(probabilities: Mapping[str, float]) -> dict[str, float]:
    """Return the most probable explanations and those always drawn; the others as one sum."""
    ranked = sorted(probabilities, key=lambda name: -probabilities[name])
    names = [name for name in ranked if probabilities[name] >= VISIBLE][: MAX_BARS - 1]
    names += [name for name in ALWAYS if name in probabilities and name not in names]
    others = [name for name in ranked if name not in names]
    bars = {name: probabilities[name] for name in names}
    if others:
        bars[f"{len(others)} others together"] = sum(probabilities[name] for name in others)
    return bars


def percentage(value: float) -> str:
    """Return a probability in percent; values near 0 and 1 as "below" and "above"."""
    if value < VISIBLE:
        return f"below {100.0 * VISIBLE:g} %"
    if 1.0 - VISIBLE < value < 1.0:
        return f"above {100.0 * (1.0 - VISIBLE):g} %"
    return f"{100.0 * value:.1f} %"


@figure(
    name="which",
    title=lambda answer, alternatives: (
        f"Alternatives to: {answer.find_title(alternatives.effect)}"
        if answer.kind == "several"
        else "Probability of each explanation"
    ),
    caption=lambda answer, _: WHICH_OF_SEVERAL if answer.kind == "several" else WHICH,
    each=lambda answer: {
        alternatives.effect if answer.kind == "several" else "": alternatives
        for alternatives in answer.alternatives
    },
    height_in=lambda _, item: 1.1 + 0.27 * len(shown_explanations(item.probabilities)),
)
def draw_probabilities(
    figure: Figure, answer: Explanation, alternatives: AlternativeEffects
) -> None:
    """Draw one bar per explanation, most probable first."""
    several = answer.kind == "several"
    named = (alternatives.effect,) if several else answer.names or (answer.kind,)
    bars = shown_explanations(alternatives.probabilities)
    axes = figure.subplots()
    colors = [AFTER if name in named else GREY for name in bars]
    axes.barh(range(len(bars)), list(bars.values()), height=0.64, color=colors)
    for y, value in enumerate(bars.values()):
        axes.text(value + 0.012, y, percentage(value), va="center", fontsize=8.6, color=BLACK)
    named_rows(axes, list(map(answer.find_title, bars)), map(answer.find_title, named))
    axes.set_xlim(0.0, 1.18)
    axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "25 %", "50 %", "75 %", "100 %"])
    axes.set_xlabel("probability")


def _parameters(answer: Explanation) -> dict[str, FoundParameter]:
    return {
        f"{effect.title}\n{item.name}": item
        for effect in answer.effects
        for item in effect.parameters
    }


def parameter_text(item: FoundParameter) -> str:
    """Return a value with its standard uncertainty and unit."""
    if not item.determined:
        return "not determined"
    return with_unit(value_with_sd(item.value, item.std), item.unit)


@figure(
    title="Effect parameters in units of their tolerance",
    caption="Each parameter with its 95 % interval, as distance from the value without effect in "
    "units of its tolerance.",
    when=lambda answer: bool(_parameters(answer)),
    height_in=lambda answer: 1.25 + 0.5 * len(_parameters(answer)),
)
def parameters(figure: Figure, answer: Explanation) -> None:
    """Draw one point with interval per parameter; grey band: within tolerance."""
    items = _parameters(answer)
    sizes = [
        [(value - item.neutral) / item.tolerance for value in (item.low, item.value, item.high)]
        for item in items.values()
    ]
    axes = figure.subplots()
    axes.axvspan(-1.0, 1.0, color=PALE, linewidth=0.0, zorder=0.4, gid="tolerance")
    axes.axvline(0.0, color=GREY, lw=0.9)
    lowest, highest = min(low for low, *_ in sizes), max(high for *_, high in sizes)
    reach = 1.25 * max(1.6, *(abs(end) for low, _, high in sizes for end in (low, high)))
    for row, (item, (low, value, high)) in enumerate(zip(items.values(), sizes, strict=True)):
        axes.errorbar(
            value, row, xerr=[[value - low], [high - value]], fmt="o", color=AFTER, lw=1.8,
            capsize=3.5,
        )  # fmt: skip
        alignment = "right" if value > 0.4 * reach else "left" if value < -0.4 * reach else "center"
        axes.annotate(
            parameter_text(item), (value, row), xytext=(0.0, 8.0), textcoords="offset points",
            ha=alignment, fontsize=8.4, color=BLACK,
        )  # fmt: skip
    named_rows(axes, list(items), top=0.75)
    axes.set_xlim(-reach if lowest < 0.0 else -1.6, reach if highest > 0.0 else 1.6)
    axes.set_xlabel("distance from absent, in tolerances [–]    (grey: within tolerance)")


def gap_numbers(gap: ChannelGap, changed: bool) -> str:
    """Return before, after and floor of a gap as text in display units."""
    display = find_channel_label(gap.channel)
    before, after, floor = (
        f"{display.factor * value:.3g}" for value in (gap.before, gap.after, gap.floor)
    )
    errors = f"{before} → {after}" if changed else before
    return f"{errors} {display.unit}  (floor {floor})"


@figure(
    title="Gap on the validation recordings",
    caption="Prediction error before (hatched) and after, relative to the noise floor; thin lines: "
    "95 % bootstrap intervals over windows. Diamonds: model file without adjustment.",
    when=lambda answer: bool(answer.gaps),
    height_in=lambda answer: 1.5 + 0.78 * len(answer.gaps),
)
def gap(figure: Figure, answer: Explanation) -> None:
    """Draw two bars per channel, relative to the noise floor; grey band: noise alone."""
    gaps = answer.gaps
    axes = figure.subplots()
    largest = max(max(item.before_high, item.as_given, item.before) / item.floor for item in gaps)
    for row, item in enumerate(gaps):
        _gap_bars(axes, row, item, bool(answer.effects))
    axes.axvline(1.0, color=BLACK, lw=0.9)
    titles = [find_channel_label(item.channel).title for item in gaps]
    named_rows(axes, titles, bottom=0.45, top=0.62)
    if largest > LOGARITHMIC_FROM:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlim(min(0.5, *(0.7 * item.after / item.floor for item in gaps)), 4.0 * largest)
    else:
        axes.set_xlim(0.0, 1.45 * max(largest, 1.5))
    axes.set_xlabel("prediction error over the noise floor [–]    (grey: 5 to 95 % of pure noise)")
    handles, labels = axes.get_legend_handles_labels()
    handle_by_label = dict(zip(labels, handles, strict=True))
    axes.legend(handle_by_label.values(), handle_by_label, ncols=3, **ABOVE_RIGHT)


def _gap_bars(axes: Axes, row: int, gap: ChannelGap, changed: bool) -> None:
    axes.fill_between(
        [gap.floor_low / gap.floor, gap.floor_high / gap.floor], row - 0.46, row + 0.46,
        color=PALE, linewidth=0.0, zorder=0.5, gid="noise-floor",
    )  # fmt: skip
    before = (gap.before, gap.before_low, gap.before_high)
    after = (gap.after, gap.after_low, gap.after_high)
    bars = [("adjusted within tolerance", 0.0, before, AFTER)]
    if changed:
        bars = [("before", -0.2, before, BEFORE), ("after", 0.2, after, AFTER)]
    for label, step, values, color in bars:
        value, low, high = (bound / gap.floor for bound in values)
        axes.barh(
            row + step, value, height=0.34, color=color, label=label,
            hatch="//" if label == "before" else None, edgecolor="white", linewidth=0.0,
        )  # fmt: skip
        axes.plot([low, high], [row + step] * 2, color=BLACK, lw=1.1, zorder=3.0)
    axes.plot(
        gap.as_given / gap.floor, row + bars[0][1], marker="D", ms=4.5, mfc="white", color=GREY,
        ls="none", label="model file", zorder=3.2,
    )  # fmt: skip
    end = max(gap.before, gap.before_high, gap.as_given)
    axes.annotate(
        gap_numbers(gap, changed), (end / gap.floor, row), xytext=(7.0, 0.0),
        textcoords="offset points", va="center", fontsize=8.2, color=BLACK,
    )  # fmt: skip


@figure(
    title=lambda answer: f"Unexplained share over {answer.depends.phrase}",
    caption="Dots: residual of each reading after adjustment within tolerance. Line with 95 % "
    "band: smooth function of the variable. Dashed: drafted law, up to a constant.",
    when=lambda answer: answer.depends is not None,
    height_in=3.4,
)
def depends(figure: Figure, answer: Explanation) -> None:
    """Draw residuals, a smooth function with its band, and the law shifted to its mean."""
    dependence = answer.depends
    assert dependence is not None
    curve, variable, axes = dependence.curve, dependence.variable, figure.subplots()
    axes.axhline(0.0, color=GREY, linewidth=0.9)
    axes.plot(curve.points, 100.0 * curve.shares, "o", ms=3.0, color=GREY, alpha=0.6)
    if variable.is_categorical:
        axes.plot(curve.at, 100.0 * curve.mean, "_", color=BLUE)
    else:
        axes.fill_between(
            curve.at, 100.0 * curve.low, 100.0 * curve.high, color=PALE, linewidth=0.0
        )
        axes.plot(curve.at, 100.0 * curve.mean, color=BLUE, label="smooth function")
    if len(curve.law):
        shift = float((curve.mean - curve.law).mean()) if dependence.form.name != "covered" else 0.0
        law = 100.0 * (curve.law + shift)
        axes.plot(curve.at, law, "--", color=ORANGE, label="law")
        axes.legend(loc="best")
    if variable.scale in ("positive", "distance") and 0.0 < 4.0 * curve.at[0] < curve.at[-1]:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xlabel(f"{variable.phrase}, {variable.symbol} [–]")
    axes.set_ylabel(f"missed [% of {dependence.form.quantity}]", color=BLACK)
