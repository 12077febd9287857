"""The report page of an answer: the sentence first, then where, which, the gap, what to do next."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from benchtool import __version__
from benchtool.data.run.read import is_run
from benchtool.data.run.run import Run
from benchtool.explain.answer import Answer, channel_words
from benchtool.explain.engine.verdict import EVERYWHERE, PLACES
from benchtool.explain.next_steps import lines, next_sentence, next_steps
from benchtool.report.answer.added_words import added_sentence, changes_table
from benchtool.report.answer.figures import gap_numbers, parameter_text
from benchtool.report.answer.tables import (
    effects_table,
    gap_table,
    next_table,
    tolerances_table,
    unjudged_sentence,
)
from benchtool.report.page import (
    Block,
    Commands,
    Facts,
    Figure,
    FigureBlock,
    Paragraph,
    Report,
    Section,
    Warnings,
)
from benchtool.report.sweep.run_facts import simple_facts

CAPTIONS: dict[str, str] = {
    "where": (
        "Size of the residuals in each part of the recordings, over the noise that the model "
        "states; first those that the addition made smaller by most. What the verdict names is "
        "bold."
    ),
    "which": "Probability of each explanation that was weighed; the answer is blue.",
    "parameters": (
        "Each parameter with its 95 % interval, counted in tolerances from where its effect is "
        "absent."
    ),
    "gap": (
        "Prediction error before (hatched) and after, over what a true model would miss; thin "
        "lines: 95 % of a bootstrap over windows. Diamonds: the model as its file states it, "
        "before anything was adjusted within tolerance."
    ),
}
"""Captions of the figures but overlays."""

PLACE = (
    "Probability of each explanation for one of the named effects, the others taken for granted; "
    "the answer is blue."
)
"""Caption of each effect's own probabilities where several are named."""

OVERLAY = (
    "Measurement and predictions on the check recording; below, what is left over. The grey band "
    "is the noise floor."
)


def overlay_caption(window_s: float) -> str:
    """Say what an overlay shows, and where its jumps come from with windows of so many seconds."""
    if not window_s:
        return OVERLAY
    return (
        f"{OVERLAY} Each prediction restarts every {window_s:g} s from the measured state: that is "
        f"what the spikes are."
    )


def where_sentence(answer: Answer) -> str:
    """Say where model and measurement disagree."""
    where = answer.verdict.where
    if where is None:
        return "The model agrees with the recordings within their noise and the tolerances."
    said = f"The disagreement is {PLACES[where.stage]}"
    shown = f"{where.size:.0f}" if where.size >= 10.0 else f"{where.size:.2g}"
    size = f"{shown} times the stated noise"
    if where.regime == EVERYWHERE:
        return f"{said}, spread over the whole of the recordings; residuals are {size}."
    return (
        f"{said}, most of it in: {where.regime}. There residuals are {size}, and "
        f"{100.0 * where.share:.0f} % of the disagreement lies there."
    )


def answer_page(
    answer: Answer, figures: Mapping[str, Figure], next_name: str = "", folder: str = ""
) -> Report:
    """Return the report page of an answer.

    Args:
        answer: what is told.
        figures: of `answer_figures`.
        next_name: name of the file beside the page that holds the next experiment.
        folder: of the page, as it was typed; empty where nothing is written yet.
    """
    verdict = answer.verdict
    sections = [
        Section("What now", _now(answer, next_name, folder)),
        Section("Where", [Paragraph(where_sentence(answer)), *_figures(figures, "where")]),
        Section("Which", _which(answer, figures)),
        Section("The gap", _gap(answer, figures)),
        Section("Tolerances", [tolerances_table(answer)]),
        Section("What was not judged", _not_judged(answer)),
        Section("What stands behind it", [Facts(_facts(answer))]),
        *_runs(answer),
        Section("Made with", [Commands(answer.commands)]),
    ]
    return Report(
        title=f"Explanation: {answer.loaded.model.name}",
        summary=f"{verdict.sentence} {answer.caution}".strip(),
        sections=sections,
        simulated=answer.simulated,
        made=f"benchtool {__version__}",
        highlights=_highlights(answer),
    )


def _runs(answer: Answer) -> list[Section]:
    """Say of every run on what it was made, in which air and with which calibration."""
    return [
        Section(
            f"The run {source.name}", [Facts(simple_facts(Run.open(Path(source.path)).metadata))]
        )
        for source in (*answer.learn, *answer.check)
        if is_run(source.path)
    ]


def _figures(figures: Mapping[str, Figure], *names: str) -> list[Block]:
    return [FigureBlock(figures[name], CAPTIONS[name]) for name in names if name in figures]


def _which(answer: Answer, figures: Mapping[str, Figure]) -> list[Block]:
    blocks: list[Block] = [Paragraph(answer.verdict.sentence)]
    if answer.verdict.effects:
        blocks.append(effects_table(answer))
    blocks += _figures(figures, "parameters", "which")
    return [
        *blocks,
        *(
            FigureBlock(figure, PLACE)
            for name, figure in figures.items()
            if name.startswith("which_")
        ),
    ]


def _gap(answer: Answer, figures: Mapping[str, Figure]) -> list[Block]:
    overlays = [
        FigureBlock(figure, overlay_caption(answer.verdict.window_s))
        for name, figure in figures.items()
        if name.startswith("overlay_")
    ]
    said = (
        f"The floor is never taken from these residuals: the model, taken for true, is held "
        f"against data that it simulated itself, median of {answer.verdict.draws} draws of the "
        f"stated sensor and wake noise."
    )
    return [gap_table(answer), Paragraph(said), *_figures(figures, "gap"), *overlays]


def _now(answer: Answer, next_name: str, folder: str) -> list[Block]:
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


def _not_judged(answer: Answer) -> list[Block]:
    blocks: list[Block] = []
    if answer.remarks:
        blocks.append(Warnings(answer.remarks))
    if answer.verdict.not_judged:
        names = answer.verdict.not_judged
        blocks.append(Facts({name: unjudged_sentence(answer, name) for name in names}))
    if not blocks:
        blocks.append(Paragraph("Every effect of this kind of bench was judged."))
    return blocks


def _facts(answer: Answer) -> dict[str, str]:
    verdict, model = answer.verdict, answer.loaded.model
    facts = {
        "model": f"{model.name} ({answer.model_file})",
        "rig": f"{model.rig.name}: {model.rig.title}",
        "bench": verdict.bench,
        "learned from": ", ".join(source.name for source in answer.learn),
        "checked on": ", ".join(source.name for source in answer.check),
        "seed": str(answer.seed),
        "took": f"{answer.seconds:.1f} s",
        "software": f"benchtool {__version__}",
    }
    return facts | {f"sha256 of {name}": digest for name, digest in answer.hashes.items()}


def _highlights(answer: Answer) -> dict[str, str]:
    verdict = answer.verdict
    shown = {
        f"{effect.name}: {item.name}": parameter_text(item)
        for effect in verdict.effects[:2]
        for item in effect.parameters[:2]
    }
    for gap in verdict.gaps[:1]:
        title = channel_words(gap.channel, gap.unit).title
        shown[f"gap of {title}"] = gap_numbers(gap, answer.has_model)
    return shown
