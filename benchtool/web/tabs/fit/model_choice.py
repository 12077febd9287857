"""Which models the page may fit, and what its form stands for: a recipe, a command. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from benchtool.core.column_source import ColumnSource
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.inputs import build_inputs, to_arguments, with_changes
from benchtool.core.parameter import Parameter
from benchtool.core.parsed_text import parse_toml
from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name, rig_names
from benchtool.core.user_code import check_code_allowed
from benchtool.core.user_file import read_text
from benchtool.data.column_map import read_column_map
from benchtool.data.csv_text import read_csv_header
from benchtool.data.formats.formats import is_stand_table
from benchtool.data.run.entry import Entry
from benchtool.data.run.run import free_path
from benchtool.data.run.runs_folder import RunsFolder, columns_file
from benchtool.data.run.state import recall_state
from benchtool.fit.data_rig import rig_for_data
from benchtool.fit.fit_data import RATIO_BASIS
from benchtool.fit.recipe import FitInputs, Recipe
from benchtool.physics.model_file import LoadedModel, load_model, model_names

MODEL_FILE = "model.toml"

OF_COMMAND = ("profile", "budget")  # Inputs of the command that stand in no recipe


class ParameterChoice(NamedTuple):
    """Choose one number of a model to be free, or fixed at a value."""

    free: bool
    value: float


@dataclass(slots=True, kw_only=True)
class FitRequest:
    """Hold the contents of the form.

    Attributes:
        data: names of runs and tables.
        model: as `model_choices` calls it.
        choices: by parameter, where the form differs from the model.
    """

    data: list[str] = field(default_factory=list)
    model: str = "quad_bench"
    choices: dict[str, ParameterChoice] = field(default_factory=dict)
    name: str = ""
    options: dict[str, Any] = field(default_factory=dict)


def model_choices(folder: RunsFolder, entries: Iterable[Entry]) -> dict[str, str]:
    """Return models by what a recipe calls them, with words for people.

    Those that benchtool ships, and those that fits and explanations here have written.
    """
    found = {name: name for name in model_names()}
    for entry in entries:
        if entry.kind in ("fit", "explanation") and not entry.problem:
            name = f"{entry.name}/{MODEL_FILE}"
            if (folder.root / name).is_file():
                found[name] = f"{entry.name} ({entry.rig}, as written by that {entry.kind})"
    return found


def model_path(folder: RunsFolder, chosen: str) -> str:
    """Return what a recipe calls a chosen model: its name, or its path in the runs folder.

    Raises:
        InputError: a name that leads out of the folder, or a model file that names a rig
            outside of it, or a Python file.
    """
    if chosen in model_names():
        return chosen
    path = folder.file_of(chosen)
    head = parse_toml(read_text(path), chosen).get("model", {})
    head = head if isinstance(head, dict) else {}
    beside = PurePosixPath(chosen).parent
    if head.get("effects_file"):
        check_code_allowed(f"{beside}/{head['effects_file']}")
    rig = str(head.get("rig", ""))
    if rig and rig not in rig_names():
        if PurePosixPath(rig).name != rig:
            raise InputError(
                f"{chosen} takes its rig from {rig!r}, outside its own folder, and the page reads "
                f"the runs folder only; fit it with benchtool fit --model"
            )
        folder.file_of(f"{beside}/{rig}")
    return str(path)


def form_numbers(model: str, rig: Rig | None = None) -> dict[str, Parameter]:
    """Return a model's numbers by full name, on the rig of the data where that is another.

    Those of the noise are left out: an option sets them.
    """
    found = load_choice(model, rig).model.parameters
    return {name: item for name, item in found.items() if not name.startswith("noise.")}


def load_choice(model: str, rig: Rig | None = None) -> LoadedModel:
    """Return a model on a rig, by default its own; read anew only where its file has changed."""
    path = Path(model)
    return _read(model, path.stat().st_mtime_ns if path.is_file() else 0, _ByValue(rig))


@dataclass(frozen=True, slots=True)
class _ByValue:
    """Make a rig a key of the cache: what a rig holds cannot be hashed, but compared."""

    rig: Rig | None

    def __hash__(self) -> int:
        return hash(self.rig.name if self.rig else None)


@lru_cache(maxsize=8)
def _read(model: str, stamp: int, on: _ByValue) -> LoadedModel:
    del stamp  # another one after every change on the disk
    return load_model(model, on.rig)


def choice_options(
    numbers: Mapping[str, Parameter], choices: Mapping[str, ParameterChoice]
) -> dict[str, object]:
    """Return the recipe's options free, hold and fix that make a model's numbers as chosen.

    What is as the model has it needs no option.
    """
    chosen = [(name, numbers[name], choices[name]) for name in numbers if name in choices]
    return {
        "free": [name for name, own, to in chosen if to.free and not own.free],
        "hold": [
            name for name, own, to in chosen if own.free and not to.free and to.value == own.value
        ],
        "fix": {
            name: to.value for name, own, to in chosen if not to.free and to.value != own.value
        },
    }


def recipe_for(request: FitRequest, folder: RunsFolder, entries: Mapping[str, Entry]) -> Recipe:
    """Return the recipe that the form stands for.

    Raises:
        InputError: nothing to fit, a name that leads elsewhere, or a value that is not taken.
    """
    if not request.data:
        raise InputError(
            "nothing to fit: choose a run or a table; where there is none, measure a sweep first, "
            "or upload a CSV file"
        )
    paths = [folder.path_of(name) for name in request.data]
    tables = [name for name in request.data if entries[name].kind == "table"]
    maps = [columns_file(folder.file_of(name)) for name in tables]
    stored = [path for path in maps if path.is_file()]
    if len(tables) > 1 and stored:
        raise InputError(
            f"{' and '.join(tables)} are tables with maps of their own, and a fit takes one map; "
            f"fit them one at a time"
        )
    model = model_path(folder, request.model)
    columns = read_column_map(stored[0]) if stored else {}
    if tables and not stored and not load_choice(model).columns:
        for name in tables:
            path = folder.file_of(name)
            if "thrust_N" not in read_csv_header(path) and not is_stand_table(path):
                raise InputError(
                    f"{name} has no column thrust_N; choose its columns above and press Use these "
                    f"columns"
                )
    base = Recipe(
        name=request.name,
        data=tuple(str(path) for path in paths),
        model=model,
        columns=str(stored[0]) if stored else None,
    )
    numbers = form_numbers(model, data_rig(request, folder))
    options = {name: each for name, each in request.options.items() if name not in OF_COMMAND}
    choices: dict[str, Any] = choice_options(numbers, request.choices)
    if "R_m" in numbers and tables and _without_plate(tables, columns, folder):
        # As the command does: no plate says anything of the effective radius.
        choices["hold"] = sorted({*choices["hold"], "R_m"} - choices["fix"].keys())
    if "thrust_ratio" in columns and not options.get("basis"):
        options["basis"] = RATIO_BASIS
    if {"thrust_sd_N", "thrust_ratio_sd"} & columns.keys() and not options.get("noise"):
        options["noise"] = "scale"
    stored_ones = recall_state("calibration")  # the page opens no other calibration files
    if (chosen := options.get("calibration")) is not None and chosen not in stored_ones:
        raise UnknownChoice("calibration", str(chosen), stored_ones)
    return build_inputs(Recipe, {**choices, **options}, source="label", base=base)


def _without_plate(
    tables: Sequence[str], columns: Mapping[str, ColumnSource], folder: RunsFolder
) -> bool:
    """Return whether tables hold no distance to a plate: stands', or maps without one."""
    if columns:
        return "plate_z_m" not in columns
    return all(is_stand_table(folder.file_of(name)) for name in tables)


