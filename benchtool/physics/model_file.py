"""Models as TOML files: a rig, named effects, parameters, and the columns of somebody's CSV."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from math import inf, isclose, isfinite, isnan
from pathlib import Path
from typing import Any

import tomli_w

from benchtool.core.column_source import ColumnSource, check_channels
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.library import list_names, read_named
from benchtool.core.parameter import Parameter, Prior
from benchtool.core.parsed_text import parse_toml
from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.toml_text import FileTable, FiniteTable, build_dataclass
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.physics.bases import blade_tables, with_blades, with_blades_of_rig
from benchtool.physics.body_lift import BodyDistance
from benchtool.physics.catalogue import find_effect, user_effects
from benchtool.physics.discrepancy import DiscrepancyTolerances
from benchtool.physics.effects.blade_inflow import EFFECT as BLADE_INFLOW
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import OWN_IMAGES, Model


@dataclass(frozen=True, slots=True, kw_only=True)
class _Head(FileTable):
    name: str
    rig: str
    description: str = ""
    wake_rule: str = "notes"
    tilt_rule: str = "axis"
    body_distance: BodyDistance = "half_diagonal"
    effects_file: str = ""
    plate_slide_s: float | None = None

    def __post_init__(self) -> None:
        slide_s = self.plate_slide_s
        if slide_s is not None and not 0.0 <= slide_s < inf:
            raise InputError(f"plate_slide_s is {slide_s:g}; give seconds from 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class _ModelFile(FiniteTable):
    model: _Head
    parameters: Mapping[str, Any] = field(default_factory=dict)
    effects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    columns: Mapping[str, ColumnSource] = field(default_factory=dict)
    where: Mapping[str, str] = field(default_factory=dict)
    discrepancy: DiscrepancyTolerances = field(default_factory=DiscrepancyTolerances)
    imperfections: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class _ParameterTable(FileTable):
    value: float | None = None
    lower: float | None = None
    upper: float | None = None
    free: bool = False
    tolerance: float | None = None
    prior: Prior | None = None
    source: str = ""
    assumed: bool = False

    def __post_init__(self) -> None:
        for name, number in (("value", self.value), ("tolerance", self.tolerance)):
            if number is not None and not isfinite(number):
                raise InputError(f"{name} is {number:g}; give a finite number")
        for name, bound in (("lower", self.lower), ("upper", self.upper)):
            if bound is not None and isnan(bound):
                raise InputError(f"{name} is nan; give a number, or inf for no bound")


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedModel:
    """A model with what its file says beyond physics.

    Attributes:
        columns: our channel name to the source column, for somebody's CSV.
        row_filter: column to value: only those rows are read.
        imperfections: numbers of a virtual bench, when the file describes a truth.
        rig_name: how the file names its rig; empty for a model that no file describes.
        effects_file: Python file with effects of the user's own; empty without.
        plate_slide_s: how long the plate takes to slide in or out; None where not stated.
    """

    model: Model
    columns: Mapping[str, ColumnSource] = field(default_factory=dict)
    row_filter: Mapping[str, str] = field(default_factory=dict)
    imperfections: Mapping[str, float] = field(default_factory=dict)
    rig_name: str = ""
    effects_file: str = ""
    plate_slide_s: float | None = None


def model_names() -> tuple[str, ...]:
    """Return the names of the models that benchtool ships."""
    return list_names("models")


def load_model(
    name_or_path: str | Path, rig: Rig | None = None, permit: CodePermit = check_code_allowed
) -> LoadedModel:
    """Return a shipped model by name, or a user's own by the path of its TOML file.

    Args:
        rig: of the data; it goes before the one that the file names (`_for_rig`).
        permit: called with the file of own effects before it is run.
    """
    text, where = read_named("model", "models", name_or_path)
    if kind := _kind_of_other(text):
        raise FileFormatError(
            where,
            f"this looks like {kind}, and a model is a TOML file with a table [model]; name one, "
            f"or a shipped model: {', '.join(model_names())}",
        )
    return model_from_toml(text, where, rig, permit)


def _kind_of_other(text: str) -> str:
    """Return what a text is that has neither a table nor a key of TOML; empty where it has one."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if not lines or any(line.startswith("[") or "=" in line for line in lines):
        return ""
    return "a CSV table" if any(mark in lines[0] for mark in ",;\t") else "plain text"


def model_from_toml(
    text: str, where: str, rig: Rig | None = None, permit: CodePermit = check_code_allowed
) -> LoadedModel:
    """Return the model that TOML text describes; own effects are run by permit only.

    Raises:
        UnknownChoice: a key, effect, parameter, rule or unit that does not exist.
        FileFormatError: a value of the wrong type or range.
    """
    read = build_dataclass(_ModelFile, parse_toml(text, where), where)
    baseline = _flattened(read.parameters)
    chosen = rig if rig is not None else _rig_beside(read.model.rig, where)
    try:
        if rig is not None:
            baseline = _for_rig(rig, read.model.rig, baseline, where)
        model = replace(
            Model.single(chosen, read.model.name),
            wake_rule=read.model.wake_rule,
            tilt_rule=read.model.tilt_rule,
            body_distance=read.model.body_distance,
            discrepancy=read.discrepancy,
            description=read.model.description,
            provenance=dict(read.provenance),
        )
        file = read.model.effects_file
        if file and not file.endswith(".py"):
            raise InputError(f"effects_file is {file[:80]!r}; name a Python file that ends in .py")
        found = user_effects(str(Path(where).parent / file), permit) if file else ()
        own = {effect.name: effect for effect in found}
        effects = {
            name: _configured(own.get(name) or find_effect(name), tables.get("settings", {}))
            for name, tables in sorted(read.effects.items(), key=lambda item: item[0] != OWN_IMAGES)
        }
        if any(effect.distance_law is not None for effect in effects.values()):
            model = model.without(model.effects[0].name)
        for name, effect in effects.items():
            tables = read.effects[name]
            model = with_blades(model) if effect is BLADE_INFLOW else model.with_effect(effect)
            given = {key: table for key, table in tables.items() if key != "settings"}
            if effect is BLADE_INFLOW:
                given = blade_tables(given, model.rig)
            model = _set(model, {f"{name}.{key}": table for key, table in given.items()}, where)
        model = _set(with_blades_of_rig(model), baseline, where)
    except InputError as error:
        if isinstance(error, FileFormatError):
            raise
        raise FileFormatError(where, str(error)) from error
    check_channels(read.columns, where)
    return LoadedModel(
        model=model,
        columns=read.columns,
        row_filter=read.where,
        imperfections=read.imperfections,
        rig_name=read.model.rig,
        effects_file=read.model.effects_file,
        plate_slide_s=read.model.plate_slide_s,
    )


def stated_in(path: str | Path) -> tuple[Rig, bool]:
    """Return the rig that a user's model file names, and whether the file maps columns.

    None of its own code runs.
    """
    data = parse_toml(*read_named("model", "models", path))
    head = data.get("model")
    if not isinstance(head, dict) or not isinstance(head.get("rig"), str):
        raise FileFormatError(str(path), "model.rig is missing; add it")
    return _rig_beside(head["rig"], str(path)), bool(data.get("columns"))


def _configured(effect: Effect, settings: Mapping[str, Any]) -> Effect:
    if effect.configure is not None:
        return effect.configure(settings)
    if settings:
        raise InputError(f"effect {effect.name!r} takes no settings; take them out")
    return effect


def model_to_toml(loaded: LoadedModel, rig: str | None = None) -> str:
    """Return a model as TOML text that reads back to the same model."""
    model = loaded.model
    effects: dict[str, dict[str, Any]] = {}
    if all(effect.distance_law is None for effect in model.effects):
        effects[OWN_IMAGES] = {"own_strength": {"value": 0.0, "source": "left out"}}
    for effect in model.effects:
        values = model.effect_values(effect, [*model.parameters.values()])
        own = {item.name: item for item in values}
        knots = [item.value for name, item in own.items() if name.startswith("knot_")]
        effects[effect.name] = {
            name: _parameter_table(item)
            for name, item in own.items()
            if not name.startswith("knot_")
        }
        if knots:
            effects[effect.name]["settings"] = {effect.knots_setting: knots}
    baseline = {
        name: _parameter_table(item)
        for name, item in model.parameters.items()
        if name.split(".")[0] not in effects
    }
    data: dict[str, Any] = {
        "model": {
            "name": model.name,
            "rig": rig or model.rig.name,
            "description": model.description,
            "wake_rule": model.wake_rule,
            "tilt_rule": model.tilt_rule,
            "body_distance": model.body_distance,
        },
        "parameters": baseline,
        "effects": effects,
    }
    if loaded.effects_file:
        data["model"]["effects_file"] = loaded.effects_file
    if loaded.plate_slide_s is not None:
        data["model"]["plate_slide_s"] = loaded.plate_slide_s
    more = {
        "columns": {name: _stated(column) for name, column in loaded.columns.items()},
        "where": dict(loaded.row_filter),
        "discrepancy": _stated(model.discrepancy),
        "imperfections": dict(loaded.imperfections),
        "provenance": dict(model.provenance),
    }
    data |= {name: table for name, table in more.items() if table}
    return tomli_w.dumps(data)


def _rig_beside(name: str, where: str) -> Rig:
    beside = Path(where).parent / name
    return load_rig_by_name(beside if name.endswith(".toml") and beside.exists() else name)


def _for_rig(rig: Rig, name: str, tables: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return a file's baseline tables for a rig that may be another than the file's own.

    The baseline (k, R_m, inertia) belongs to a vehicle. Where the two rigs differ in one of these
    numbers, the rig's own replaces a start value and a number that only repeats the file's rig.

    Raises:
        InputError: a number held, or a prior stated, for another vehicle.
    """
    ours = Model.single(rig).parameters
    try:
        named = _rig_beside(name, where)
    except InputError:  # a fit may have been brought here without its rig
        if name == rig.name:
            return dict(tables)
        theirs = None
    else:
        theirs = Model.single(named).parameters
    out = dict(tables)
    for key in ("k", "R_m", "inertia_kgm2"):
        own, other = ours[key].value, None if theirs is None else theirs[key].value
        if key not in tables or (other is not None and isclose(own, other, rel_tol=1e-9)):
            continue
        table = tables[key] if isinstance(tables[key], Mapping) else {"value": tables[key]}
        value = table.get("value")
        repeats = {own, other, None}
        if not table.get("free", False) and value not in repeats:
            raise InputError(
                f"{key} is held at {value:g}, a number of rig {name!r}, but the data are of rig "
                f"{rig.name!r} ({key} {own:g}); free it, or take its value out of the file"
            )
        if "prior" in table:
            raise InputError(
                f"{key} has a prior for rig {name!r}, but the data are of rig {rig.name!r} "
                f"({key} {own:g}); take the prior out of the file, or state one for that rig"
            )
        out[key] = {"free": bool(table.get("free", False))}
    return out


def _flattened(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Return {"noise": {"scale": 1}} as {"noise.scale": 1}, leaving parameter tables whole."""
    flat: dict[str, Any] = {}
    for key, table in tables.items():
        if isinstance(table, Mapping) and not set(table) & _KEYS:
            flat.update({f"{key}.{name}": item for name, item in table.items()})
        else:
            flat[key] = table
    return flat


_KEYS = {item.name for item in fields(_ParameterTable)}


def _set(model: Model, tables: Mapping[str, Any], where: str) -> Model:
    parameters = model.parameters
    for name, table in tables.items():
        given = {"value": table} if isinstance(table, int | float) else table
        if not isinstance(given, Mapping):
            raise FileFormatError(
                where, f"{name} is {given!r}; write a number or {{ value = ..., source = ... }}"
            )
        read = build_dataclass(_ParameterTable, given, f"{where}: {name}")
        keys = ("value", "lower", "upper", "tolerance", "prior")
        stated = {key: getattr(read, key) for key in keys if getattr(read, key) is not None}
        source = read.source or parameters[name].source
        changed = replace(parameters[name], free=read.free, source=source, **stated)
        parameters = parameters.with_replaced(name, changed)
    return model.with_values(parameters)


def _parameter_table(item: Parameter) -> dict[str, Any]:
    table: dict[str, Any] = {"value": item.value, "free": item.free}
    table |= {"lower": item.lower, "upper": item.upper}
    if item.tolerance is not None:
        table["tolerance"] = item.tolerance
    if item.prior.kind != "uniform":
        table["prior"] = asdict(item.prior)
    if item.source:
        table["source"] = item.source
    return table


def _stated(table: ColumnSource | DiscrepancyTolerances) -> dict[str, Any]:
    """Return what differs from its default."""
    given = ((item, getattr(table, item.name)) for item in fields(table))
    return {item.name: value for item, value in given if value != item.default}
