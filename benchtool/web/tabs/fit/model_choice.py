"""Models and rigs for the Fit tab, and the recipe and command of its form."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from benchtool.core.channel import ColumnSource
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.inputs import build_inputs, to_arguments, with_changes
from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name, rig_names
from benchtool.core.toml_text import parse_toml
from benchtool.core.user_code import check_code_allowed
from benchtool.core.user_file import read_text
from benchtool.data.column_map import read_column_map
from benchtool.data.csv_text import read_csv_header
from benchtool.data.formats.formats import is_stand_table
from benchtool.data.run.entry import Entry
from benchtool.data.run.run import free_path
from benchtool.data.run.runs_folder import RunsFolder, column_map_path
from benchtool.data.run.state import list_state_files
from benchtool.fit.data_rig import rig_for_data
from benchtool.fit.fit_data import RATIO_BASIS
from benchtool.fit.recipe import FitInputs, Recipe
from benchtool.physics.model_file import LoadedModel, load_model, model_names

MODEL_FILE = "model.toml"

COMMAND_OPTIONS = ("profile", "budget")  # not part of a recipe


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
        choices: by parameter.
    """

    data: list[str] = field(default_factory=list)
    model: str = "quad_bench"
    choices: dict[str, ParameterChoice] = field(default_factory=dict)
    name: str = ""
    options: dict[str, Any] = field(default_factory=dict)


def model_choices(folder: RunsFolder, entries: Iterable[Entry]) -> dict[str, str]:
    """Return labels of library models and of models from fits and explanations, by name."""
    labels = {name: name for name in model_names()}
    for entry in entries:
        if entry.kind in ("fit", "explanation") and not entry.problem:
            name = f"{entry.name}/{MODEL_FILE}"
            if (folder.root / name).is_file():
                labels[name] = f"{entry.name} ({entry.rig}, from this {entry.kind})"
    return labels


def model_path(folder: RunsFolder, name: str) -> str:
    """Return the name of a library model, or the path of a model in the runs folder.

    Raises:
        InputError: the model file or its rig is outside the folder, or needs user code.
    """
    if name in model_names():
        return name
    path = folder.find_file(name)
    table = parse_toml(read_text(path), name).get("model", {})
    table = table if isinstance(table, dict) else {}
    parent = PurePosixPath(name).parent
    if table.get("effects_file"):
        check_code_allowed(f"{parent}/{table['effects_file']}")
    rig = str(table.get("rig", ""))
    if rig and rig not in rig_names():
        if PurePosixPath(rig).name != rig:
            raise InputError(
                f"rig {rig!r} of {name} is outside its folder, but the page reads the runs folder "
                f"only; use benchtool fit --model"
            )
        folder.find_file(f"{parent}/{rig}")
    return str(path)


def form_parameters(model: str, rig: Rig | None = None) -> dict[str, Parameter]:
    """Return a model's parameters by full name, without noise parameters, which an option sets."""
    parameters = load_choice(model, rig).model.parameters
    return {name: value for name, value in parameters.items() if not name.startswith("noise.")}


def load_choice(model: str, rig: Rig | None = None) -> LoadedModel:
    """Return a model on a rig, by default its own; cached until its file changes."""
    path = Path(model)
    return _load(model, path.stat().st_mtime_ns if path.is_file() else 0, _RigKey(rig))


@dataclass(frozen=True, slots=True)
class _RigKey:
    """Cache key of a rig, which can be compared but not hashed."""

    rig: Rig | None

    def __hash__(self) -> int:
        return hash(self.rig.name if self.rig else None)


@lru_cache(maxsize=8)
def _load(model: str, stamp: int, key: _RigKey) -> LoadedModel:
    del stamp  # part of the cache key: changes with the file
    return load_model(model, key.rig)


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


def build_recipe(request: FitRequest, folder: RunsFolder, entries: Mapping[str, Entry]) -> Recipe:
    """Return the recipe of the form; raise for missing data or an invalid value."""
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
    if tables and not stored and not load_choice(model).columns:
        for name in tables:
            path = folder.find_file(name)
            if "thrust_N" not in read_csv_header(path) and not is_stand_table(path):
                raise InputError(
                    f"{name} has no column thrust_N; select its columns above and press Use these "
                    f"columns"
                )
    base = Recipe(
        name=request.name,
        data=tuple(str(path) for path in paths),
        model=model,
        columns=str(stored[0]) if stored else None,
    )
    parameters = form_parameters(model, data_rig(request, folder))
    options = {key: value for key, value in request.options.items() if key not in COMMAND_OPTIONS}
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
    return build_inputs(Recipe, {**choices, **options}, source="label", base=base)


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


def rig_choices(folder: RunsFolder) -> dict[str, str]:
    """Return labels of library rigs and of rig files in the runs folder, by name or path."""
    labels = {name: name for name in rig_names()}
    for path in sorted(folder.root.glob("*.toml")):
        try:
            file = folder.find_file(path.name)
            labels[str(file)] = f"{load_rig_by_name(file).name} ({path.name})"
        except InputError:
            continue  # another kind of file, or an invalid rig
    return labels


def check_rig_choice(name: str | None, folder: RunsFolder) -> str | None:
    """Return the name of a rig; raise if it is not a choice of the page."""
    if name is not None and name not in (choices := rig_choices(folder)):
        raise UnknownChoice("rig", name, choices)
    return name


def command_arguments(recipe: Recipe, request: FitRequest, folder: RunsFolder) -> list[str]:
    """Return the arguments of the equivalent `benchtool fit`."""
    out = str(folder.root / request.name) if request.name else ""
    extra = {name: request.options.get(name) or None for name in COMMAND_OPTIONS}
    return ["fit", *to_arguments(FitInputs, with_changes(recipe) | extra | {"out": out})]


def suggested_name(folder: RunsFolder, data: Sequence[str]) -> str:
    """Return a free name for the fit of some data."""
    first = re.sub(r"\.csv$", "", data[0].rsplit("/", 1)[-1]) if data else "data"
    return free_path(folder.root / f"fit-{re.sub(r'[^A-Za-z0-9._-]+', '-', first)}").name
