"""Read any CSV through a map of columns in TOML: our channel = their column, unit, sign, factor."""

from __future__ import annotations

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
from benchtool.data.formats.text_table import TextTable, lay_out
from benchtool.data.repairs.foreign_units import Conversion, conversion
from benchtool.data.repairs.imported import Finding, Imported, Options
from benchtool.data.repairs.mapped import MappedColumn, read_columns


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
