"""Columns of foreign tables: names, units, and maps to channels.

A map is written by hand, by the page, or by `benchtool fit` from the names of columns; every reader
of foreign tables accepts it. pint converts units that benchtool does not define.
"""

from __future__ import annotations

import re
import tokenize
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from benchtool.core.channel import ColumnSource, check_channels, is_known_channel, unit_from_name
from benchtool.core.errors import FileFormatError, InputError, MissingColumn, UnknownChoice
from benchtool.core.toml_text import FileTable, build_dataclass, parse_toml
from benchtool.core.units import STANDARD_GRAVITY_M_S2, UNITS, find_unit
from benchtool.core.user_file import read_library_file

_SPELLINGS: dict[str, str] = {  # seen in real headers (RCbenchmark writes µs, N·m and ºC)
    **dict.fromkeys(("µs", "μs", "usec"), "us"),
    **dict.fromkeys(("RPM", "Rpm", "U/min", "1/min", "min-1"), "rpm"),
    **dict.fromkeys(("N·m", "N⋅m", "N*m", "Nm", "N.m", "N-m"), "N m"),
    **dict.fromkeys(("ºC", "°C", "C"), "degC"),
    **dict.fromkeys(("º", "°"), "deg"),
    "°F": "degF",
    "sec": "s",
    "": "1",
}

_FORCE_OF_MASS: dict[str, str] = {"g": "gf", "kg": "kgf", "lb": "lbf", "oz": "ozf"}  # weight

_TURNS: frozenset[str] = frozenset({"Hz", "rps", "rev/s", "1/s"})  # pint takes Hz for rad/s

_FOR_PINT: dict[str, str] = {
    "1": "dimensionless",
    "rpm": "revolutions_per_minute",
    "pwm_us": "microsecond",
    "gf": "force_gram",
    "kgf": "kilogram_force",
    "lbf": "pound_force",
    "ozf": "force_ounce",
    "lbft": "force_pound * foot",
    "N m": "newton * meter",
    "mN m": "millinewton * meter",
    "kg m2": "kilogram * meter ** 2",
    "kg/m3": "kilogram / meter ** 3",
    "m/s2": "meter / second ** 2",
}


def is_unit(text: str) -> bool:
    """Return whether a text is a unit: of benchtool, a known spelling or a unit of mass."""
    return text not in ("", "1") and text in {*UNITS, *_SPELLINGS, *_FORCE_OF_MASS, *_TURNS}


@dataclass(frozen=True, slots=True)
class Conversion:
    """Linear unit conversion: channel value = factor * file value + offset."""

    factor: float
    offset: float = 0.0


def find_conversion(text: str, target: str) -> Conversion:
    """Return the conversion from the unit `text` to the unit `target`."""
    unit = " ".join(text.split())
    unit = _SPELLINGS.get(unit, unit)
    dimension = find_unit(target).dimension
    if dimension == "force":
        unit = _FORCE_OF_MASS.get(unit, unit)
    if dimension == "acceleration" and unit == "g":
        return Conversion(STANDARD_GRAVITY_M_S2)
    if dimension == "angular speed" and unit in _TURNS:
        unit = "revolutions_per_second"
    if unit == target or (target == "pwm_us" and unit == "us"):
        return Conversion(1.0)
    listed = UNITS.get(unit)
    if listed is not None and listed.dimension == dimension:
        ours = find_unit(target)
        return Conversion(listed.factor / ours.factor, (listed.offset - ours.offset) / ours.factor)
    return _through_pint(unit, target, text)


def unit_in_header(text: str, target: str) -> Conversion | None:
    """Return the conversion from a header's text in brackets, or None if it is not a unit.

    Raises InputError for a unit of another dimension.
    """
    if not text:
        return None
    try:
        return find_conversion(text, target)
    except InputError as error:
        if type(error.__cause__).__name__ != "DimensionalityError":
            return None
        raise


