"""Shared options of several commands: recipe, table and motor fit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le

from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs
from benchtool.data.atomic import data_hash
from benchtool.fit.recipe import Recipe


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorTestInputs(Inputs):
    """Options of a motor fit: rig of the logs, vehicle mass and extrapolation of thrust."""

    TITLE = "Motor fit"

    propeller: Annotated[
        str | None, Input("Propeller, if missing in a log: name, file or inches: 5x4.5.")
    ] = None
    rig: Annotated[str | None, Input("Rig name or file.", default_text="from the logs")] = None
    mass_kg: Annotated[
        Annotated[float, Gt(0.0), Le(1000.0)] | None,
        Input("Vehicle mass for the hover point.", "kg", default_text="rig value"),
    ] = None
    rotors: Annotated[
        Annotated[int, Ge(1), Le(64)] | None,
        Input("Rotors that carry the mass.", default_text="rig value"),
    ] = None
    extrapolate: Annotated[
        bool, Input("Extrapolate thrust beyond 10 % of command and 15 % of voltage.")
    ] = False


def recipe_from_options(options: dict[str, Any]) -> Recipe:
    """Return the base recipe of the options: from a recipe folder, or of data and model."""
    from benchtool.fit.recipe import read_recipe

    if fixed := options.pop("fix", []):
        # A name without a value is fixed at the value of the model.
        options["hold"] = [*options.get("hold", []), *(text for text in fixed if "=" not in text)]
        options["fix"] = [text for text in fixed if "=" in text]
    if (folder := options.get("recipe")) is not None:
        if "data" in options or "model" in options:
            raise InputError("--recipe contains data and model; remove DATA and --model")
        return read_recipe(folder)
    if "data" not in options:
        raise InputError(
            "no data to fit; give run folders or CSV files, for example "
            "benchtool fit runs/NAME --model quad_body_lift"
        )
    if "model" not in options:
        from benchtool.physics.model_file import model_names

        for path in options["data"]:
            data_hash(path)  # raises for a missing file
        raise InputError(f"model is missing; add --model with one of: {', '.join(model_names())}")
    data = tuple(options["data"])
    return Recipe(name=Path(data[0]).stem, data=data, model=options["model"])


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
        Annotated[float, Gt(0.0), Le(100.0)] | None, Input("Rotor radius, instead of --rig.", "m")
    ] = None
