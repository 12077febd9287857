"""Read a CSV that no format recognizes: by a map of columns, or by the names of its columns."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchtool.core.channel import require_known_channel, unit_told_by
from benchtool.core.column_source import ColumnSource
from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.core.parsed_text import parse_toml
from benchtool.core.toml_text import build
from benchtool.core.units import UNITS
from benchtool.core.user_file import read_text
from benchtool.data.csv_text import TextTable, lay_out
from benchtool.data.repairs.foreign_units import Conversion, conversion
from benchtool.data.repairs.imported import Finding, Imported, Options
from benchtool.data.repairs.mapped import MappedColumn, map_header, read_columns


def read_by_map(
    data: bytes, where: str, provenance: Mapping[str, str], options: Options
) -> Imported:
    """Return the columns of a CSV file that the user's map names."""
    map_path = options.columns
    assert map_path is not None
    table = lay_out(data, where)
    columns = [_mapped(table, name, entry, map_path) for name, entry in _entries(map_path).items()]
    used = {column.position for column in columns}
    rest = [head for at, head in enumerate(table.header) if head and at not in used]
    findings = []
    if rest:
        words = f"the map does not name {', '.join(rest)}"
        findings.append(Finding("left out", "columns", words, count=len(rest)))
    return read_columns(
        table, columns, "column map", {**provenance, "columns": str(map_path)}, findings
    )


def _entries(path: Path) -> Mapping[str, Any]:
    data = parse_toml(read_text(path), str(path))
    entries = data.get("columns", data)
    if not isinstance(entries, dict) or not entries:
        raise FileFormatError(
            str(path), "it maps nothing; write lines as thrust_N = { column = 'F', unit = 'gf' }"
        )
    return entries


def _mapped(table: TextTable, name: str, entry: Any, path: Path) -> MappedColumn:
    where = f"[columns] {name} of {path}"
    try:
        require_known_channel(name)
    except InputError as error:
        raise FileFormatError(f"[columns] of {path}", str(error)) from error
    if isinstance(entry, str):
        entry = {"column": entry}
    if not isinstance(entry, dict):
        raise FileFormatError(where, "write it as { column = 'their name', unit = 'gf' }")
    ours = unit_told_by(name)
    theirs = entry.get("unit", ours)
    if not isinstance(theirs, str):
        raise FileFormatError(where, f"unit is {theirs!r}, but a text is needed")
    # ColumnSource knows our own units only; the others are pint's.
    known = {key: item for key, item in entry.items() if key != "unit" or theirs in UNITS}
    source = build(ColumnSource, known, where)
    try:
        scale = conversion(theirs, ours)
    except InputError as error:
        raise FileFormatError(where, str(error)) from error
    scale = Conversion(scale.factor * source.sign * source.factor, scale.offset)
    if source.column is None:
        assert source.constant is not None
        value = scale.factor * source.constant + scale.offset
        words = f"constant {source.constant:g} {theirs}"
        return MappedColumn(name=name, position=None, constant=value, source=words)
    position = _position(table, source.column.strip())
    factor = source.sign * source.factor
    by = "" if factor == 1.0 else f" times {factor:g}"
    return MappedColumn(
        name=name, position=position, conversion=scale, source=f"{source.column} [{theirs}]{by}"
    )


def _position(table: TextTable, column: str) -> int:
    many = table.header.count(column)
    if many > 1:
        raise FileFormatError(
            table.where, f"column {column!r} stands {many} times in the header; rename all but one"
        )
    if not many:
        raise UnknownChoice(f"column of {table.where}", column, filter(None, table.header))
    return table.header.index(column)


NAMES: dict[str, str] = {
    "t": "time_s",
    "time": "time_s",
    "thrust": "thrust_N",
    "torque": "torque_Nm",
    "voltage": "voltage_V",
    "current": "current_A",
    "electrical power": "power_W",
    "mechanical power": "mechanical_power_W",
    "rpm": "rpm1",
    "rotation speed": "rpm1",
    "pwm": "pwm1_us",
    "throttle": "pwm1_us",
    "theta": "theta_rad",
    "theta_ref": "theta_ref_rad",
    "gyro": "gyro_rad_s",
    "plate_z": "plate_z_m",
    "vibration": "vibration_m_s2",
}
"""Names that people give to columns, in small letters, and the channel that they mean."""


def channel_meant(name: str) -> str | None:
    """Return the channel that a column's name means; None where nobody can know."""
    if re.fullmatch(r"pwm\d+", name):
        return f"{name}_us"
    try:
        require_known_channel(name)
    except UnknownChoice:
        return NAMES.get(name.lower())
    return name


def read_named(
    data: bytes, where: str, provenance: Mapping[str, str], options: Options
) -> Imported:
    """Return the columns of a CSV whose names and units are understood.

    A column that names no unit is taken in ours, and a doubt says so.
    """
    table = lay_out(data, where)
    hint = "; --columns MAP.toml says what they are"
    columns, findings = map_header(table, channel_meant, hint=hint)
    if not columns:
        unknown = ", ".join(list(filter(None, table.header))[:12])
        raise FileFormatError(
            where,
            f"none of its columns is known ({unknown}); say which is which with --columns MAP.toml",
        )
    return read_columns(table, columns, "named columns", provenance, findings)
