"""Which models the page may fit, and the numbers of one to free, fix or leave. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePosixPath

from benchtool.core.errors import InputError
from benchtool.core.own_code import refuse_code
from benchtool.core.parsed_text import parse_toml
from benchtool.core.rig import Rig
from benchtool.core.rig_file import rig_names
from benchtool.core.user_file import read_text
from benchtool.data.run.entry import Entry
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.physics.model_file import LoadedModel, load_model, model_names

MODEL_FILE = "model.toml"


@dataclass(frozen=True, slots=True, kw_only=True)
class AdjustableParameter:
    """Hold one number of a model as a form shows it.

    Attributes:
        name: its full name.
        unit: of its value.
        value: that the model has.
        free: whether the model frees it.
        lower, upper: its bounds.
        source: where the value comes from.
    """

    name: str
    unit: str
    value: float
    free: bool
    lower: float
    upper: float
    source: str = ""


@dataclass(frozen=True, slots=True)
class ParameterChoice:
    """Choose one number of a model to be free, or fixed at a value."""

    free: bool
    value: float


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
    _refuse_outside(folder, chosen, path)
    return str(path)


def _refuse_outside(folder: RunsFolder, chosen: str, path: Path) -> None:
    head = parse_toml(read_text(path), chosen).get("model", {})
    if isinstance(head, dict) and head.get("effects_file"):
        refuse_code(f"{PurePosixPath(chosen).parent}/{head['effects_file']}")
    named = str(head.get("rig", "")) if isinstance(head, dict) else ""
    if not named or named in rig_names():
        return
    if PurePosixPath(named).name != named:
        raise InputError(
            f"{chosen} takes its rig from {named!r}, outside its own folder, and the page reads "
            f"the runs folder only; fit it with benchtool fit --model"
        )
    folder.file_of(f"{PurePosixPath(chosen).parent}/{named}")


def adjustables(model: str, rig: Rig | None = None) -> tuple[AdjustableParameter, ...]:
    """Return the numbers of a model; those of the noise follow from the option for it.

    Args:
        model: as `model_path` gives it.
        rig: of the data, which goes before the one that the model file names.
    """
    return tuple(
        AdjustableParameter(
            name=name,
            unit=item.unit,
            value=item.value,
            free=item.free,
            lower=item.lower,
            upper=item.upper,
            source=item.source,
        )
        for name, item in loaded(model, rig).model.parameters.items()
        if not name.startswith("noise.")
    )


def loaded(model: str, rig: Rig | None = None) -> LoadedModel:
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
    numbers: Sequence[AdjustableParameter], choices: Mapping[str, ParameterChoice]
) -> dict[str, object]:
    """Return the recipe's options free, hold and fix that make a model's numbers as chosen.

    What is as the model has it needs no option.
    """
    free: list[str] = []
    hold: list[str] = []
    fix: dict[str, float] = {}
    for number in numbers:
        choice = choices.get(number.name)
        if choice is None:
            continue
        if choice.free:
            if not number.free:
                free.append(number.name)
        elif choice.value != number.value:
            fix[number.name] = choice.value
        elif number.free:
            hold.append(number.name)
    return {"free": free, "hold": hold, "fix": fix}
