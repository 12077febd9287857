"""Explanation in a worker process, as `benchtool explain --out`.

The output folder has a hidden name until the user accepts the result.
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

FIGURE_START_SHARE = 0.85  # of the progress; assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationResult:
    """Result of an explanation for the page.

    Attributes:
        sentence: verdict with its cautions.
        new_effects: effects added to the model; () if none was identified.
        highlights: most important values as HTML, or "".
    """

    sentence: str
    new_effects: tuple[str, ...]
    sections: tuple[PageSection, ...]
    highlights: str
    simulated: bool
    seconds: float


class ExplainJob(Job[ExplanationResult]):
    """Explanation job; `accepted_model` is None until accepted, then the new model or ""."""

    accepted_model: str | None = None

    def accept(self, out: Path) -> None:
        """Rename the hidden folder to `out`; raise if it exists or without a result."""
        from benchtool.explain.updated_model import MODEL
        from benchtool.physics.model_file import load_model

        if self.state.status != "done":
            raise InputError("there is no result to accept; press Explain first")
        if self.accepted_model is not None:
            raise InputError(f"{self.out.name} is accepted already; open it under Runs")
        complete_folder(self.out, out)
        model = out / MODEL
        self.accepted_model = load_model(model).model.name if model.is_file() else ""
        self.out = out


def explain(
    report: ReportProgress, out: Path, command: tuple[str, ...], inputs: ExplainInputs
) -> ExplanationResult:
    """Identify the effect that a model lacks and write the result to a hidden folder."""
    from benchtool.explain.next_steps import next_file
    from benchtool.explain.updated_model import added_effects
    from benchtool.report.answer.folder import write_folder
    from benchtool.report.answer.page import added_sentence, answer_page
    from benchtool.report.figure import render_figures
    from benchtool.report.files import figure_axes
    from benchtool.report.page import Block, FactTable, FigureBlock, Paragraph
    from benchtool.results import explain_result
    from benchtool.web.drawing import FigureImage, blocks_html

    def progress(stage: str, share: float) -> None:
        if share < 1.0:
            report(stage, FIGURE_START_SHARE * share)

    report("reading the recordings", 0.0)
    answer = explain_result(inputs, progress, commands=[shlex.join(["benchtool", *command])]).found
    report("drawing the figures", FIGURE_START_SHARE)
    hidden_folder = partial_folder(out)
    shutil.rmtree(hidden_folder, ignore_errors=True)
    write_folder(hidden_folder, answer, display_path=out)
    figures = render_figures("answer", answer)
    page = answer_page(answer, figures, next_file(answer)[0])
    # The page shows this sentence next to its button, as its text changes.
    skipped_blocks = [Paragraph(added_sentence(answer))] if answer.effects else []
    files = {id(block.figure): hidden_folder / f"{name}.svg" for name, block in figures.items()}

    def load_figure(block: Block) -> Block | FigureImage:
        if isinstance(block, FigureBlock):
            return FigureImage(
                files[id(block.figure)].read_bytes(), block.caption, figure_axes(block.figure)
            )
        return block

    sections = []
    for section in page.sections:
        blocks = [load_figure(block) for block in section.blocks if block not in skipped_blocks]
        sections.append(PageSection(title=section.title, html=blocks_html(blocks)))
    return ExplanationResult(
        sentence=page.summary,
        new_effects=tuple(effect.name for effect in added_effects(answer)),
        sections=tuple(sections),
        highlights=blocks_html([FactTable(page.highlights)]) if page.highlights else "",
        simulated=answer.simulated,
        seconds=answer.seconds,
    )