def data_rig(request: FitRequest, folder: RunsFolder) -> Rig | None:
    """Return the rig that the data are held against; None for that of the model's own file.

    Raises:
        InputError: data of two rigs or of none, or a rig that benchtool does not ship.
    """
    named = suggested_rig(request.options.get("rig"), folder)
    return rig_for_data([str(folder.path_of(name)) for name in request.data], request.model, named)


def rig_choices(folder: RunsFolder) -> dict[str, str]:
    """Return rigs by name or path, with words for people: shipped ones, and rig files of the user.

    The page opens rig files that stand in the runs folder itself, and no others.
    """
    found = {name: name for name in rig_names()}
    for path in sorted(folder.root.glob("*.toml")):
        try:
            own = folder.file_of(path.name)
            found[str(own)] = f"{load_rig_by_name(own).name} ({path.name})"
        except InputError:
            continue  # a model, a plan, or a rig that the command line says more of
    return found


def suggested_rig(name: str | None, folder: RunsFolder) -> str | None:
    """Return a rig that the page offers.

    Raises:
        UnknownChoice: another one.
    """
    if name is not None and name not in (known := rig_choices(folder)):
        raise UnknownChoice("rig", name, known)
    return name


def command_arguments(recipe: Recipe, request: FitRequest, folder: RunsFolder) -> list[str]:
    """Return the words behind `benchtool` that do the same."""
    out = str(folder.root / request.name) if request.name else ""
    of_command = {name: request.options.get(name) or None for name in OF_COMMAND}
    given = with_changes(recipe) | of_command | {"out": out}
    return ["fit", *to_arguments(FitInputs, given)]


def suggested_name(folder: RunsFolder, data: Sequence[str]) -> str:
    """Return a free name for the fit of some data."""
    first = re.sub(r"\.csv$", "", data[0].rsplit("/", 1)[-1]) if data else "data"
    return free_path(folder.root / f"fit-{re.sub(r'[^A-Za-z0-9._-]+', '-', first)}").name
