"""A recipe: which data, which model, what is free, how it is estimated."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Len

from benchtool.core.errors import FileFormatError
from benchtool.core.toml_text import FiniteTable, read_strict
from benchtool.core.user_file import read_text
from benchtool.fit.model_problem import Basis as Basis
from benchtool.physics.validity import VALIDITY_Z_OVER_R

Method = Literal["least_squares", "emcee"]
Noise = Literal["auto", "stated", "scale", "add"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe(FiniteTable):
    """State one fit.

    Attributes:
        name: of the fit.
        data: run folders or CSV files; in a recipe file relative to that file.
        model: a shipped model or the path of a model file.
        description: what question it answers.
        rig: of tables, by name or path; a run folder carries its own.
        columns: a mapping file whose `[columns]` overrides the model's.
        where: rows to keep, as COLUMN=VALUE.
        basis: see `Basis`.
        methods: estimators to run, in this order.
        free: parameters to free beyond those that the model frees.
        fix: parameters to hold, with their values.
        hold: parameters to hold at the model's own values.
        noise: "stated" takes the standard errors as they are, "scale" fits one factor on them,
            "add" fits scatter in quadrature; "auto" scales what a run measured within visits and
            takes what a table states.
        loss: "linear", or "soft_l1" and "huber" that count distant points less.
        min_z_over_R: points nearer are left out and counted.
        compare: models to hold against this one on held-out points.
        walkers, max_steps: of the emcee ensembles.
        seed: of everything random.
    """

    name: str
    data: Annotated[tuple[str, ...], Len(1)]
    model: str
    description: str = ""
    rig: str | None = None
    columns: str | None = None
    where: tuple[str, ...] = ()
    basis: Basis = "joint"
    methods: Annotated[tuple[Method, ...], Len(1)] = ("least_squares",)
    free: tuple[str, ...] = ()
    fix: Mapping[str, float] = field(default_factory=dict)
    hold: tuple[str, ...] = ()
    noise: Noise = "auto"
    loss: Literal["linear", "soft_l1", "huber"] = "linear"
    min_z_over_R: Annotated[float, Ge(0.0)] = VALIDITY_Z_OVER_R
    compare: tuple[str, ...] = ()
    walkers: Annotated[int, Ge(8)] = 32
    max_steps: Annotated[int, Ge(100)] = 20_000
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class _RecipeFile(FiniteTable):
    recipe: Recipe


def read_recipe(folder: Path) -> Recipe:
    """Return the recipe of `folder/recipe.toml`, its paths made relative to the present folder."""
    path = folder / "recipe.toml"
    if not os.path.lexists(path):
        raise FileFormatError(
            str(path), "there is no recipe to read; name a folder that holds a recipe.toml"
        )
    recipe = read_strict(_RecipeFile, read_text(path), str(path)).recipe

    def beside(name: str) -> str:
        own = folder / name
        return str(own) if os.path.exists(own) else name

    return replace(
        recipe,
        data=tuple(str(folder / name) for name in recipe.data),
        model=beside(recipe.model),
        rig=None if recipe.rig is None else beside(recipe.rig),
        columns=None if recipe.columns is None else str(folder / recipe.columns),
        compare=tuple(beside(name) for name in recipe.compare),
    )
