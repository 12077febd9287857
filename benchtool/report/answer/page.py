"""Report page of an explanation: next steps, disagreement, effects, gap, tolerances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isclose
from pathlib import Path

import numpy as np

from benchtool import __version__
from benchtool.explain.engine.subject import FLOOR_QUANTILE
from benchtool.explain.laws import DRAFT_NAME
from benchtool.explain.next_steps import (
    MODEL,
    NEAREST,
    ZERO_TOLERANCE,
    added_effects,
    format_steps,
    model_with_effects,
    next_sentence,
    next_steps,
)
from benchtool.explain.result import ALL_REGIMES, STAGE_LOCATIONS, Explanation
from benchtool.report.answer.figures import find_channel_label, gap_numbers, parameter_text
from benchtool.report.answer.tables import (
    effects_table,
    gap_table,
    next_table,
    tolerances_table,
    unjudged_sentence,
)
from benchtool.report.figure import FigureBlock
from benchtool.report.numbers import display_unit
from benchtool.report.page import Block, Commands, Page, Report, Section, Table, Warnings
from benchtool.report.run_facts import run_sections


@dataclass(frozen=True, slots=True)
class Change:
    """Parameter with different values in the new and the old model."""

    name: str
    before: float | None  # None: the old model has no such effect
    now: float  # absolute value, not an increment
    unit: str
    found: bool  # False for an adjustment of another effect

    @property
    def words(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        before = "absent" if self.before is None else f"{self.before:.4g}"
        return f"{self.name} = {self.now:.4g}{unit} ({before} before)"


def changes(answer: Explanation) -> tuple[Change, ...]:
    """Return the parameters changed in the new model, identified ones first; empty without one."""
    if not answer.effects:
        return ()
    named = {effect.name for effect in added_effects(answer)}
    new, reference = model_with_effects(answer), answer.request.loaded.model
    old = {name: item.value for name, item in reference.parameters.items()}
    for effect in new.effects:
        if all(present.name != effect.name for present in reference.effects):
            reference = reference.with_effect(effect)
    changed = [
        Change(name, old.get(name), item.value, item.unit, name.partition(".")[0] in named)
        for name, item in new.parameters.items()
        if not isclose(reference.parameters[name].value, item.value, abs_tol=ZERO_TOLERANCE)
    ]
    return tuple(sorted(changed, key=lambda item: not item.found))


def changes_table(answer: Explanation) -> Table:
    """Return a table of the changes in the new model."""
    return Table(
        "Changes in the new model. Values are absolute, not increments.",
        ("parameter", "reason", "unit", "before", "after"),
        [
            (
                change.name,
                "found" if change.found else "adjusted within its uncertainty or tolerance",
                display_unit(change.unit),
                "absent" if change.before is None else f"{change.before:.4g}",
                f"{change.now:.4g}",
            )
            for change in changes(answer)
        ],
        text_columns=3,
    )


def nearest_sentence(answer: Explanation, folder: str) -> str:
    """Return a sentence on the gap with the nearest effect, and the path of its model."""
    nearest = answer.nearest
    if nearest is None:
        return ""
    gaps = []
    for gap in answer.gaps:
        display = find_channel_label(gap.channel)
        errors = (gap.before, nearest.after[gap.channel], gap.floor)
        texts = [f"{display.factor * error:.3g}" for error in errors]
        gaps.append(f"{display.title} {texts[0]} → {texts[1]} {display.unit} (floor {texts[2]})")
    file = f" {Path(folder) / NEAREST} contains it, for interim simulations." if folder else ""
    text = f" With {nearest.effect.phrase}, the nearest effect, the gap would be:"
    return f"{text} {', '.join(gaps)}.{file}"


def added_sentence(answer: Explanation, folder: str = "") -> str:
    """Return a sentence on the effects added to the model, and its file if there is a folder."""
    kind = answer.kind
    old = answer.request.loaded.model.name
    if not answer.effects:
        reason = "nothing is missing" if kind == "none" else "no effect is named"
        draft = " Its law can be drafted as an effect file: add --out FOLDER."
        if answer.depends is None or answer.depends.law is None:
            draft = ""
        elif folder:
            draft = f" Its law is drafted as an effect: {Path(folder) / DRAFT_NAME}.py."
        nearest = nearest_sentence(answer, folder)
        return f"No new model: {reason}, so {old} is unchanged.{draft}{nearest}"
    names = " and ".join(effect.phrase for effect in added_effects(answer))
    remark = ", the most probable of the class," if kind == "class" else ""
    if not folder:
        return f"Not written (no --out): {old} with {names}{remark} added."
    return f"Written: {Path(folder) / MODEL}, {old} with {names}{remark} added."


def where_sentence(answer: Explanation) -> str:
    """Return a sentence on the largest disagreement, or on the error of a complete model."""
    where = answer.where
    if where is None:
        return _agreement(answer)
    text = f"The disagreement is {STAGE_LOCATIONS[where.stage]}"
    multiple = f"{where.size:.0f}" if where.size >= 10.0 else f"{where.size:.2g}"
    size = f"{multiple} times the stated noise"
    if where.regime == ALL_REGIMES:
        return f"{text}, over the whole recordings; residuals are {size}."
    return (
        f"{text}, mostly in: {where.regime}. Residuals are {size} there, "
        f"{100.0 * where.share:.0f} % of the disagreement."
    )


def _agreement(answer: Explanation) -> str:
    """Return a sentence on the error of a complete model on the validation recordings."""
    training_floors, excesses = answer.floors_as_learned, []
    for gap in answer.gaps:
        display = find_channel_label(gap.channel)
        limit = float(
            np.quantile(training_floors.get(gap.channel, [gap.floor_high]), FLOOR_QUANTILE)
        )
        if gap.after > limit:
            values = (
                f"{display.factor * value:.3g} {display.unit}" for value in (gap.after, limit)
            )
            excesses.append(f"{display.title} by {' with noise below '.join(values)}")
    if not excesses:
        return "The model agrees with the recordings within their noise and the tolerances."
    return (
        f"No effect exceeds its tolerance, but the error on the validation recordings is larger "
        f"than noise: {', '.join(excesses)}."
    )


def _now(answer: Explanation, next_name: str, folder: str) -> list[Block]:
    """Return blocks on the new model and on the next experiment and commands."""
    blocks: list[Block] = [added_sentence(answer, folder)]
    if answer.effects:
        blocks.append(changes_table(answer))
    if to_do := next_sentence(answer):
        blocks.append(to_do)
    if next_name:
        blocks += [f"File: {next_name}, in the folder of this page.", next_table(answer)]
    if steps := next_steps(answer, folder) if folder else ():
        blocks.append("Next commands, in the directory of the original command:")
        blocks.append(Commands(format_steps(steps)))
    return blocks


def _not_judged(answer: Explanation) -> list[Block]:
    blocks: list[Block] = [Warnings(answer.remarks)] if answer.remarks else []
    if names := answer.not_judged:
        blocks.append({answer.find_title(name): unjudged_sentence(answer, name) for name in names})
    return blocks or ["All effects of this kind of bench were judged."]


def _facts(answer: Explanation) -> Block:
    model = answer.request.loaded.model
    facts = {
        "model": f"{model.name} ({answer.request.model_file})",
        "rig": f"{model.rig.name}: {model.rig.title}",
        "bench": answer.bench,
        "learned from": ", ".join(source.name for source in answer.request.learn),
        "checked on": ", ".join(source.name for source in answer.request.check),
        "seed": str(answer.seed),
        "took": f"{answer.seconds:.1f} s",
        "software": f"benchtool {__version__}",
    }
    return facts | {f"sha256 of {name}": digest for name, digest in answer.request.hashes.items()}


def _highlights(answer: Explanation) -> dict[str, str]:
    tiles = {
        f"{effect.title}: {item.name}": parameter_text(item)
        for effect in answer.effects[:2]
        for item in effect.parameters[:2]
    }
    for gap in answer.gaps[:1]:
        title = find_channel_label(gap.channel).title
        tiles[f"gap of {title}"] = gap_numbers(gap, bool(answer.effects))
    return tiles


def _depends(answer: Explanation) -> Block | None:
    """Return a paragraph on the dependence of the unnamed effect; None without one."""
    dependence = answer.depends
    if dependence is None:
        return None
    text = (
        f"The unnamed effect depends on {dependence.phrase}, probability "
        f"{dependence.probability:.2f} among {dependence.candidates} pairs of variable and point "
        f"of action; the probability accounts for their number."
    )
    if dependence.law is None:
        return f"{text} No law closes enough of the gap to be drafted."
    numbers = ", ".join(f"{name} = {value:.4g}" for name, value in dependence.law.values.items())
    return (
        f"{text} The shortest law is {dependence.formula} with {numbers}. In tenfold "
        f"cross-validation, laws close {100.0 * dependence.closed:.0f} % of the squared gap of the "
        f"held-out readings. The law is descriptive; it does not identify the cause."
    )


FLOOR = (
    "The floor does not depend on these residuals: it is the error of the model on data simulated "
    "with the same model, median of {0.draws} draws of the stated sensor and wake noise."
)
ANSWER = Page(
    "answer",
    [
        ("Where", [where_sentence, "where"]),
        (
            "Which",
            [
                lambda answer: answer.sentence,
                lambda answer: effects_table(answer) if answer.effects else None,
                *("parameters", "which"),
            ],
        ),
        ("What it depends on", [_depends, "depends"]),
        ("The gap", [gap_table, lambda answer: FLOOR.format(answer), "gap", "overlay"]),
        ("Tolerances", [tolerances_table]),
        ("What was not judged", [_not_judged]),
        ("What stands behind it", [_facts]),
        lambda answer: run_sections(source.path for source in answer.request.sources),
    ],
    title="Explanation: {0.request.loaded.model.name}",
    summary=lambda answer: f"{answer.sentence} {answer.caution}".strip(),
    highlights=_highlights,
)


def answer_page(
    answer: Explanation, figures: Mapping[str, FigureBlock], next_name: str = "", folder: str = ""
) -> Report:
    """Return the report page of an explanation."""
    report = ANSWER.report(answer, answer.commands, figures)
    now = Section("What now", _now(answer, next_name, folder))
    return replace(report, sections=[now, *report.sections])
