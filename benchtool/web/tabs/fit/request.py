"""Inputs of `benchtool fit` from the form of the Fit tab."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from benchtool.core.channel import ColumnSource
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.inputs import build_inputs
from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.data.column_map import read_column_map
from benchtool.data.csv_text import read_csv_header
from benchtool.data.formats.formats import is_stand_table
from benchtool.data.run.entry import Entry
from benchtool.data.run.run import free_path
from benchtool.data.run.runs_folder import RunsFolder, column_map_path
from benchtool.data.run.state import list_state_files
from benchtool.fit.fit_data import RATIO_BASIS
from benchtool.fit.nominal import rig_for_data
from benchtool.fit.recipe import FitInputs, Recipe
from benchtool.physics.model_file import load_model
from benchtool.web.choices import check_rig_choice, model_path


class ParameterChoice(NamedTuple):
    """Choice of a model parameter: free, or fixed at a value."""

    free: bool
    value: float


@dataclass(slots=True, kw_only=True)
class FitRequest:
    """Contents of the form.

    Attributes:
        data: names of runs and tables.
        model: key of `model_choices`.
        choices: of parameters that differ from the model.
    """

    data: list[str] = field(default_factory=list)
    model: str = "quad_bench"
    choices: dict[str, ParameterChoice] = field(default_factory=dict)
    name: str = ""
    options: dict[str, Any] = field(default_factory=dict)


def form_parameters(model: str, rig: Rig | None = None) -> dict[str, Parameter]:
    """Return a model's parameters by full name, without noise parameters, which an option sets."""
    parameters = load_model(model, rig).model.parameters
    return {name: value for name, value in parameters.items() if not name.startswith("noise.")}


def choice_options(
    parameters: Mapping[str, Parameter], choices: Mapping[str, ParameterChoice]
) -> dict[str, object]:
    """Return the recipe options free, hold and fix for choices that differ from the model."""
    free: list[str] = []
    hold: list[str] = []
    fix: dict[str, float] = {}
    for name, parameter in parameters.items():
        choice = choices.get(name)
        if choice is None:
            continue
        if choice.free and not parameter.free:
            free.append(name)
        if not choice.free and choice.value != parameter.value:
            fix[name] = choice.value
        elif not choice.free and parameter.free:
            hold.append(name)
    return {"free": free, "hold": hold, "fix": fix}


def build_fit_inputs(
    request: FitRequest, folder: RunsFolder, entries: Mapping[str, Entry]
) -> FitInputs:
    """Return the inputs of `benchtool fit` for the form; raise for missing or invalid values."""
    if not request.data:
        raise InputError(
            "no data selected; select a run or a table, measure a sweep first, or upload a CSV file"
        )
    paths = [folder.find_path(name) for name in request.data]
    tables = [name for name in request.data if entries[name].kind == "table"]
    maps = [column_map_path(folder.find_file(name)) for name in tables]
    stored = [path for path in maps if path.is_file()]
    if len(tables) > 1 and stored:
        raise InputError(
            f"{' and '.join(tables)} have separate column maps, but a fit uses one; fit them "
            f"separately"
        )
    model = model_path(folder, request.model)
    columns = read_column_map(stored[0]) if stored else {}
    if tables and not stored and not load_model(model).columns:
        for name in tables:
            path = folder.find_file(name)
            if "thrust_N" not in read_csv_header(path) and not is_stand_table(path):
                raise InputError(
                    f"{name} has no column thrust_N; select its columns above and press Use these "
                    f"columns"
                )
    recipe = Recipe(
        name=request.name,
        data=tuple(str(path) for path in paths),
        model=model,
        columns=str(stored[0]) if stored else None,
    )
    base = FitInputs(recipe=recipe, out=folder.root / request.name if request.name else None)
    parameters = form_parameters(model, data_rig(request, folder))
    options = dict(request.options)
    choices: dict[str, Any] = choice_options(parameters, request.choices)
    if "R_m" in parameters and tables and _has_no_plate(tables, columns, folder):
        # As in the command: without a plate, the effective radius is not identifiable.
        choices["hold"] = sorted({*choices["hold"], "R_m"} - choices["fix"].keys())
    if "thrust_ratio" in columns and not options.get("basis"):
        options["basis"] = RATIO_BASIS
    if {"thrust_sd_N", "thrust_ratio_sd"} & columns.keys() and not options.get("noise"):
        options["noise"] = "scale"
    calibrations = list_state_files("calibration")  # the page opens no other calibration files
    calibration = options.get("calibration")
    if calibration is not None and calibration not in calibrations:
        raise UnknownChoice("calibration", str(calibration), calibrations)
    return build_inputs(FitInputs, {**choices, **options}, source="label", base=base)


def _has_no_plate(
    tables: Sequence[str], columns: Mapping[str, ColumnSource], folder: RunsFolder
) -> bool:
    """Return whether tables contain no plate distance."""
    if columns:
        return "plate_z_m" not in columns
    return all(is_stand_table(folder.find_file(name)) for name in tables)


def data_rig(request: FitRequest, folder: RunsFolder) -> Rig | None:
    """Return the rig of the data; None for the rig of the model file."""
    rig = check_rig_choice(request.options.get("rig"), folder)
    return rig_for_data([str(folder.find_path(name)) for name in request.data], request.model, rig)


def suggested_name(folder: RunsFolder, data: Sequence[str]) -> str:
    """Return a free name for the fit of some data."""
    first = re.sub(r"\.csv$", "", data[0].rsplit("/", 1)[-1]) if data else "data"
    return free_path(folder.root / f"fit-{re.sub(r'[^A-Za-z0-9._-]+', '-', first)}").name
