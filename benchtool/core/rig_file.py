"""Rig files in TOML, with a source for every number."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, asdict, fields, replace
from functools import lru_cache
from math import inf, pi
from pathlib import Path
from typing import Any

import tomli_w

from benchtool.core.air import STANDARD_DENSITY_KG_M3
from benchtool.core.errors import FileFormatError, InputError, check_name
from benchtool.core.rig import UNSPECIFIED, Body, Motor, PlateDrive, Propeller, Rig, Sensor
from benchtool.core.toml_text import ValueSources, build_dataclass, parse_quantities
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.core.user_file import LIBRARY, list_names, read_library_file


def rig_names() -> tuple[str, ...]:
    """Return the names of the bundled rigs."""
    return list_names("rigs")


def load_rig_by_name(name_or_path: str | Path) -> Rig:
    """Return a rig by name (bundled or user-defined) or by the path of its TOML file."""
    return parse_rig(*read_library_file("rig", "rigs", name_or_path))


@lru_cache(maxsize=32)
def parse_rig(text: str, where: str) -> Rig:
    """Return the rig of TOML text.

    Raises:
        UnknownChoice: unknown key.
        FileFormatError: number without source, of the wrong type, or out of range.
    """
    data, value_sources = parse_quantities(text, where)
    _fill_missing(data, value_sources)
    rig = build_dataclass(Rig, data, where)
    rig = replace(rig, sources=value_sources.by_key, assumed=tuple(value_sources.assumed))
    check_name(f"rig in {where}", rig.name)
    for problem in _problems(rig):
        raise FileFormatError(where, problem)
    return rig


MAX_DIAMETER_DIFFERENCE = 0.01  # relative, propeller to rig (rounded names)
Typical = float | str | Callable[[float, int, Mapping[str, Any]], Any]  # radius, rotors, tables


def _pulse(tables: Mapping[str, Any], name: str) -> float:
    return float(tables["propulsion"][name])


def _thrust_N(tables: Mapping[str, Any], n: int, fraction: float) -> float:
    """Return the thrust of all rotors at a fraction of the maximum speed."""
    range_us = _pulse(tables, "pwm_max_us") - _pulse(tables, "pwm_start_us")
    speed_rad_s = fraction * (range_us * _pulse(tables, "speed_per_us_rad_s"))
    return float(n * (_pulse(tables, "thrust_coefficient_N_s2") * speed_rad_s**2))


TYPICAL: dict[str, tuple[Typical, str]] = {  # of missing keys, in order; assumed
    "propulsion.thrust_coefficient_N_s2": (
        lambda R, n, tables: 0.11 * STANDARD_DENSITY_KG_M3 * (2.0 * R) ** 4 / (2.0 * pi) ** 2,
        "C_T 0.11 in air of 1.225 kg/m3, typical static run of the UIUC Propeller Database",
    ),
    "propulsion.drag_coefficient_Nm_s2": (
        lambda R, n, tables: 0.045 * STANDARD_DENSITY_KG_M3 * (2.0 * R) ** 5 / (2.0 * pi) ** 3,
        "C_P 0.045 in air of 1.225 kg/m3, typical static run of the UIUC Propeller Database",
    ),
    "propulsion.pwm_stop_us": (1000.0, "1000 us, the convention of hobby ESCs"),
    "propulsion.pwm_start_us": (
        lambda R, n, tables: _pulse(tables, "pwm_stop_us") + 50.0,
        "50 us above the stop pulse",
    ),
    "propulsion.pwm_max_us": (1950.0, "1950 us, the convention of hobby ESCs"),
    "propulsion.speed_per_us_rad_s": (
        lambda R, n, tables: (
            110.0 / R / (_pulse(tables, "pwm_max_us") - _pulse(tables, "pwm_start_us"))
        ),
        "tip speed 110 m/s at the maximum pulse",
    ),
    "propulsion.voltage_nominal_V": (11.1, "11.1 V, 3S lithium polymer"),
    "propulsion.lag_s": (0.05, "0.05 s, typical for rotors of 10 to 30 cm"),
    "propulsion.efficiency": (0.75, "0.75, typical for brushless motors at hover"),
    "body.mass_kg": (
        lambda R, n, tables: _thrust_N(tables, n, 0.6) / STANDARD_GRAVITY_M_S2,
        "hover at 0.6 of the maximum speed",
    ),
    "body.inertia_xx_kgm2": (
        lambda R, n, tables: tables["body"]["mass_kg"] * R**2 * (1.0 if n > 1 else 0.5),
        "mass at the scale of the rotor radius",
    ),
    "body.inertia_yy_kgm2": (lambda R, n, tables: tables["body"]["inertia_xx_kgm2"], "as xx"),
    "body.inertia_zz_kgm2": (
        lambda R, n, tables: 2.0 * tables["body"]["inertia_xx_kgm2"],
        "twice xx",
    ),
    "plate.moved_by": ("device", "the bench"),
    "plate.z_min_m": (lambda R, n, tables: 0.4 * R, "0.4 rotor radii"),
    "plate.z_max_m": (
        lambda R, n, tables: 1.1 * tables["plate"].get("z_park_m", 11.5 * R),
        "10 % beyond the park position",
    ),
    "plate.z_park_m": (
        lambda R, n, tables: min(11.5 * R, tables["plate"]["z_max_m"]),
        "11.5 rotor radii (eq. (4) below 0.3 %), or the end of the travel",
    ),
    "plate.speed_m_s": (0.1, "0.1 m/s, typical for a belt-driven stage"),
    "plate.backlash_m": (0.0, "none"),
    "plate.size_x_m": (lambda R, n, tables: 10.0 * R, "ten rotor radii"),
    "plate.size_y_m": (lambda R, n, tables: 10.0 * R, "ten rotor radii"),
    "limits.load_cell_rating_N": (
        lambda R, n, tables: 2.0 * _thrust_N(tables, n, 1.0),
        "twice the maximum thrust",
    ),
    "limits.thrust_N": (
        lambda R, n, tables: 0.8 * tables["limits"]["load_cell_rating_N"],
        "0.8 of the load cell's rating",
    ),
    "limits.rpm": (lambda R, n, tables: 0.7 * 340.0 / R * 30.0 / pi, "tip speed Mach 0.7"),
    "limits.current_A": (1000.0, "no limit"),
    "limits.voltage_min_V": (0.0, "no limit"),
    "limits.temperature_degC": (90.0, "90 degC, for magnets and windings of small motors"),
    "limits.pwm_us": (lambda R, n, tables: _pulse(tables, "pwm_max_us"), "the maximum pulse"),
}


def _fill_missing(data: dict[str, Any], value_sources: ValueSources) -> None:
    """Add typical values for those missing in a rig file, each with its source."""
    propulsion = data.setdefault("propulsion", {})
    radius_m = propulsion.get("radius_m") if isinstance(propulsion, dict) else None
    if not isinstance(radius_m, int | float) or not 0.0 < radius_m < inf:
        radius_m = 0.1  # reported by the later check of the whole rig
    data.setdefault("title", data.get("name"))
    data.setdefault("sensors", {})
    if "rotors" not in data:
        data["rotors"] = [{"name": "rotor", "x_m": 0.0, "y_m": 0.0, "spin": 1}]
        value_sources.by_key |= {
            f"rotors[0].{key}": f"{UNSPECIFIED}: one rotor" for key in ("x_m", "y_m", "spin")
        }
    for key, (typical, reason) in TYPICAL.items():
        table, _, name = key.partition(".")
        if not isinstance(data.setdefault(table, {}), dict) or name in data[table]:
            continue
        try:
            values = float(radius_m), len(data["rotors"]), data
            data[table][name] = typical(*values) if callable(typical) else typical
        except (TypeError, ValueError, KeyError, ZeroDivisionError, OverflowError):
            return  # reported by the later check of the whole rig
        value_sources.by_key[key] = f"{UNSPECIFIED}: {reason}"


def require_values(rig: Rig, keys: Sequence[str], purpose: str) -> None:
    """Raise InputError if a rig does not state values that a purpose needs."""
    missing = [key for key in keys if key in rig.not_stated]
    if missing:
        raise InputError(
            f"rig {rig.name} does not state {', '.join(missing)}, which {purpose} needs; add it to "
            f"the rig's file, as {missing[0].rpartition('.')[2]} = "
            f"{{ value = ..., source = 'data sheet' }} under [{missing[0].partition('.')[0]}]"
        )


def _problems(rig: Rig) -> Iterator[str]:
    """Yield contradictions between the values of a rig, with remedies."""
    limits, plate, propulsion = rig.limits, rig.plate, rig.propulsion
    if limits.thrust_N > limits.load_cell_rating_N:
        yield (
            f"limits.thrust_N is {limits.thrust_N:g} N, above the load cell's rating of "
            f"{limits.load_cell_rating_N:g} N; lower the limit"
        )
    if not plate.z_min_m < plate.z_max_m:
        yield (
            f"plate.z_min_m {plate.z_min_m:g} is not below plate.z_max_m {plate.z_max_m:g}; "
            f"swap or correct them"
        )
    if not propulsion.pwm_stop_us <= propulsion.pwm_start_us < propulsion.pwm_max_us:
        yield (
            "propulsion needs pwm_stop_us <= pwm_start_us < pwm_max_us, got "
            f"{propulsion.pwm_stop_us:g}, {propulsion.pwm_start_us:g}, {propulsion.pwm_max_us:g}"
        )
    propeller, diameter_m = rig.propeller, 2.0 * propulsion.radius_m
    if propeller and abs(propeller.diameter_m / diameter_m - 1.0) > MAX_DIAMETER_DIFFERENCE:
        yield (
            f"propeller.diameter_m is {propeller.diameter_m:g} m, but propulsion.radius_m makes "
            f"{diameter_m:g} m; correct one of them"
        )
    if rig.motor and not rig.motor.governed and not rig.motor.has_curve:
        yield (
            "motor needs Kv_rpm_V and resistance_ohm, or governed = true if the ESC controls "
            "the speed; add them, or remove the table"
        )


RIG_FILE = "rig.toml"  # name of the rig file in the folder of the model that uses it


def export_rig_reference(rig: Rig) -> tuple[str, str]:
    """Return the rig reference of a new model file, and the text of the file `RIG_FILE`.

    The text is empty for a bundled rig with the same values.
    """
    if rig.name in rig_names():
        where = f"rigs/{rig.name}.toml"
        bundled = parse_rig((LIBRARY / where).read_text(encoding="utf-8"), where)
        if replace(bundled, sources=rig.sources, assumed=rig.assumed) == rig:
            return rig.name, ""
    return RIG_FILE, rig_to_toml(rig)


def rig_to_toml(rig: Rig) -> str:
    """Return a rig as TOML text without typical values; parsing it gives the same rig."""
    tables = asdict(rig)
    del tables["sources"], tables["assumed"]
    written = {key: _with_source(value, key, rig) for key, value in tables.items()}
    return tomli_w.dumps({key: value for key, value in written.items() if value})


def _with_source(value: Any, key: str, rig: Rig) -> Any:
    """Return a value of a rig with numbers as quantities; empty if nothing in it is stated."""
    if isinstance(value, dict):
        return {
            name: _with_source(item, f"{key}.{name}", rig)
            for name, item in value.items()
            if _is_stated(item, f"{key}.{name}", rig)
        }
    if isinstance(value, list | tuple):
        if f"{key}[0].x_m" in rig.not_stated:
            return []
        return [_with_source(item, f"{key}[{index}]", rig) for index, item in enumerate(value)]
    if value is None or isinstance(value, str):
        return value
    source = rig.sources.get(key) or "the rig of the run"
    return {"value": value, "source": source, "assumed": key in rig.assumed}


_DEFAULTS = {
    item.name: item.default
    for table in (Body, Motor, PlateDrive, Propeller, Sensor)
    for item in fields(table)
    if item.default is not MISSING
}


def _is_stated(value: Any, key: str, rig: Rig) -> bool:
    """Return True for a value that is neither a default nor typical."""
    default = _DEFAULTS.get(key.rpartition(".")[2], MISSING)
    if key in rig.not_stated or value is None:
        return False
    return key in rig.sources or value != default
