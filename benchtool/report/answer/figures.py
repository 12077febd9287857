"""The figures of an answer, from its verdict and curves to the report's plain values."""

from __future__ import annotations

from math import isfinite

from benchtool.explain.answer import Answer, channel_words
from benchtool.explain.engine.explanation import Disagreement, Overlay
from benchtool.explain.engine.verdict import (
    ChannelGap,
    FoundParameter,
    NamedEffect,
    WhereShown,
    stage_words,
)
from benchtool.report.answer.disagreement import StageSizes, disagreement_figure
from benchtool.report.answer.gap import GapBar, gap_figure
from benchtool.report.answer.probabilities import probability_figure
from benchtool.report.flight.effect_sizes import EffectSize, effect_size_figure
from benchtool.report.numbers import unit_for_people, value_with_sd
from benchtool.report.page import Figure
from benchtool.report.sweep.overlay import Curves, overlay_figure

AXES = {"time_s": "time [s]", "z_over_R": "$z/R$ [–]"}
"""Labels of what an overlay is drawn against."""


def answer_figures(answer: Answer) -> dict[str, Figure]:
    """Return every figure that an answer has, by the name of its file, in the order of the page."""
    verdict = answer.verdict
    figures: dict[str, Figure] = {}
    stages = [_stage(answer, item) for item in answer.explanation.disagreements if item.by_regime]
    if stages:
        figures["where"] = disagreement_figure(
            stages, title="Where the model disagrees", simulated=answer.simulated
        )
    for place in verdict.places:
        several = verdict.kind == "several"
        figures[f"which_{place.effect}" if several else "which"] = probability_figure(
            place.probabilities,
            (place.effect,) if several else verdict.names or (verdict.kind,),
            title=f"What may stand in the place of {place.effect}"
            if several
            else "How likely each explanation is",
            simulated=answer.simulated,
        )
    sizes = [_size(effect, item) for effect in verdict.effects for item in effect.parameters]
    if sizes:
        figures["parameters"] = effect_size_figure(
            sizes, title="What was found, against what would not matter", simulated=answer.simulated
        )
    if verdict.gaps:
        figures["gap"] = gap_figure(
            [_bar(gap, answer.has_model) for gap in verdict.gaps],
            title="The gap on the check recordings",
            simulated=answer.simulated,
        )
    for overlay in answer.explanation.overlays:
        figures[f"overlay_{overlay.channel}"] = _overlay(answer, overlay)
    return figures


def gap_numbers(gap: ChannelGap, changed: bool) -> str:
    """Return before, after and floor of a gap as people read them."""
    words = channel_words(gap.channel, gap.unit)
    digits = 3
    before, after, floor = (
        f"{words.factor * value:.{digits}g}" for value in (gap.before, gap.after, gap.floor)
    )
    shown = f"{before} → {after}" if changed else before
    return f"{shown} {words.unit}  (floor {floor})"


def parameter_text(item: FoundParameter) -> str:
    """Return a value with its standard deviation and unit."""
    unit = "" if item.unit == "1" else f" {unit_for_people(item.unit)}"
    return f"{value_with_sd(item.value, item.std)}{unit}"


def _stage(answer: Answer, item: Disagreement) -> StageSizes:
    where = answer.verdict.where
    return StageSizes(
        stage=stage_words(item.stage),
        before=item.by_regime,
        after=item.after,
        marked=where.regime if where is not None and _shows(answer, item, where) else "",
        changed=answer.has_model,
    )


def _shows(answer: Answer, item: Disagreement, where: WhereShown) -> bool:
    """Tell whether the verdict's stage shows in these rows; thrust shows in the beam's motion."""
    drawn = {other.stage for other in answer.explanation.disagreements if other.by_regime}
    if where.stage in drawn:
        return item.stage == where.stage
    return item.stage != "pwm_to_rpm"


def _size(effect: NamedEffect, item: FoundParameter) -> EffectSize:
    return EffectSize(
        label=f"{effect.name}\n{item.name}",
        text=parameter_text(item),
        value=(item.value - item.neutral) / item.tolerance,
        low=(item.low - item.neutral) / item.tolerance,
        high=(item.high - item.neutral) / item.tolerance,
    )


def _bar(gap: ChannelGap, changed: bool) -> GapBar:
    return GapBar(
        channel=channel_words(gap.channel, gap.unit).title,
        text=gap_numbers(gap, changed),
        before=gap.before,
        after=gap.after,
        before_range=(gap.before_low, gap.before_high),
        after_range=(gap.after_low, gap.after_high),
        floor=gap.floor,
        floor_range=(gap.floor_low, gap.floor_high),
        as_given=gap.as_given,
        changed=changed,
    )


def _overlay(answer: Answer, overlay: Overlay) -> Figure:
    words = channel_words(overlay.channel, overlay.unit)
    floors = [
        words.factor * gap.floor
        for gap in answer.verdict.gaps
        if overlay.channel.startswith(gap.channel) and isfinite(gap.floor)
    ]
    curves = Curves(
        label=f"{words.title} [{words.unit}]",
        place=AXES.get(overlay.axis, overlay.axis),
        at=overlay.at,
        measured=words.factor * overlay.measured,
        before=words.factor * overlay.before,
        after=words.factor * overlay.after,
        floor=floors[0] if floors else float("nan"),
        as_lines=answer.verdict.bench == "pitch",
        changed=answer.has_model,
    )
    what = "recording" if answer.verdict.bench == "pitch" else "sweep"
    title = f"{words.title.capitalize()} on the check {what}"
    return overlay_figure(curves, title=title, simulated=answer.simulated)
