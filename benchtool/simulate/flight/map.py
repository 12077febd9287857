"""Environment files: boxes, ramps and a height grid.

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

A block can have a slope (`slope_x`, `slope_y`) and move (`times_s`, `slide_m`). The file of the
grid is a CSV with columns x_m, y_m, height_m, one row per node in any order; an empty height means
no surface.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.toml_text import FileTable, build_dataclass, parse_toml
from benchtool.core.user_file import read_text
from benchtool.data.csv_text import read_csv_text
from benchtool.simulate.flight.environment import Block, Environment
from benchtool.simulate.flight.height_grid import HeightGrid

COLUMNS = ("x_m", "y_m", "height_m")  # of a height grid file


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
        FileFormatError: the file cannot be read or is incomplete.
        UnknownChoice: unknown key.
    """
    if path.suffix.lower() == ".csv":
        return Environment(grid=read_grid(path), name=path.stem)
    where = str(path)
    map_file = build_dataclass(_MapFile, parse_toml(read_text(path), where), where)
    blocks = tuple(
        build_dataclass(Block, table, f"{where}: blocks[{index}]")
        for index, table in enumerate(map_file.blocks)
    )
    grid = None
    if map_file.grid:
        grid_table = build_dataclass(_GridTable, map_file.grid, f"{where}: grid")
        grid = read_grid(path.parent / grid_table.file, grid_table.base_m)
    name = map_file.name or path.stem
    try:
        return Environment(blocks=blocks, grid=grid, floor_m=map_file.floor_m, name=name)
    except InputError as error:
        raise FileFormatError(where, str(error)) from error


def read_grid(path: Path, base_m: float = -inf) -> HeightGrid:
    """Return the height grid of a CSV file with columns x_m, y_m, height_m."""
    table = read_csv_text(path)
    if missing := [name for name in COLUMNS if name not in table.header]:
        raise FileFormatError(
            table.where,
            f"column {missing[0]!r} is missing; a height grid needs {', '.join(COLUMNS)}",
        )
    columns = [table.header.index(name) for name in COLUMNS]
    rows = np.empty((len(table.rows), 3))
    for row, (cells, line) in enumerate(zip(table.rows, table.lines, strict=True)):
        for axis, column in enumerate(columns):
            text = cells[column].strip()
            try:
                rows[row, axis] = float(text) if text or axis < 2 else np.nan
            except ValueError:
                raise FileFormatError(
                    f"{table.where}, line {line}", f"{COLUMNS[axis]} is {text!r}; give a number"
                ) from None
    x, y = np.unique(rows[:, 0]), np.unique(rows[:, 1])
    if len(rows) != len(x) * len(y):
        raise FileFormatError(
            table.where,
            f"{len(rows)} rows do not fill a grid of {len(x)} by {len(y)} nodes; give one row "
            f"per node",
        )
    heights = np.full((len(x), len(y)), np.nan)
    heights[np.searchsorted(x, rows[:, 0]), np.searchsorted(y, rows[:, 1])] = rows[:, 2]
    try:
        return HeightGrid(x, y, heights, base_m=base_m)
    except InputError as error:
        raise FileFormatError(table.where, str(error)) from error
