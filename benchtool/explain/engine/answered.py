"""From a question to its answer: explain, and keep what the answer was made from."""

from __future__ import annotations

from collections.abc import Sequence

from benchtool.explain.answer import Answer
from benchtool.explain.engine.asked import Asked
from benchtool.explain.engine.explain import explain
from benchtool.explain.engine.search import Progress


def answered(
    question: Asked,
    *,
    commands: Sequence[str] = (),
    seed: int = 0,
    draws: int = 128,
    bootstrap: int = 0,
    progress: Progress | None = None,
) -> Answer:
    """Return the answer to a question; whoever has a clock says how long it took.

    Args:
        question: everything read that it names.
        commands: as they were typed.
        seed: of everything random.
        draws: of the noise behind the floor.
        bootstrap: simulated records behind p-values; asymptotic ones when 0.
        progress: told what is being done.
    """
    found = explain(
        question.subject(), seed=seed, draws=draws, bootstrap=bootstrap, progress=progress
    )
    return Answer(
        explanation=found,
        loaded=question.loaded,
        model_file=question.model_file,
        model_sha256=question.model_sha256,
        model_given=question.model_given,
        effects_given=question.effects_given,
        learn=question.learn,
        check=question.check,
        seed=seed,
        seconds=0.0,
        commands=tuple(commands),
        own_effects=question.own,
    )
