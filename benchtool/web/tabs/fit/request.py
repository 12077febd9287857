"""What the Fit form asks for, as a recipe and as the words of the command. Pure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from benchtool.core.errors import InputError
from benchtool.core.inputs import changed, make, words
from benchtool.core.rig import Rig
from benchtool.data.csv_text import read_csv_text
from benchtool.data.run.entry import Entry
from benchtool.data.run.run_rig import rig_of_data
from benchtool.data.run.runs_folder import RunsFolder, columns_file
from benchtool.fit.recipe import FitInputs, Recipe
from benchtool.web.tabs.fit.model_choice import (
    ParameterChoice,
    adjustables,
    choice_options,
    loaded,
    model_path,
)


@dataclass(slots=True, kw_only=True)
class FitRequest:
    """Hold what the form says.

    Attributes:
        data: names of runs and tables.
        model: as `choice.model_choices` calls it.
        choices: by parameter, where the form differs from the model.
        name: of the folder that is made.
        options: other inputs of the command, by name.
    """

    data: list[str] = field(default_factory=list)
    model: str = "quad_bench"
    choices: dict[str, ParameterChoice] = field(default_factory=dict)
    name: str = ""
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def profile(self) -> bool:
        """Whether intervals are wanted from the profile likelihood as well."""
        return bool(self.options.get("profile"))


def recipe_for(request: FitRequest, folder: RunsFolder, entries: Mapping[str, Entry]) -> Recipe:
    """Return the recipe that the form asks for.

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
    if tables and not stored and not loaded(model).columns:
        for name in tables:
            header = read_csv_text(folder.file_of(name)).header
            if "thrust_N" not in header:
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
    choices = choice_options(adjustables(model, data_rig(request.data, folder)), request.choices)
    options = {name: each for name, each in request.options.items() if name != "profile"}
    return make(Recipe, {**choices, **options}, source="label", base=base)


def data_rig(data: Sequence[str], folder: RunsFolder) -> Rig | None:
    """Return the rig of the runs among some data, None where there is none.

    Raises:
        InputError: runs of two vehicles.
    """
    return rig_of_data([str(folder.path_of(name)) for name in data])


def words_for(recipe: Recipe, request: FitRequest, folder: RunsFolder) -> list[str]:
    """Return the words behind `benchtool` that do the same."""
    out = str(folder.root / request.name) if request.name else ""
    given = changed(recipe) | {"profile": request.profile, "out": out}
    return ["fit", *words(FitInputs, given)]


def suggested_name(folder: RunsFolder, data: Sequence[str]) -> str:
    """Return a free name for the fit of some data."""
    first = re.sub(r"\.csv$", "", data[0].rsplit("/", 1)[-1]) if data else "data"
    name = f"fit-{re.sub(r'[^A-Za-z0-9._-]+', '-', first)}"
    count = 1
    while (folder.root / (name if count == 1 else f"{name}-{count}")).exists():
        count += 1
    return name if count == 1 else f"{name}-{count}"
