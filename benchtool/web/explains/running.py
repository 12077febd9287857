"""The explanation that runs on a server: one at a time, found again by a page loaded anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchtool.errors import InputError
from benchtool.web.explains.question import Question
from benchtool.web.explains.work import Explained, discard, explained, keep
from benchtool.web.job import Job, JobState
from benchtool.web.latest import Latest


@dataclass(slots=True, kw_only=True)
class Explaining:
    """Hold an explanation that was started.

    Attributes:
        out: its folder, there once it is kept.
        words: behind `benchtool` that do the same.
        job: the process.
        kept: name of the new model once it is kept; empty without one, None before.
    """

    out: Path
    words: tuple[str, ...]
    job: Job[Explained]
    kept: str | None = None

    @property
    def state(self) -> JobState[Explained]:
        """How it stands."""
        return self.job.state

    def keep(self, out: Path) -> None:
        """Write what was found under a name, once.

        Raises:
            InputError: there is nothing to keep, or it is kept already.
            WouldOverwrite: something of that name exists.
        """
        if self.state.status != "done":
            raise InputError("there is no answer to keep; explain first")
        if self.kept is not None:
            raise InputError(f"{self.out.name} is kept already; look at it under Runs")
        self.kept = keep(self.out, out)
        self.out = out

    def cancel(self) -> None:
        """End it and take away what it had begun to write."""
        self.job.cancel()
        discard(self.out)


EXPLANATIONS: Latest[Explaining] = Latest()


def start(root: Path, question: Question, out: Path, words: Sequence[str]) -> Explaining:
    """Start an explanation; what the one before had set aside is taken away.

    Raises:
        InputError: another one runs.
    """
    before = EXPLANATIONS.ended(root)
    if before is not None:
        discard(before.out)
    out.parent.mkdir(parents=True, exist_ok=True)
    job = Job(explained, question, out, tuple(words))
    return EXPLANATIONS.put(root, Explaining(out=out, words=tuple(words), job=job))


def clear(root: Path) -> None:
    """Take away what nobody kept, as the server ends."""
    present = EXPLANATIONS.forget(root)
    if present is not None:
        present.cancel()
