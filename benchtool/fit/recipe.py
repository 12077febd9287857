"""Recipe of a fit: data, model, free parameters, estimators."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le, Len

from benchtool.core.air import Air
from benchtool.core.choices import BudgetMethod, Loss, Method
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.inputs import Input, Inputs
from benchtool.core.text import read_texts
from benchtool.core.toml_text import FiniteTable, read_strict
from benchtool.core.user_file import list_names, read_text
from benchtool.data.atomic import data_hash

# Fitted quantity: thrust in newtons ("joint"), or the ratio T_IGE/T_OGE at equal rotor speed, pulse
# width or electrical power.
Basis = Literal["joint", "equal_rpm2", "equal_pwm", "equal_power"]

LAWS = "laws"  # value of `compare` for all ground-effect laws

Noise = Literal["auto", "stated", "scale", "add"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe(Inputs):
    """Recipe of one fit.

    Attributes:
        data: in a recipe file relative to that file.
        noise: "stated" uses the standard errors unchanged, "scale" fits one factor on them, "add"
            fits scatter in quadrature; "auto" means "scale" for runs and "stated" for tables.
        air: measured air, overrides that of the runs; for k at 1.225 kg/m3.
    """

    name: str  # of the fit
    data: Annotated[
        tuple[str, ...],
        Len(1),
        Input("Run folders or CSV files; not with --recipe.", argument="DATA"),
    ]
    model: Annotated[
        str, Input("Model name (benchtool library models) or path of a model file.", label="Model")
    ]
    description: str = ""  # purpose of the fit
    rig: Annotated[
        str | None, Input("Rig of a CSV file: name or path.", label="Rig of a table", group="Data")
    ] = None
    calibration: Annotated[
        str | None, Input("Calibration file of a CSV file.", label="Of a table: calibration")
    ] = None
    columns: Annotated[
        str | None, Input("Column map (TOML): channel = column, unit, sign.", alias="--map")
    ] = None
    where: Annotated[
        tuple[str, ...],
        Input(
            "Keep only rows with COLUMN=VALUE; repeatable.",
            label="Only rows with COLUMN=VALUE (several: split by ;)",
        ),
    ] = ()
    basis: Annotated[
        Basis,
        Input(
            "Fitted quantity: thrust (joint), or T_IGE/T_OGE at equal ...",
            label="What is fitted",
            group="Fit",
        ),
    ] = "joint"
    methods: Annotated[
        tuple[Method, ...],
        Len(1),
        Input("Estimator to run; repeatable.", option="method", label="Estimators"),
    ] = ("least_squares",)
    free: Annotated[tuple[str, ...], Input("Parameter to fit in addition; repeatable.")] = ()
    fix: Annotated[
        Mapping[str, float], Input("Fix NAME=VALUE, or NAME at the model value; repeatable.")
    ] = field(default_factory=dict)
    hold: Annotated[tuple[str, ...], Input("Fix a parameter at the model value; repeatable.")] = ()
    noise: Annotated[
        Noise, Input("Error model: stated, scaled, or with added scatter.", label="Errors")
    ] = "auto"
    loss: Annotated[
        Loss,
        Input("Loss function; soft_l1 and huber are robust to outliers.", label="Loss"),
    ] = "linear"
    min_z_over_R: Annotated[
        Annotated[float, Ge(0.0)] | None,
        Input(
            "Minimum z/R of points.",
            option="min-z-over-r",
            label="Nearest z/R",
            default_text="validity limit of the law",
        ),
    ] = None
    compare: Annotated[
        tuple[str, ...],
        Input(
            "Model to compare with, or laws for all laws; repeatable.",
            label="Compare with models, or laws",
            group="Comparison",
        ),
    ] = ()
    walkers: Annotated[
        int,
        Ge(8),
        Input("Walkers of each emcee ensemble.", label="Walkers of emcee", group="Sampling"),
    ] = 32
    max_steps: Annotated[
        int, Ge(100), Input("Maximum emcee steps per walker.", label="Most steps of emcee")
    ] = 20_000
    seed: Annotated[int, Ge(0), Input("Random seed.", label="Seed")] = 1
    air: Air = field(default_factory=Air)


@dataclass(frozen=True, slots=True, kw_only=True)
class FitInputs(Inputs):
    """Inputs of `benchtool fit`."""

    folder: Annotated[Path | None, Input("Folder with a recipe.toml to run.", option="recipe")] = (
        None
    )
    recipe: Recipe
    profile: Annotated[
        bool,
        Input(
            "Add profile-likelihood intervals.",
            label="profile-likelihood intervals",
            group="Results",
        ),
    ] = False
    budget: Annotated[
        BudgetMethod,
        Input(
            "Uncertainty budget: propagation, or with Monte Carlo check (mc).",
            label="Uncertainty budget",
        ),
    ] = "propagation"
    out: Annotated[Path | None, Input("Folder for result.json, figures and report.html.")] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TableInputs(Inputs):
    """Columns of a table; by default found by their names."""

    TITLE = "User tables"

    z: Annotated[str, Input("Column of the plate distance; none without a plate.")] = ""
    thrust: Annotated[str, Input("Column of the thrust.")] = ""
    ratio: Annotated[str, Input("Column of T/T_OGE, if there is no thrust.")] = ""
    rpm: Annotated[str, Input("Column of the rotor speed, or one value in rpm.")] = ""
    unit: Annotated[str, Input("Unit of the thrust, if its column name has none: gf.")] = ""
    z_unit: Annotated[str, Input("Unit of the distance, if its column name has none: mm, R.")] = ""
    error: Annotated[str, Input("Column of the error of thrust or ratio, or none.")] = ""
    error_is: Annotated[
        Literal["sd", "se"] | None,
        Input("Kind of error: standard deviation (sd) or standard error (se)."),
    ] = None
    reference: Annotated[str, Input("COLUMN=VALUE of the rows out of ground effect.")] = ""
    runs: Annotated[str, Input("Column of run names, fitted separately; none for one fit.")] = ""
    radius: Annotated[
        Annotated[float, Gt(0.0), Le(100.0)] | None,
        Input("Rotor radius: 0.1016 or 4in.", "m"),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TableFitInputs(FitInputs):
    """Inputs of a fit, with those of user tables."""

    table: TableInputs = field(default_factory=TableInputs)


@dataclass(frozen=True, slots=True, kw_only=True)
class _RecipeFile(FiniteTable):
    recipe: Recipe


def base_recipe(options: dict[str, Any]) -> Recipe:
    """Return the base recipe of options: from a recipe folder, or of data and model.

    Entries of `fix` without a value become `hold`.

    Raises:
        InputError: data or model are missing, or given beside a recipe folder.
    """
    fix, hold = (options.get(name) or () for name in ("fix", "hold"))
    if not isinstance(fix, Mapping) and (fixed := read_texts(fix, commas=False)):
        # A name without a value is fixed at the value of the model.
        held = [text for text in fixed if "=" not in text]
        options["hold"] = [*read_texts(hold, commas=False), *held]
        options["fix"] = [text for text in fixed if "=" in text]
    if (folder := options.get("recipe")) is not None:
        if "data" in options or "model" in options:
            raise InputError("--recipe contains data and model; remove DATA and --model")
        return read_recipe(Path(folder))
    if "data" not in options:
        raise InputError(
            "no data to fit; give run folders or CSV files, for example "
            "benchtool fit runs/NAME --model quad_body_lift"
        )
    if "model" not in options:
        for path in options["data"]:
            data_hash(path)  # raises for a folder that is no run
        names = ", ".join(list_names("models"))
        raise InputError(f"model is missing; add --model with one of: {names}")
    data = tuple(options["data"])
    return Recipe(name=Path(data[0]).stem, data=data, model=options["model"])


def read_recipe(folder: Path) -> Recipe:
    """Return the recipe of `folder/recipe.toml`, with paths relative to the current folder."""
    path = folder / "recipe.toml"
    if not os.path.lexists(path):
        raise FileFormatError(
            str(path), "recipe not found; name a folder that contains a recipe.toml"
        )
    recipe = read_strict(_RecipeFile, read_text(path), str(path)).recipe

    def resolve(name: str) -> str:
        path = folder / name
        return str(path) if os.path.exists(path) else name

    return replace(
        recipe,
        data=tuple(str(folder / name) for name in recipe.data),
        model=resolve(recipe.model),
        rig=None if recipe.rig is None else resolve(recipe.rig),
        columns=None if recipe.columns is None else str(folder / recipe.columns),
        calibration=None if recipe.calibration is None else resolve(recipe.calibration),
        compare=tuple(name if name == LAWS else resolve(name) for name in recipe.compare),
    )
