"""Explain, in a process of its own: what `benchtool explain --out` does, its folder set aside.

The folder stands under a hidden name until somebody accepts it; then it gets its own.
"""

from __future__ import annotations

import shlex
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from benchtool.commands.explain import ExplainInputs
from benchtool.core.errors import InputError
from benchtool.web.jobs import (
    FolderJob,
    Job,
    LatestJob,
    ReportProgress,
    complete_folder,
    partial_folder,
)
from benchtool.web.sections import HtmlFragment, PageSection

if TYPE_CHECKING:
    from benchtool.report.page import Block

DRAWN_FROM = 0.85
"""Share of the whole at which an answer is there and its figures are drawn; a guess."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplanationResult:
    """Hold an answer as the page shows it.

    Attributes:
        sentence: the verdict, with what weighs on it.
        named: effects that the new model has more than the old; empty where none was named.
        parts: sections of the report, in its order.
        highlights: the few numbers that matter most; empty without.
        simulated: whether no physical bench made the recordings.
        seconds: how long it took.
    """

    sentence: str
    named: tuple[str, ...]
    parts: tuple[PageSection, ...]
    highlights: tuple[HtmlFragment, ...]
    simulated: bool
    seconds: float


@dataclass(slots=True, kw_only=True)
class ExplainJob(FolderJob[ExplanationResult]):
    """Hold an explanation that was started; its folder is there once it is accepted.

    Attributes:
        accepted: name of the new model once it is accepted; empty without one, None before.
    """

    accepted: str | None = None

    def accept(self, out: Path) -> None:
        """Write the answer under a name, once.

        Raises:
            InputError: there is no answer, or it is accepted already.
            WouldOverwrite: something of that name exists.
        """
        if self.state.status != "done":
            raise InputError("there is no answer to keep; explain first")
        if self.accepted is not None:
            raise InputError(f"{self.out.name} is kept already; look at it under Runs")
        complete_folder(self.out, out)
        self.accepted, self.out = _new_model(out), out


EXPLANATIONS: LatestJob[ExplainJob] = LatestJob()


def start(root: Path, inputs: ExplainInputs, out: Path, words: Sequence[str]) -> ExplainJob:
    """Start an explanation; what the one before had set aside is deleted.

    Raises:
        InputError: another one runs.
    """
    before = EXPLANATIONS.ended(root)
    if before is not None:
        before.cancel()
    out.parent.mkdir(parents=True, exist_ok=True)
    job = Job(explain, inputs, out, tuple(words))
    EXPLANATIONS.by_root[root] = ExplainJob(out=out, words=tuple(words), job=job)
    return EXPLANATIONS.by_root[root]


def clear(root: Path) -> None:
    """Delete what nobody accepted, as the server ends."""
    present = EXPLANATIONS.by_root.pop(root, None)
    if present is not None:
        present.cancel()


def explain(
    report: ReportProgress, inputs: ExplainInputs, out: Path, words: Sequence[str]
) -> ExplanationResult:
    """Answer a question, and set its folder aside.

    Args:
        report: receives the stages.
        inputs: recordings and model.
        out: the folder that the answer gets where it is accepted.
        words: behind `benchtool`, for the report.

    Raises:
        BenchtoolError: recordings or model that no verdict can stand on.
    """
    from benchtool.explain.added_model import added_effects
    from benchtool.explain.answer import answer_request
    from benchtool.explain.next_steps import next_file
    from benchtool.explain.request import read_request
    from benchtool.report.answer.added_words import added_sentence
    from benchtool.report.answer.folder import write_folder
    from benchtool.report.answer.page import answer_page
    from benchtool.report.figure import drawn
    from benchtool.report.page import Facts, Paragraph
    from benchtool.web.drawing import fragments

    began = time.monotonic()

    def progress(what: str, share: float) -> None:
        if share < 1.0:
            report(what, DRAWN_FROM * share)

    report("reading the recordings", 0.0)
    asked_for = read_request(inputs.recordings, inputs.check, inputs.model)
    command = shlex.join(["benchtool", *words])
    answer = answer_request(asked_for, commands=[command], progress=progress)
    answer = replace(answer, seconds=time.monotonic() - began)
    report("drawing the figures", DRAWN_FROM)
    aside = partial_folder(out)
    shutil.rmtree(aside, ignore_errors=True)
    write_folder(aside, answer, asked_for.effects_file, called=out)
    figures = drawn("answer", answer)
    page = answer_page(answer, figures, next_file(answer)[0])
    # Whether it is written changes under the page, which says so beside its own button.
    left_out = [Paragraph(added_sentence(answer))] if answer.has_model else []
    files = {id(block.figure): aside / f"{name}.svg" for name, block in figures.items()}
    return ExplanationResult(
        sentence=page.summary,
        named=tuple(effect.name for effect in added_effects(answer)),
        parts=tuple(
            PageSection(
                title=part.title,
                fragments=_drawn([block for block in part.blocks if block not in left_out], files),
            )
            for part in page.sections
        ),
        highlights=fragments([Facts(page.highlights)]) if page.highlights else (),
        simulated=answer.simulated,
        seconds=answer.seconds,
    )


def _drawn(blocks: Sequence[Block], files: Mapping[int, Path]) -> tuple[HtmlFragment, ...]:
    """Return blocks for the page, with the figures that were written."""
    from benchtool.report.page import FigureBlock
    from benchtool.web.drawing import FigureImage, fragments

    return fragments(
        FigureImage(files[id(block.figure)].read_bytes(), block.caption)
        if isinstance(block, FigureBlock)
        else block
        for block in blocks
    )


def _new_model(out: Path) -> str:
    """Return the name of the model in an answer's folder, empty without one."""
    from benchtool.explain.added_model import MODEL
    from benchtool.physics.model_file import load_model

    path = out / MODEL
    return load_model(path).model.name if path.is_file() else ""
