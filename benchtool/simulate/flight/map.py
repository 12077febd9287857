"""Environments as files: boxes, ramps and a height grid.

    name = "shelf"
    floor_m = -0.6

    [[blocks]]
    name = "box"
    x_m = [3.0, 5.0]
    y_m = [-1.0, 1.0]
    top_m = 0.0

    [grid]
    file = "heights.csv"
    base_m = -0.5

A block may slope (`slope_x`, `slope_y`), and come and go (`times_s`, `slide_m`). The grid's file is
a CSV with columns x_m, y_m, height_m, one row per node in any order; an empty height is nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.parsed_text import parse_toml
from benchtool.core.toml_text import FileTable, build_dataclass
from benchtool.core.user_file import read_text
from benchtool.data.csv_text import read_csv_text
from benchtool.simulate.flight.environment import Block, Environment
from benchtool.simulate.flight.height_grid import HeightGrid

COLUMNS = ("x_m", "y_m", "height_m")  # columns of a height grid's file


@dataclass(frozen=True, slots=True, kw_only=True)
class _GridTable(FileTable):
    file: str
    base_m: float = -inf


@dataclass(frozen=True, slots=True, kw_only=True)
class _MapFile(FileTable):
    name: str = ""
    floor_m: float = -inf
    blocks: tuple[Mapping[str, Any], ...] = ()
    grid: Mapping[str, Any] = field(default_factory=dict)


def read_map(path: Path) -> Environment:
    """Return the environment of a TOML file, or the height grid of a CSV file.

    Raises:
        FileFormatError: a file that cannot be read, or does not say what it must.
        UnknownChoice: a key that a map has not.
    """
    if path.suffix.lower() == ".csv":
        return Environment(grid=read_grid(path), name=path.stem)
    where = str(path)
    read = build_dataclass(_MapFile, parse_toml(read_text(path), where), where)
    blocks = tuple(
        build_dataclass(Block, table, f"{where}: blocks[{k}]")
        for k, table in enumerate(read.blocks)
    )
    grid = None
    if read.grid:
        said = build_dataclass(_GridTable, read.grid, f"{where}: grid")
        grid = read_grid(path.parent / said.file, said.base_m)
    name = read.name or path.stem
    try:
        return Environment(blocks=blocks, grid=grid, floor_m=read.floor_m, name=name)
    except InputError as error:
        raise FileFormatError(where, str(error)) from error


def read_grid(path: Path, base_m: float = -inf) -> HeightGrid:
    """Return the height grid of a CSV file with columns x_m, y_m, height_m."""
    table = read_csv_text(path)
    if missing := [name for name in COLUMNS if name not in table.header]:
        raise FileFormatError(
            table.where,
            f"it has no column {missing[0]!r}; a height grid needs {', '.join(COLUMNS)}",
        )
    at = [table.header.index(name) for name in COLUMNS]
    rows = np.empty((len(table.rows), 3))
    for number, (cells, line) in enumerate(zip(table.rows, table.lines, strict=True)):
        for place, column in enumerate(at):
            text = cells[column].strip()
            try:
                rows[number, place] = float(text) if text or place < 2 else np.nan
            except ValueError:
                raise FileFormatError(
                    f"{table.where}, line {line}", f"{COLUMNS[place]} is {text!r}; give a number"
                ) from None
    x, y = np.unique(rows[:, 0]), np.unique(rows[:, 1])
    if len(rows) != len(x) * len(y):
        raise FileFormatError(
            table.where,
            f"{len(rows)} rows do not fill a grid of {len(x)} by {len(y)} places; give one row "
            f"for every node",
        )
    heights = np.full((len(x), len(y)), np.nan)
    heights[np.searchsorted(x, rows[:, 0]), np.searchsorted(y, rows[:, 1])] = rows[:, 2]
    try:
        return HeightGrid(x, y, heights, base_m=base_m)
    except InputError as error:
        raise FileFormatError(table.where, str(error)) from error
