"""Models as TOML files: rig, effects, parameters, and columns of a CSV file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from math import inf, isclose, isfinite, isnan
from pathlib import Path
from typing import Any

import tomli_w

from benchtool.core.channel import ColumnSource, check_channels
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.parameter import Parameter, Prior
from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.toml_text import FileTable, FiniteTable, build_dataclass, parse_toml
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.core.user_file import list_names, read_library_file
from benchtool.physics.baseline import DiscrepancyTolerances
from benchtool.physics.bases import blade_tables, with_blades, with_rig_blades
from benchtool.physics.body_lift import BodyDistance
from benchtool.physics.catalogue import find_effect, user_effects
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
            raise InputError(f"plate_slide_s = {slide_s:g} s is out of range; allowed: from 0 s")


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
                raise InputError(f"{name} = {number:g} is not a finite number")
        for name, bound in (("lower", self.lower), ("upper", self.upper)):
            if bound is not None and isnan(bound):
                raise InputError(f"{name} = nan is not a number; use inf for no bound")


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedModel:
    """Model with the other contents of its file."""

    model: Model
    # Channel name to source column of a CSV file
    columns: Mapping[str, ColumnSource] = field(default_factory=dict)
    # Column name to value; only matching rows are read
    row_filter: Mapping[str, str] = field(default_factory=dict)
    # Of a virtual bench, for a file that defines one
    imperfections: Mapping[str, float] = field(default_factory=dict)
    rig_name: str = ""  # name of the rig in the file; empty without a file
    effects_file: str = ""  # Python file with user-defined effects; empty for none
    plate_slide_s: float | None = None  # time of the plate to slide in or out; None if not defined


def model_names() -> tuple[str, ...]:
    """Return the names of the models in the library."""
    return list_names("models")


def load_model(
    name_or_path: str | Path, rig: Rig | None = None, permit: CodePermit = check_code_allowed
) -> LoadedModel:
    """Return a model of the library by name, or a user's model by the path of its TOML file.

    Args:
        rig: of the data; it has precedence over the rig of the file (`_adapt_to_rig`).
        permit: called with the file of user-defined effects before it is run.
    """
    text, where = read_library_file("model", "models", name_or_path)
    if kind := _detect_other_format(text):
        raise FileFormatError(
            where,
            f"this looks like {kind}, not a TOML file with a table [model]; use a model file or "
            f"one of: {', '.join(model_names())}",
        )
    return model_from_toml(text, where, rig, permit)


def _detect_other_format(text: str) -> str:
    """Return the format of a text without any table or key of TOML; empty for TOML."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if not lines or any(line.startswith("[") or "=" in line for line in lines):
        return ""
    return "a CSV table" if any(mark in lines[0] for mark in ",;\t") else "plain text"


def model_from_toml(
    text: str, where: str, rig: Rig | None = None, permit: CodePermit = check_code_allowed
) -> LoadedModel:
    """Return the model of a TOML text; user code runs only with permission."""
    file = build_dataclass(_ModelFile, parse_toml(text, where), where)
    head = file.model
    baseline = _flatten_tables(file.parameters)
    model_rig = rig if rig is not None else _load_rig(head.rig, where)
    try:
        if rig is not None:
            baseline = _adapt_to_rig(rig, head.rig, baseline, where)
        model = replace(
            Model.single(model_rig, head.name),
            wake_rule=head.wake_rule,
            tilt_rule=head.tilt_rule,
            body_distance=head.body_distance,
            discrepancy=file.discrepancy,
            description=head.description,
            provenance=dict(file.provenance),
        )
        path = head.effects_file
        if path and not path.endswith(".py"):
            raise InputError(f"effects_file {path[:80]!r} is not a Python file (*.py)")
        imported = user_effects(str(Path(where).parent / path), permit) if path else ()
        user_defined = {effect.name: effect for effect in imported}
        effects = {
            name: _configure(
                user_defined.get(name) or find_effect(name), tables.get("settings", {})
            )
            for name, tables in sorted(file.effects.items(), key=lambda item: item[0] != OWN_IMAGES)
        }
        if any(effect.distance_law is not None for effect in effects.values()):
            model = model.without(model.effects[0].name)
        for name, effect in effects.items():
            model = with_blades(model) if effect is BLADE_INFLOW else model.with_effect(effect)
            tables = {key: value for key, value in file.effects[name].items() if key != "settings"}
            if effect is BLADE_INFLOW:
                tables = blade_tables(tables, model.rig)
            tables = {f"{name}.{key}": table for key, table in tables.items()}
            model = _set_parameters(model, tables, where)
        model = _set_parameters(with_rig_blades(model), baseline, where)
    except InputError as error:
        if isinstance(error, FileFormatError):
            raise
        raise FileFormatError(where, str(error)) from error
    check_channels(file.columns, where)
    return LoadedModel(
        model=model,
        columns=file.columns,
        row_filter=file.where,
        imperfections=file.imperfections,
        rig_name=head.rig,
        effects_file=head.effects_file,
        plate_slide_s=head.plate_slide_s,
    )


def read_model_head(path: str | Path) -> tuple[Rig, bool]:
    """Return the rig of a model file, and True if the file maps columns; runs no user code."""
    data = parse_toml(*read_library_file("model", "models", path))
    head = data.get("model")
    if not isinstance(head, dict) or not isinstance(head.get("rig"), str):
        raise FileFormatError(str(path), "model.rig is missing; add it")
    return _load_rig(head["rig"], str(path)), bool(data.get("columns"))


def _configure(effect: Effect, settings: Mapping[str, Any]) -> Effect:
    """Return the effect for its settings in a model file, which are the values of its knots."""
    setting = effect.knots_setting
    if settings and effect.with_knots is None:
        raise InputError(f"effect {effect.name!r} has no settings; remove [effects.*.settings]")
    if unknown := set(settings) - {setting}:
        raise InputError(f"unknown setting {min(unknown)!r} of {effect.name}; allowed: {setting}")
    if effect.with_knots is None or setting not in settings:
        return effect
    try:
        knots = [float(value) for value in settings[setting]]
    except (TypeError, ValueError, OverflowError) as error:
        ends = next(item for item in effect.parameters if item.name.startswith("knot_"))
        raise InputError(
            f"{setting} {settings[setting]!r:.80} is not a list of numbers between {ends.lower:g} "
            f"and {ends.upper:g}"
        ) from error
    return effect.with_knots(knots)


def model_to_toml(loaded: LoadedModel, rig: str | None = None) -> str:
    """Return a model as TOML text; reading it returns the same model."""
    model = loaded.model
    effects: dict[str, dict[str, Any]] = {}
    if all(effect.distance_law is None for effect in model.effects):
        effects[OWN_IMAGES] = {"own_strength": {"value": 0.0, "source": "left out"}}
    for effect in model.effects:
        parameters = model.effect_values(effect, [*model.parameters.values()])
        knots = [item.value for item in parameters if item.name.startswith("knot_")]
        effects[effect.name] = {
            item.name: _parameter_table(item)
            for item in parameters
            if not item.name.startswith("knot_")
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
    optional = {
        "columns": {name: _changed_fields(column) for name, column in loaded.columns.items()},
        "where": dict(loaded.row_filter),
        "discrepancy": _changed_fields(model.discrepancy),
        "imperfections": dict(loaded.imperfections),
        "provenance": dict(model.provenance),
    }
    data |= {name: table for name, table in optional.items() if table}
    return tomli_w.dumps(data)


def _load_rig(name: str, where: str) -> Rig:
    """Return a rig by name, or by a path relative to the model file."""
    path = Path(where).parent / name
    return load_rig_by_name(path if name.endswith(".toml") and path.exists() else name)


def _adapt_to_rig(rig: Rig, name: str, tables: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return a file's baseline tables for the rig of the data, which may not be that of the file.

    The baseline (k, R_m, inertia) depends on the vehicle. If the two rigs differ, the value of the
    data's rig replaces initial values and values equal to those of the file's rig.
    """
    rig_parameters = Model.single(rig).parameters
    try:
        file_rig = _load_rig(name, where)
    except InputError:  # a fitted model may have been copied without its rig
        if name == rig.name:
            return dict(tables)
        file_parameters = None
    else:
        file_parameters = Model.single(file_rig).parameters
    adapted = dict(tables)
    for key in ("k", "R_m", "inertia_kgm2"):
        rig_value = rig_parameters[key].value
        file_value = None if file_parameters is None else file_parameters[key].value
        if key not in tables:
            continue
        if file_value is not None and isclose(rig_value, file_value, rel_tol=1e-9):
            continue
        table = tables[key] if isinstance(tables[key], Mapping) else {"value": tables[key]}
        value = table.get("value")
        if not table.get("free", False) and value not in {rig_value, file_value, None}:
            raise InputError(
                f"{key} is fixed at {value:g} for rig {name!r}, but the data are from rig "
                f"{rig.name!r} ({key} {rig_value:g}); free it or remove its value from the file"
            )
        if "prior" in table:
            raise InputError(
                f"{key} has a prior for rig {name!r}, but the data are from rig {rig.name!r} "
                f"({key} {rig_value:g}); remove the prior or define one for that rig"
            )
        adapted[key] = {"free": bool(table.get("free", False))}
    return adapted


def _flatten_tables(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Return {"noise": {"scale": 1}} as {"noise.scale": 1}; parameter tables stay unchanged."""
    flat: dict[str, Any] = {}
    for key, table in tables.items():
        if isinstance(table, Mapping) and not set(table) & _KEYS:
            flat.update({f"{key}.{name}": item for name, item in table.items()})
        else:
            flat[key] = table
    return flat


_KEYS = {item.name for item in fields(_ParameterTable)}


def _set_parameters(model: Model, tables: Mapping[str, Any], where: str) -> Model:
    parameters = model.parameters
    for name, value in tables.items():
        table = {"value": value} if isinstance(value, int | float) else value
        if not isinstance(table, Mapping):
            raise FileFormatError(
                where, f"{name} = {table!r} is not a number or {{ value = ..., source = ... }}"
            )
        entry = build_dataclass(_ParameterTable, table, f"{where}: {name}")
        keys = ("value", "lower", "upper", "tolerance", "prior")
        changes = {key: getattr(entry, key) for key in keys if getattr(entry, key) is not None}
        source = entry.source or parameters[name].source
        parameter = replace(parameters[name], free=entry.free, source=source, **changes)
        parameters = parameters.with_replaced(name, parameter)
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


def _changed_fields(table: ColumnSource | DiscrepancyTolerances) -> dict[str, Any]:
    """Return the fields that differ from their defaults."""
    values = ((item, getattr(table, item.name)) for item in fields(table))
    return {item.name: value for item, value in values if value != item.default}
