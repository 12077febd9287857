"""The options of `benchtool fit` as a recipe, and a recipe as the words that ask for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.toml_text import build
from benchtool.fit.recipe import Recipe

WHERE = "the options"

OPTION_OF = {
    "methods": "--method",
    "methods[0]": "--method",
    "methods[1]": "--method",
    "max_steps": "--max-steps",
    "min_z_over_R": "--min-z-over-r",
}
"""Options whose names are not those of the recipe's keys."""


def recipe_of_options(given: Mapping[str, Any]) -> Recipe:
    """Return the recipe that options ask for, by the recipe's keys.

    Raises:
        InputError: a value that an option does not take, in the words of the command line.
    """
    try:
        return build(Recipe, given, WHERE)
    except FileFormatError as error:
        key = error.problem.split(" ", 1)[0]
        option = OPTION_OF.get(key, f"--{key}")
        raise InputError(error.problem.replace(key, option, 1)) from error


def held_by(words: Sequence[str]) -> tuple[list[str], dict[str, float]]:
    """Return what `--fix` holds: the names held as they are, and those with a value."""
    names, numbers = [], {}
    for word in words:
        name, sign, value = word.partition("=")
        if not sign:
            names.append(name)
            continue
        try:
            numbers[name] = float(value)
        except ValueError:
            raise InputError(
                f"--fix {word}: {value!r} is no number; write --fix {name}=NUMBER"
            ) from None
    return names, numbers


def words_of_recipe(recipe: Recipe, *, out: str = "", profile: bool = False) -> list[str]:
    """Return the words behind `benchtool` that run a recipe; what is usual is left out.

    Name and description of a recipe have no option.
    """
    usual = {item.name: item.default for item in fields(Recipe)}
    words = ["fit", *recipe.data, "--model", recipe.model]
    single = (
        "rig",
        "columns",
        "basis",
        "noise",
        "loss",
        "min_z_over_R",
        "walkers",
        "max_steps",
        "seed",
    )
    for key in single:
        value = getattr(recipe, key)
        if value != usual[key]:
            words += [OPTION_OF.get(key, f"--{key}"), _text(value)]
    fixed = [f"{name}={_text(value)}" for name, value in recipe.fix.items()]
    lists = {
        "--where": recipe.where,
        "--method": () if recipe.methods == usual["methods"] else recipe.methods,
        "--free": recipe.free,
        "--fix": (*recipe.hold, *fixed),
        "--compare": recipe.compare,
    }
    for option, values in lists.items():
        for value in values:
            words += [option, value]
    return [*words, *(["--profile"] if profile else []), *(["--out", out] if out else [])]


def _text(value: str | float) -> str:
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return str(value)
