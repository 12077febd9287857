"""The fit that runs on a server: one at a time, found again by a page that is loaded anew."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchtool.recipes.recipe import Recipe
from benchtool.web.fits.work import fit_into, unfinished
from benchtool.web.job import Job, JobState
from benchtool.web.latest import Latest


@dataclass(slots=True, kw_only=True)
class Fitting:
    """Hold a fit that was started.

    Attributes:
        out: its folder, there once it is done.
        words: behind `benchtool` that do the same.
        job: the process.
    """

    out: Path
    words: tuple[str, ...]
    job: Job[str]

    @property
    def state(self) -> JobState[str]:
        """How it stands."""
        return self.job.state

    def cancel(self) -> None:
        """End it and take away what it had begun to write."""
        self.job.cancel()
        shutil.rmtree(unfinished(self.out), ignore_errors=True)


FITS: Latest[Fitting] = Latest()


def start(root: Path, recipe: Recipe, out: Path, words: Sequence[str], profile: bool) -> Fitting:
    """Start a fit.

    Raises:
        InputError: another one runs.
    """
    FITS.ended(root)
    job = Job(fit_into, recipe, out, tuple(words), profile)
    return FITS.put(root, Fitting(out=out, words=tuple(words), job=job))
