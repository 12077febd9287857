"""What a new model has that the old one had not, in words and as a table."""

from __future__ import annotations

from dataclasses import dataclass
from math import isclose
from pathlib import Path

from benchtool.core.parameter import Parameter
from benchtool.explain.added_model import MODEL, NEAREST, NOTHING, added_effects, updated_model
from benchtool.explain.answer import Answer, channel_words
from benchtool.explain.found.draft import FOUND
from benchtool.report.numbers import unit_for_people
from benchtool.report.page import Table


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


def changes(answer: Answer) -> tuple[Change, ...]:
    """Return where the new model differs from the old, what was found first; none without one."""
    if not answer.has_model:
        return ()
    old = answer.request.loaded.model.parameters
    named = {effect.name for effect in added_effects(answer)}

    def change(name: str, item: Parameter) -> Change:
        before = old[name].value if name in old else None
        return Change(name, before, item.value, item.unit, name.partition(".")[0] in named)

    new = updated_model(answer)
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


def changes_table(answer: Answer) -> Table:
    """List what is new in the new model."""
    return Table(
        "What is different in the new model. Each value is the whole one, no addition to the old.",
        ("parameter", "why", "unit", "before", "now"),
        [
            (
                one.name,
                "found" if one.found else "adjusted within what was known of it",
                "–" if one.unit == "1" else unit_for_people(one.unit),
                "absent" if one.before is None else f"{one.before:.4g}",
                f"{one.now:.4g}",
            )
            for one in changes(answer)
        ],
        text_columns=3,
    )


def nearest_sentence(answer: Answer, folder: str) -> str:
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


def _draft(answer: Answer, folder: str) -> str:
    """Say where the law of something unknown is drafted."""
    found = answer.verdict.depends
    if found is None or found.law is None:
        return ""
    if not folder:
        return " A law of it can be drafted as an effect file: add --out FOLDER."
    return f" A law of it is drafted as an effect: {Path(folder) / FOUND}.py."


def added_sentence(answer: Answer, folder: str = "") -> str:
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