def _through_pint(unit: str, target: str, text: str) -> Conversion:
    import pint

    registry = _registry()
    ours = registry.Unit(_FOR_PINT.get(target, target))
    try:
        theirs = registry.Unit(_FOR_PINT.get(unit, re.sub(r"(?<=[a-zA-Z])(\d)", r"**\1", unit)))
        at_zero, at_one = (
            float(registry.Quantity(number, theirs).to(ours).magnitude) for number in (0.0, 1.0)
        )
    except pint.DimensionalityError as error:
        raise InputError(
            f"unit {text!r} is not a unit of {find_unit(target).dimension} ({target}); correct the "
            f"column's unit"
        ) from error
    except _PINT_FAULTS as error:
        raise InputError(
            f"unit {text!r} is unknown; use N, gf, lbf, ozf, rpm, Hz, us, degF, ..., or another "
            f"unit of pint"
        ) from error
    return Conversion(at_one - at_zero, at_zero)


_PINT_FAULTS = (  # for text that is not a unit (UndefinedUnitError is an AttributeError)
    *(AttributeError, ValueError, TypeError, KeyError, SyntaxError, AssertionError),
    *(ArithmeticError, RecursionError, NotImplementedError, tokenize.TokenError),
)


@cache
def _registry() -> Any:
    """Return pint's registry, created on demand, as that takes 0.1 s."""
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


_WITH_UNIT = re.compile(r"(?P<name>.*?)\s*[(\[](?P<unit>[^()\[\]]*)[)\]]")


class HeaderCell(NamedTuple):
    """Name and unit of a column as in the header; the unit may be missing."""

    name: str
    unit: str | None


def parse_header_cell(cell: str) -> HeaderCell:
    """Return name and unit of a header cell."""
    cell = cell.strip()
    match = _WITH_UNIT.fullmatch(cell)
    if match is None or not match["name"]:
        return HeaderCell(cell, None)
    return HeaderCell(match["name"].strip(), match["unit"].strip())


ColumnMap = Mapping[str, ColumnSource | Mapping[str, Any] | str]  # by our name; text: a column

