"""The fit that runs on a server: one at a time, found again by a page that is loaded anew."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchtool.errors import InputError
from benchtool.recipes.recipe import Recipe
from benchtool.web.fits.work import fit_into, unfinished
from benchtool.web.job import Job, JobState


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


_LATEST: dict[Path, Fitting] = {}
"""By runs folder; a server has one."""


def latest(root: Path) -> Fitting | None:
    """Return the fit that was started last for a runs folder, None before the first."""
    return _LATEST.get(root)


def start(root: Path, recipe: Recipe, out: Path, words: Sequence[str], profile: bool) -> Fitting:
    """Start a fit.

    Raises:
        InputError: another one runs.
    """
    present = latest(root)
    if present is not None and present.state.running:
        raise InputError(
            f"the fit {present.out.name} still runs ({present.state.what}); wait, or cancel it"
        )
    job = Job(fit_into, recipe, out, tuple(words), profile)
    _LATEST[root] = Fitting(out=out, words=tuple(words), job=job)
    return _LATEST[root]


def cancel(fitting: Fitting) -> None:
    """End a fit and take away what it had begun to write."""
    fitting.job.cancel()
    shutil.rmtree(unfinished(fitting.out), ignore_errors=True)
