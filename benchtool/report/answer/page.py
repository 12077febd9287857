"""The report page of an answer: the sentence first, then where, which, the gap, what to do next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isclose
from pathlib import Path

import numpy as np

from benchtool import __version__
from benchtool.core.parameter import Parameter
from benchtool.explain.answer import ExplainResult, channel_words
from benchtool.explain.engine.held_out import UPPER
from benchtool.explain.engine.verdict import EVERYWHERE, PLACES
from benchtool.explain.law_search.draft import FOUND
from benchtool.explain.next_steps import lines, next_sentence, next_steps
from benchtool.explain.updated_model import (
    MODEL,
    NEAREST,
    NOTHING,
    added_effects,
    model_with_effects,
)
from benchtool.report.answer.figures import gap_numbers, parameter_text
from benchtool.report.answer.tables import (
    effects_table,
    gap_table,
    next_table,
    tolerances_table,
    unjudged_sentence,
)
from benchtool.report.figure import Page
from benchtool.report.numbers import display_unit
from benchtool.report.page import (
    Block,
    Commands,
    FactTable,
    FigureBlock,
    Paragraph,
    Report,
    Section,
    Table,
    Warnings,
)
from benchtool.report.run_facts import run_sections


@dataclass(frozen=True, slots=True)
class Change:
    """Hold a number in which the new model differs from the old."""

    name: str
    before: float | None  # None where the old model has no such effect
    now: float  # whole value, not an addition
    unit: str
    found: bool  # False for an adjustment of another effect

    @property
    def words(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        before = "absent" if self.before is None else f"{self.before:.4g}"
        return f"{self.name} = {self.now:.4g}{unit} ({before} before)"


def changes(answer: ExplainResult) -> tuple[Change, ...]:
    """Return where the new model differs from the old, what was found first; none without one."""
    if not answer.has_model:
        return ()
    old = answer.request.loaded.model.parameters
    named = {effect.name for effect in added_effects(answer)}

    def change(name: str, item: Parameter) -> Change:
        before = old[name].value if name in old else None
        return Change(name, before, item.value, item.unit, name.partition(".")[0] in named)

    new = model_with_effects(answer)
    fresh = answer.request.loaded.model
    for effect in new.effects:
        if all(present.name != effect.name for present in fresh.effects):
            fresh = fresh.with_effect(effect)
    moved = [
        change(name, item)
        for name, item in new.parameters.items()
        if not isclose(fresh.parameters[name].value, item.value, abs_tol=NOTHING)
    ]
    return tuple(sorted(moved, key=lambda one: not one.found))


def changes_table(answer: ExplainResult) -> Table:
    """List what is new in the new model."""
    return Table(
        "What is different in the new model. Each value is the whole one, no addition to the old.",
        ("parameter", "why", "unit", "before", "now"),
        [
            (
                one.name,
                "found" if one.found else "adjusted within what was known of it",
                "–" if one.unit == "1" else display_unit(one.unit),
                "absent" if one.before is None else f"{one.before:.4g}",
                f"{one.now:.4g}",
            )
            for one in changes(answer)
        ],
        text_columns=3,
    )


def nearest_sentence(answer: ExplainResult, folder: str) -> str:
    """Say what the nearest effect of something unknown would leave, and where its model is."""
    near = answer.verdict.nearest
    if near is None or near.effect is None:
        return ""
    left = []
    for gap in answer.verdict.gaps:
        words = channel_words(gap.channel, gap.unit)
        errors = (gap.before, near.after[gap.channel], gap.floor)
        shown = [f"{words.factor * error:.3g}" for error in errors]
        left.append(f"{words.title} {shown[0]} → {shown[1]} {words.unit} (floor {shown[2]})")
    file = f" {Path(folder) / NEAREST} has it, for simulations meanwhile." if folder else ""
    return f" With {near.phrase}, the nearest, the gap would be: {', '.join(left)}.{file}"


def _draft(answer: ExplainResult, folder: str) -> str:
    """Say where the law of something unknown is drafted."""
    found = answer.verdict.depends
    if found is None or found.law is None:
        return ""
    if not folder:
        return " A law of it can be drafted as an effect file: add --out FOLDER."
    return f" A law of it is drafted as an effect: {Path(folder) / FOUND}.py."


def added_sentence(answer: ExplainResult, folder: str = "") -> str:
    """Say what was added, and to which file of a folder; empty where nothing is written."""
    kind = answer.verdict.kind
    old = answer.request.loaded.model.name
    if not answer.has_model:
        why = "nothing is missing" if kind == "none" else "no effect is named"
        beside = nearest_sentence(answer, folder)
        return f"No new model: {why}, so {old} stays as it is.{_draft(answer, folder)}{beside}"
    names = " and ".join(effect.phrase for effect in added_effects(answer))
    guess = ", the likeliest of the class," if kind == "class" else ""
    if not folder:
        return f"Not written yet: a model that is {old} with {names}{guess} in it."
    return f"Written: {Path(folder) / MODEL}, which is {old} with {names}{guess} in it."


def where_sentence(answer: ExplainResult) -> str:
    """Say where model and measurement disagree."""
    where = answer.verdict.where
    if where is None:
        return _agreement(answer)
    text = f"The disagreement is {PLACES[where.stage]}"
    shown = f"{where.size:.0f}" if where.size >= 10.0 else f"{where.size:.2g}"
    size = f"{shown} times the stated noise"
    if where.regime == EVERYWHERE:
        return f"{text}, spread over the whole of the recordings; residuals are {size}."
    return (
        f"{text}, most of it in: {where.regime}. There residuals are {size}, and "
        f"{100.0 * where.share:.0f} % of the disagreement lies there."
    )


def _agreement(answer: ExplainResult) -> str:
    """Say how near a model that lacks nothing is to its check recordings."""
    learned, over = answer.explanation.floors_as_learned, []
    for gap in answer.verdict.gaps:
        words = channel_words(gap.channel, gap.unit)
        high = float(np.quantile(learned.get(gap.channel, [gap.floor_high]), UPPER))
        if gap.after > high:
            values = (f"{words.factor * value:.3g} {words.unit}" for value in (gap.after, high))
            over.append(f"{words.title} by {' where noise stays below '.join(values)}")
    if not over:
        return "The model agrees with the recordings within their noise and the tolerances."
    return (
        f"Nothing stands out beyond the tolerances, yet the check recordings are missed by more "
        f"than noise: {', '.join(over)}."
    )


def _now(answer: ExplainResult, next_name: str, folder: str) -> list[Block]:
    """Say what was added to which file, and what to do next."""
    blocks: list[Block] = [Paragraph(added_sentence(answer, folder))]
    if answer.has_model:
        blocks.append(changes_table(answer))
    if to_do := next_sentence(answer):
        blocks.append(Paragraph(to_do))
    if next_name:
        blocks += [Paragraph(f"It stands in {next_name} beside this page."), next_table(answer)]
    steps = next_steps(answer, folder) if folder else ()
    if steps:
        blocks.append(Paragraph("Next, typed where the command was that made this page:"))
        blocks.append(Commands(lines(steps)))
    return blocks


def _not_judged(answer: ExplainResult) -> list[Block]:
    names = answer.verdict.not_judged
    blocks: list[Block] = [Warnings(answer.remarks)] if answer.remarks else []
    if names:
        sentences = {answer.title_of(name): unjudged_sentence(answer, name) for name in names}
        blocks.append(FactTable(sentences))
    return blocks or [Paragraph("Every effect of this kind of bench was judged.")]


def _facts(answer: ExplainResult) -> Block:
    verdict, model = answer.verdict, answer.request.loaded.model
    facts = {
        "model": f"{model.name} ({answer.request.model_file})",
        "rig": f"{model.rig.name}: {model.rig.title}",
        "bench": verdict.bench,
        "learned from": ", ".join(source.name for source in answer.request.learn),
        "checked on": ", ".join(source.name for source in answer.request.check),
        "seed": str(answer.seed),
        "took": f"{answer.seconds:.1f} s",
        "software": f"benchtool {__version__}",
    }
    return FactTable(
        facts | {f"sha256 of {name}": digest for name, digest in answer.hashes.items()}
    )


def _highlights(answer: ExplainResult) -> dict[str, str]:
    verdict = answer.verdict
    shown = {
        f"{effect.title}: {item.name}": parameter_text(item)
        for effect in verdict.effects[:2]
        for item in effect.parameters[:2]
    }
    for gap in verdict.gaps[:1]:
        title = channel_words(gap.channel, gap.unit).title
        shown[f"gap of {title}"] = gap_numbers(gap, answer.has_model)
    return shown


def _depends(answer: ExplainResult) -> Block | None:
    """Say what was weighed, and how a law is scored; None where nothing depends on anything."""
    found = answer.verdict.depends
    if found is None:
        return None
    text = (
        f"What is missing depends on {found.phrase}, probability {found.probability:.2f} among "
        f"{found.candidates} pairs of a variable and where it acts, which are paid for."
    )
    if found.law is None:
        return Paragraph(f"{text} No law of it closes enough of the gap to be drafted.")
    numbers = ", ".join(f"{name} = {value:.4g}" for name, value in found.law.values.items())
    return Paragraph(
        f"{text} The shortest law is {found.formula} with {numbers}. Laws that were chosen without "
        f"a tenth of the readings close {100.0 * found.closed:.0f} % of the squared gap there. It "
        f"describes, it does not explain: its cause is for a person to name."
    )


FLOOR = (
    "The floor is never taken from these residuals: the model, taken for true, is held against "
    "data that it simulated itself, median of {0.verdict.draws} draws of the stated sensor and "
    "wake noise."
)
ANSWER = Page(
    "answer",
    [
        ("Where", [lambda answer: Paragraph(where_sentence(answer)), "where"]),
        (
            "Which",
            [
                lambda answer: Paragraph(answer.verdict.sentence),
                lambda answer: effects_table(answer) if answer.verdict.effects else None,
                *("parameters", "which"),
            ],
        ),
        ("What it depends on", [_depends, "depends"]),
        ("The gap", [gap_table, lambda answer: Paragraph(FLOOR.format(answer)), "gap", "overlay"]),
        ("Tolerances", [tolerances_table]),
        ("What was not judged", [_not_judged]),
        ("What stands behind it", [_facts]),
        lambda answer: run_sections(each.path for each in answer.request.sources),
    ],
    title="Explanation: {0.request.loaded.model.name}",
    summary=lambda answer: f"{answer.verdict.sentence} {answer.caution}".strip(),
    highlights=_highlights,
)


def answer_page(
    answer: ExplainResult, figures: Mapping[str, FigureBlock], next_name: str = "", folder: str = ""
) -> Report:
    """Return the report page of an answer."""
    report = ANSWER.report(answer, answer.commands, figures)
    now = Section("What now", _now(answer, next_name, folder))
    return replace(report, sections=[now, *report.sections])