IDENTITY = Conversion(1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class MappedColumn:
    """Source of one channel: a column of the table, or a constant."""

    name: str
    position: int | None  # of the column; None for a constant
    conversion: Conversion = IDENTITY  # to the channel's unit, sign and factor included
    constant: float = 0.0  # in the channel's unit
    source: str = ""  # column and unit as in the file
    reference: str = ""  # cell value of reference rows; empty if the cells are numbers


def map_columns(header: Sequence[str], where: str, columns: ColumnMap) -> list[MappedColumn]:
    """Return the source of each channel in a table with this header.

    The default unit is the one in brackets in the column's name, else the channel's. Raises
    MissingColumn, with all columns of the map that are missing in the header.
    """
    sources: dict[str, ColumnSource] = {}
    for name, source in columns.items():
        if isinstance(source, str):
            source = ColumnSource(column=source)
        elif not isinstance(source, ColumnSource):
            source = build_dataclass(ColumnSource, source, f"[columns] {name}")
        sources[name] = source
    names = dict.fromkeys(source.column for source in sources.values() if source.column is not None)
    if missing := [name for name in names if name.strip() not in header]:
        raise MissingColumn(where, missing, header)
    return [_map_column(header, where, name, source) for name, source in sources.items()]


def _map_column(header: Sequence[str], where: str, name: str, source: ColumnSource) -> MappedColumn:
    ours = unit_from_name(name)
    scale, unit = IDENTITY, source.unit or ours
    try:
        if source.unit is not None:
            scale = find_conversion(source.unit, ours)
        elif source.column is not None and source.factor == 1.0 and not source.reference:
            header_unit = parse_header_cell(source.column).unit or ""
            if (header_scale := unit_in_header(header_unit, ours)) is not None:
                scale, unit = header_scale, header_unit
    except InputError as error:
        raise InputError(f"[columns] {name}: {error}") from error
    factor = source.sign * source.factor
    scale = Conversion(scale.factor * factor, scale.offset)
    if source.column is None:
        assert source.constant is not None
        value = scale.factor * source.constant + scale.offset
        description = f"constant {source.constant:g} {unit}"
        return MappedColumn(name=name, position=None, constant=value, source=description)
    factor_text = "" if factor == 1.0 else f" times {factor:g}"
    return MappedColumn(
        name=name,
        position=column_index(header, source.column, where),
        conversion=scale,
        source=f"{source.column} [{unit}]{factor_text}",
        reference=source.reference or "",
    )


def column_index(header: Sequence[str], column: str, where: str) -> int:
    """Return the position of a column; raise if it is missing or not unique."""
    column = column.strip()
    if (count := header.count(column)) > 1:
        raise FileFormatError(
            where, f"column {column!r} occurs {count} times in the header; rename all but one"
        )
    if not count:
        raise UnknownChoice(f"column of {where}", column, filter(None, header))
    return header.index(column)


@dataclass(frozen=True, slots=True, kw_only=True)
class _ColumnsFile(FileTable):
    columns: Mapping[str, ColumnSource]


def read_column_map(path: str | Path) -> Mapping[str, ColumnSource]:
    """Return the `[columns]` of a column map file."""
    text, where = read_library_file("columns file", "models", path)
    data = parse_toml(text, where)
    entries = data if "columns" in data else {"columns": data}
    mapping = entries["columns"]
    if not isinstance(mapping, dict) or not mapping:
        raise FileFormatError(
            where, "the map is empty; example of a line: thrust_N = { column = 'F', unit = 'gf' }"
        )
    entries_by_name = {}
    for name, entry in mapping.items():
        entries_by_name[name] = {"column": entry} if isinstance(entry, str) else entry
        if not isinstance(entries_by_name[name], dict):
            raise FileFormatError(
                f"[columns] {name} of {where}", "write it as { column = 'NAME', unit = 'gf' }"
            )
    column_file = build_dataclass(_ColumnsFile, {**entries, "columns": entries_by_name}, where)
    check_channels(column_file.columns, where)
    return column_file.columns


def column_map_to_toml(columns: Mapping[str, ColumnSource]) -> str:
    """Return the text of a column map file, readable by `read_column_map`."""
    import tomli_w

    def non_defaults(source: ColumnSource) -> dict[str, Any]:
        values = ((field, getattr(source, field.name)) for field in fields(source))
        return {field.name: value for field, value in values if value != field.default}

    return tomli_w.dumps(
        {"columns": {name: non_defaults(source) for name, source in columns.items()}}
    )


def column_map_to_text(columns: Mapping[str, ColumnSource]) -> str:
    """Return a column map as one line."""
    texts = []
    for name, source in columns.items():
        unit = f" [{source.unit}]" if source.unit else ""
        factor = "" if source.factor == 1.0 else f" times {source.factor:g}"
        origin = f"{source.constant:g}" if source.column is None else f"{source.column!r}"
        if source.reference:
            texts.append(f"reference rows: {source.column} = {source.reference}")
        else:
            texts.append(f"{name} = {origin}{unit}{factor}")
    return ", ".join(texts)


_USUAL_NAMES: dict[str, tuple[str, ...]] = {  # usual column names, lower case, by channel
    "time_s": ("t", "time", "zeit"),
    "thrust_N": (
        *("thrust", "total thrust", "total_thrust", "total_thrust_n"),
        *("schub", "force", "kraft", "f", "fz", "lift"),
    ),
    "torque_Nm": ("torque", "moment", "drehmoment"),
    "voltage_V": ("voltage", "spannung"),
    "current_A": ("current", "strom"),
    "power_W": ("electrical power", "power", "leistung"),
    "mechanical_power_W": ("mechanical power",),
    "efficiency_N_W": ("efficiency", "overall efficiency"),
    "propeller_efficiency_N_W": ("propeller efficiency", "propeller mech. efficiency"),
    "motor_efficiency": ("motor efficiency",),
    "rpm1": (
        *("rpm", "rotation speed", "drehzahl", "speed", "rotor speed", "motor speed"),
        *("motor optical speed", "motor electrical speed"),
    ),
    "pwm1_us": ("pwm", "throttle", "esc", "esc signal", "gas"),
    "theta_rad": ("theta",),
    "theta_ref_rad": ("theta_ref",),
    "gyro_rad_s": ("gyro",),
    "plate_z_m": (
        *("z", "plate_z", "plate z", "gap", "abstand", "dist", "distance", "plate distance"),
        *("clearance", "height"),
    ),
    "thrust_ratio": ("thrust ratio", "t_ratio", "t/t_oge", "t_ige/t_oge", "t/t0", "t/t_0", "ratio"),
    "vibration_m_s2": ("vibration",),
}
_CHANNELS = {name: channel for channel, names in _USUAL_NAMES.items() for name in names}

RADII_PER_UNIT: dict[str, float] = {  # rotor radii per unit, by column name in lower case
    **dict.fromkeys(("z_over_r", "z/r", "z_r", "h/r", "h_r", "h_over_r"), 1.0),
    **dict.fromkeys(("z_over_d", "z/d", "z_d", "h/d", "h_d", "h_over_d"), 2.0),
}

_ENDING = re.compile(r"(?P<name>.+?)[_ ](?P<unit>[A-Za-z]+)")


def name_and_unit(cell: str) -> tuple[str, str | None]:
    """Return name and unit of a column header: `Gap (mm)`, `gap_mm` and `gap [mm]` are alike."""
    head = parse_header_cell(cell)
    if head.unit is None and (match := _ENDING.fullmatch(head.name)) and is_unit(match["unit"]):
        return match["name"], match["unit"]
    return head.name, head.unit


def match_channel(name: str) -> str | None:
    """Return the channel for a column name, or None if it is ambiguous."""
    if re.fullmatch(r"pwm\d+", name):
        return f"{name}_us"
    return name if is_known_channel(name) else _CHANNELS.get(name.lower())


def match_header(cell: str) -> tuple[str | None, str | None]:
    """Return the channel for a column header, or None if it is ambiguous, and the unit in it."""
    for name, unit in (parse_header_cell(cell), name_and_unit(cell)):
        if channel := match_channel(name):
            return channel, unit
    is_speed = name.lower() == "n" and _SPELLINGS.get(unit or "", unit) in {"rpm", "rad/s", *_TURNS}
    return "rpm1" if is_speed else None, unit


def is_similar(cell: str, channel: str) -> bool:
    """Return whether a word of a column name abbreviates or extends a usual one of a channel."""
    usual = {word for name in _USUAL_NAMES[channel] for word in re.findall(r"[^\W_]{2,}", name)}
    words = re.findall(r"[^\W_]{2,}", cell.casefold())
    return any(
        word.startswith(name) or (len(word) > 2 and name.startswith(word))
        for word in words
        for name in usual
    )


def guess_columns(
    header: Sequence[str], channels: Collection[str] = (), radius_m: float | None = None
) -> dict[str, ColumnSource]:
    """Return the channels suggested by column names, with the units in the names.

    Args:
        channels: that may be suggested; any when empty.
        radius_m: of the rotor, for columns in rotor radii; None omits these columns.
    """
    sources: dict[str, ColumnSource] = {}
    in_radii: dict[str, ColumnSource] = {}
    for cell in header:
        channel, unit = match_header(cell)
        name = name_and_unit(cell)[0].lower()
        if channel is None and name in RADII_PER_UNIT and radius_m is not None:
            source = ColumnSource(column=cell, factor=RADII_PER_UNIT[name] * radius_m)
            in_radii.setdefault("plate_z_m", source)
        if channel is None or channel in sources or (channels and channel not in channels):
            continue
        own_unit = unit_from_name(channel)
        try:
            fits = unit is None or unit_in_header(unit, own_unit) is not None
        except InputError:
            continue
        in_file = None if unit == own_unit or not fits else unit
        sources[channel] = ColumnSource(column=cell, unit=in_file)
    return in_radii | sources
