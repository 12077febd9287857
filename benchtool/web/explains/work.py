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

from benchtool.errors import WouldOverwrite
from benchtool.web.explains.question import Question
from benchtool.web.fits.work import unfinished
from benchtool.web.job import Tell
from benchtool.web.shown import Piece, Shown

if TYPE_CHECKING:
    from benchtool.report.page import Block

DRAWN_FROM = 0.85
"""Share of the whole at which an answer is there and its figures are drawn; a guess."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Explained:
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
    parts: tuple[Shown, ...]
    highlights: tuple[Piece, ...]
    simulated: bool
    seconds: float


def explained(tell: Tell, question: Question, out: Path, words: Sequence[str]) -> Explained:
    """Answer a question, and set its folder aside.

    Args:
        tell: told the stages.
        question: recordings and model.
        out: the folder that the answer gets where it is kept.
        words: behind `benchtool`, for the report.

    Raises:
        BenchtoolError: recordings or model that no verdict can stand on.
    """
    from benchtool.explain.added_model import added_effects
    from benchtool.explain.added_words import added_sentence
    from benchtool.explain.answer_figures import answer_figures
    from benchtool.explain.answer_file import next_file
    from benchtool.explain.answer_folder import write_folder
    from benchtool.explain.answer_page import answer_page
    from benchtool.explain.answered import answered
    from benchtool.explain.asked import asked
    from benchtool.report.page import Facts, Paragraph
    from benchtool.web.drawing import pieces

    began = time.monotonic()

    def progress(what: str, share: float) -> None:
        if share < 1.0:
            tell(what, DRAWN_FROM * share)

    tell("reading the recordings", 0.0)
    asked_for = asked(question.learn, question.check, question.model)
    command = shlex.join(["benchtool", *words])
    answer = answered(asked_for, commands=[command], progress=progress)
    answer = replace(answer, seconds=time.monotonic() - began)
    tell("drawing the figures", DRAWN_FROM)
    aside = unfinished(out)
    shutil.rmtree(aside, ignore_errors=True)
    write_folder(aside, answer, asked_for.effects_file, called=out)
    figures = answer_figures(answer)
    report = answer_page(answer, figures, next_file(answer)[0])
    # Whether it is written changes under the page, which says so beside its own button.
    told = [Paragraph(added_sentence(answer))] if answer.has_model else []
    files = {id(figure): aside / f"{name}.svg" for name, figure in figures.items()}
    return Explained(
        sentence=report.summary,
        named=tuple(effect.name for effect in added_effects(answer)),
        parts=tuple(
            Shown(
                title=part.title,
                pieces=_drawn([block for block in part.blocks if block not in told], files),
            )
            for part in report.sections
        ),
        highlights=pieces([Facts(report.highlights)]) if report.highlights else (),
        simulated=answer.simulated,
        seconds=answer.seconds,
    )


def _drawn(blocks: Sequence[Block], files: Mapping[int, Path]) -> tuple[Piece, ...]:
    """Return blocks for the page, with the figures that were written."""
    from benchtool.report.page import FigureBlock
    from benchtool.web.drawing import pieces, read_drawing

    return pieces(
        read_drawing(files[id(block.figure)], block.caption)
        if isinstance(block, FigureBlock)
        else block
        for block in blocks
    )


def keep(aside_for: Path, out: Path) -> str:
    """Give the folder of an answer its name; return the name of the new model, empty without one.

    Args:
        aside_for: the name that it was set aside for.
        out: the name that it gets.

    Raises:
        WouldOverwrite: something of that name exists.
    """
    from benchtool.explain.added_model import MODEL
    from benchtool.library import load_model

    if out.exists():
        raise WouldOverwrite(str(out))
    unfinished(aside_for).rename(out)
    new = out / MODEL
    return load_model(new).model.name if new.is_file() else ""


def discard(out: Path) -> None:
    """Take away what was set aside; nothing happens where nothing was."""
    shutil.rmtree(unfinished(out), ignore_errors=True)
