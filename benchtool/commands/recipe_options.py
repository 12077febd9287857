"""Options that several commands share: a recipe, a table, a motor test."""

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
class StandInputs(Inputs):
    """What a log of a stand may not state itself."""

    TITLE = "Logs of stands"

    propeller: Annotated[
        str | None,
        Input("Where a log does not state it: name, file, or size in inches, as 5x4.5."),
    ] = None
    rig: Annotated[
        str | None, Input("Shipped name or path.", default_text="made from the logs")
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorTestInputs(StandInputs):
    """Vehicle of a motor test, and how far its thrust is extrapolated."""

    TITLE = "Motor tests"

    mass_kg: Annotated[
        Annotated[float, Gt(0.0), Le(1000.0)] | None,
        Input(
            "Mass of the vehicle that hovers.", "kg", default_text="the rig's, where it states one"
        ),
    ] = None
    rotors: Annotated[
        Annotated[int, Ge(1), Le(64)] | None,
        Input("Number of rotors that carry the mass.", default_text="the rig's"),
    ] = None
    extrapolate: Annotated[
        bool, Input("Extrapolate thrust beyond 10 % in command and 15 % in voltage, too.")
    ] = False


def recipe_from_options(given: dict[str, Any], command: str) -> Recipe:
    """Return the recipe that options go over: that of a folder, or one of data and model."""
    from benchtool.fit.recipe import read_recipe

    if words := given.pop("fix", []):
        # A name without a value is held where the model has it.
        given["hold"] = [*given.get("hold", []), *(word for word in words if "=" not in word)]
        given["fix"] = [word for word in words if "=" in word]
    if (folder := given.get("recipe")) is not None:
        if "data" in given or "model" in given:
            raise InputError("--recipe says which data and model; leave DATA and --model out")
        return read_recipe(folder)
    if "data" not in given:
        raise InputError(
            f"nothing to {command}: give run folders or CSV files, for example "
            f"benchtool {command} runs/NAME --model quad_body_lift"
        )
    if "model" not in given:
        from benchtool.physics.model_file import model_names

        for path in given.get("data", ()):
            data_hash(path)  # what is no file is reported as that
        raise InputError(f"which model? give --model with one of: {', '.join(model_names())}")
    data = tuple(given["data"])
    return Recipe(name=Path(data[0]).stem, data=data, model=given["model"])


Error = Literal["sd", "se"]


@dataclass(frozen=True, slots=True, kw_only=True)
class TableInputs(Inputs):
    """Columns of a table; left out, their names decide."""

    TITLE = "Tables of your own"

    z: Annotated[str, Input("Column of the plate's distance; none without a plate.")] = ""
    thrust: Annotated[str, Input("Column of the thrust.")] = ""
    ratio: Annotated[str, Input("Column of T/T_OGE where no thrust is given.")] = ""
    rpm: Annotated[str, Input("Column of the rotor speed, or one number for all rows.")] = ""
    unit: Annotated[str, Input("Unit of the thrust, where its column names none: gf.")] = ""
    z_unit: Annotated[
        str, Input("Unit of the distance, where its column names none: mm; R for radii.")
    ] = ""
    error: Annotated[str, Input("Column of the thrust's or ratio's error; or none.")] = ""
    error_is: Annotated[
        Error | None,
        Input("What that is: scatter of single readings (sd) or standard error of means (se)."),
    ] = None
    reference: Annotated[
        str, Input("COLUMN=VALUE of the rows that were measured far from the plate.")
    ] = ""
    runs: Annotated[
        str, Input("Column that names runs: fit each by itself; none for all as one.")
    ] = ""
    radius: Annotated[
        Annotated[float, Gt(0.0), Le(100.0)] | None,
        Input("Rotor radius, in place of a rig.", "m"),
    ] = None
