"""Fit and write the folder, in a process of its own: what `benchtool fit --out` does."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

from benchtool.errors import WouldOverwrite
from benchtool.recipes.recipe import Recipe
from benchtool.web.job import Tell


def unfinished(out: Path) -> Path:
    """Return where a fit is written until it is whole; a list of runs does not show it."""
    return out.with_name(f".{out.name}.part")


def fit_into(tell: Tell, recipe: Recipe, out: Path, words: tuple[str, ...], profile: bool) -> str:
    """Run a recipe, write its folder in one step, and return the folder's name.

    Args:
        tell: told what is being done and how much of it.
        recipe: what to fit.
        out: the folder; nothing of that name exists.
        words: behind `benchtool`, for the report.
        profile: intervals of least squares from the profile likelihood.

    Raises:
        BenchtoolError: the data or the model do not allow the fit.
    """
    from benchtool.recipes.fit_folder import refuse_full, write_fit
    from benchtool.recipes.run_recipe import run_recipe

    refuse_full(out)
    tell("reading", 0.0)

    def progress(what: str, done: int, expected: int) -> None:
        tell(what, done / max(expected, 1))

    output = run_recipe(recipe, progress, profile=profile)
    tell("drawing", 0.0)
    part = unfinished(out)
    shutil.rmtree(part, ignore_errors=True)
    write_fit(part, output, [shlex.join(["benchtool", *words])])
    if out.exists():
        raise WouldOverwrite(str(out))
    part.rename(out)
    return out.name
