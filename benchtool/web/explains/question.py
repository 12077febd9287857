"""What the Explain form asks, as paths and as the words of the command. Pure."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchtool.errors import InputError
from benchtool.web.explains.places import Places


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """Hold what is asked.

    Attributes:
        learn, check: paths of recordings.
        model: shipped name or path.
    """

    learn: tuple[str, ...]
    check: tuple[str, ...]
    model: str

    def words(self, out: Path) -> list[str]:
        """Return the words behind `benchtool` that ask the same and write the same folder."""
        words = ["explain", *self.learn, "--model", self.model, "--check", *self.check]
        return [*words, "--out", str(out)]


def question_of(places: Places, learn: Sequence[str], check: Sequence[str], model: str) -> Question:
    """Return the question of some choices.

    Raises:
        InputError: something is missing, a choice leads elsewhere, or one recording is in both.
    """
    if not learn:
        raise InputError(
            "no recording to learn from is chosen; choose one or more, keep one under Simulate, or "
            "record one under Bench"
        )
    if not check:
        raise InputError(
            "no recording to check on is chosen; choose one of the same bench that is not learned "
            "from"
        )
    both = set(learn) & set(check)
    if both:
        raise InputError(
            f"{', '.join(sorted(both))} is to learn from and to check on; a model is checked on "
            f"what it did not learn from, so choose another"
        )
    if not model:
        raise InputError("no model is chosen; choose the one that should explain the recordings")
    return Question(
        learn=tuple(str(places.path_of(name)) for name in learn),
        check=tuple(str(places.path_of(name)) for name in check),
        model=places.model_of(model),
    )


def suggested_folder(places: Places, learn: Sequence[str], date: str) -> Path:
    """Return a free folder for the answer about some recordings."""
    first = Path(learn[0].rsplit("/", 1)[-1]).stem if learn else "recording"
    kept = re.sub(r"[^A-Za-z0-9_-]+", "-", first).strip("-_")[:40] or "recording"
    return places.runs.free_path(date, f"explain-{kept}")
