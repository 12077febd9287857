"""Explain, in a process of its own: what `benchtool explain --out` does, its folder set aside.

The folder stands under a hidden name until somebody accepts it; then it gets its own.
"""

from __future__ import annotations

import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path

from benchtool.core.errors import InputError
from benchtool.data.atomic import complete_folder, partial_folder
from benchtool.explain.inputs import ExplainInputs
from benchtool.web.jobs import Job, PageSection, ReportProgress

FIGURE_SOURCE = 0.85  # share of progress at which figures are drawn; assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationResult:
    """Hold an answer as the page shows it.

    Attributes:
        sentence: the verdict, with what weighs on it.
        named: effects that the new model has more than the old; empty where none was named.
        highlights: the few numbers that matter most, as HTML; empty without.
    """

    sentence: str
    named: tuple[str, ...]
    parts: tuple[PageSection, ...]
    highlights: str
    simulated: bool
    seconds: float


class ExplainJob(Job[ExplanationResult]):
    """Hold an explanation that was started; its folder is there once it is accepted.

    Then `accepted` is the name of the new model, empty without one.
    """

    accepted: str | None = None

    def accept(self, out: Path) -> None:
        """Write the answer under a name, once.

        Raises:
            InputError: there is no answer, or it is accepted already.
            WouldOverwrite: something of that name exists.
        """
        from benchtool.explain.updated_model import MODEL
        from benchtool.physics.model_file import load_model

        if self.state.status != "done":
            raise InputError("there is no answer to accept; explain first")
        if self.accepted is not None:
            raise InputError(f"{self.out.name} is accepted already; look at it under Runs")
        complete_folder(self.out, out)
        model = out / MODEL
        self.accepted = load_model(model).model.name if model.is_file() else ""
        self.out = out


def explain(
    report: ReportProgress, out: Path, words: tuple[str, ...], inputs: ExplainInputs
) -> ExplanationResult:
    """Answer which effect a model lacks, and set the answer's folder aside.

    Raises:
        BenchtoolError: recordings or model that no verdict can stand on.
    """
    from benchtool.explain.next_steps import next_file
    from benchtool.explain.updated_model import added_effects
    from benchtool.report.answer.folder import write_folder
    from benchtool.report.answer.page import added_sentence, answer_page
    from benchtool.report.figure import render_figures
    from benchtool.report.files import figure_axes
    from benchtool.report.page import Block, FactTable, FigureBlock, Paragraph
    from benchtool.results import explain_result
    from benchtool.web.drawing import FigureImage, blocks_html

    def progress(what: str, share: float) -> None:
        if share < 1.0:
            report(what, FIGURE_SOURCE * share)

    report("reading the recordings", 0.0)
    answer = explain_result(inputs, progress, commands=[shlex.join(["benchtool", *words])]).found
    report("drawing the figures", FIGURE_SOURCE)
    aside = partial_folder(out)
    shutil.rmtree(aside, ignore_errors=True)
    write_folder(aside, answer, display_path=out)
    figures = render_figures("answer", answer)
    page = answer_page(answer, figures, next_file(answer)[0])
    # Whether it is written changes while the page is open; the page shows it beside its button.
    left_out = [Paragraph(added_sentence(answer))] if answer.has_model else []
    files = {id(block.figure): aside / f"{name}.svg" for name, block in figures.items()}

    def shown(block: Block) -> Block | FigureImage:
        if isinstance(block, FigureBlock):
            return FigureImage(
                files[id(block.figure)].read_bytes(), block.caption, figure_axes(block.figure)
            )
        return block

    parts = {
        part.title: blocks_html(shown(block) for block in part.blocks if block not in left_out)
        for part in page.sections
    }
    return ExplanationResult(
        sentence=page.summary,
        named=tuple(effect.name for effect in added_effects(answer)),
        parts=tuple(PageSection(title=title, html=html) for title, html in parts.items()),
        highlights=blocks_html([FactTable(page.highlights)]) if page.highlights else "",
        simulated=answer.simulated,
        seconds=answer.seconds,
    )
