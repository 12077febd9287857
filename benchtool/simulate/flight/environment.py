"""Environment of a flight: boxes, ramps, moving plates, and a height grid.

A block is a rectangle in plan with a flat or sloping top and vertical sides. Blocks with a common
plane form one surface. A height grid is one more surface, and the floor is the last. The thrust
increments of all surfaces are summed (`flight.ground`). In a file:

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
no surface. A grid is averaged over a disc once at its nodes and interpolated in flight; cells at or
below its base, and cells without a height, count as floor.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import combinations
from math import inf, isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.toml_text import FileTable, build_dataclass, parse_toml
from benchtool.core.units import Array
from benchtool.core.user_file import read_text
from benchtool.data.csv_text import read_csv_text
from benchtool.physics.expression import Slot
from benchtool.simulate.layout import LINE, PLANE, SOLID

COLUMNS = ("x_m", "y_m", "height_m")  # of a height grid file
SAMPLES = 199  # sample points per disc: error of areas about 1 %
ALWAYS = (-1e9, -1e9, 1e9, 1e9)  # s: insertion start and end, removal start and end


@dataclass(frozen=True, slots=True, kw_only=True)
class Block(FileTable):
    """Obstacle.

    Attributes:
        x_m, y_m: extent in plan, lower and upper; may be infinite.
        top_m: height of the top, for a slope at the lower corner (x, y).
        slope_x, slope_y: rise of the top per metre along x and y; 0 is a box.
        times_s: of a moving plate: start and end of its insertion, then of its removal.
        slide_m: displacement along x and y before the insertion and after the removal.
    """

    x_m: tuple[float, float]
    y_m: tuple[float, float] = (-inf, inf)
    top_m: float = 0.0
    slope_x: float = 0.0
    slope_y: float = 0.0
    times_s: tuple[float, float, float, float] = ALWAYS
    slide_m: tuple[float, float] = (0.0, 0.0)
    name: str = "box"

    def __post_init__(self) -> None:
        for axis, (low, high) in (("x_m", self.x_m), ("y_m", self.y_m)):
            if not low < high:
                raise InputError(
                    f"{self.name}: {axis} is {low:g} to {high:g} m; give the lower end first"
                )
        for axis, slope, ends in (("x", self.slope_x, self.x_m), ("y", self.slope_y, self.y_m)):
            if slope and not all(map(isfinite, ends)):
                raise InputError(f"{self.name}: a slope along {axis} needs finite ends")
            if not abs(slope) <= 2.0:
                raise InputError(f"{self.name}: slope_{axis} is {slope:g}; maximum: 2 (63 deg)")
        if not isfinite(self.top_m):
            raise InputError(f"{self.name}: top_m is {self.top_m:g}; allowed: finite heights")
        if not all(map(isfinite, (*self.times_s, *self.slide_m))):
            raise InputError(
                f"{self.name}: times_s {self.times_s} and slide_m {self.slide_m} must be finite"
            )
        if list(self.times_s) != sorted(self.times_s):
            raise InputError(f"{self.name}: times_s {self.times_s} do not increase; sort them")

    @property
    def plane(self) -> tuple[float, float, float]:
        """Height at the origin and slopes; blocks with the same plane form one surface."""
        x = self.x_m[0] if self.slope_x else 0.0
        y = self.y_m[0] if self.slope_y else 0.0
        at_origin = self.top_m - self.slope_x * x - self.slope_y * y
        return (round(at_origin, 9), self.slope_x, self.slope_y)


# Averages over a disc at the nodes of a grid: cells, first node and steps, as in `Tables`.
DiscGrid = tuple[Array, float, float, float, float]

NO_GRID: DiscGrid = (np.zeros((2, 2, 2)), 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class HeightGrid:
    """Heights on a rectangular grid.

    Attributes:
        x_m: positions of the nodes along x (nx,), evenly spaced.
        height_m: (nx, ny); nan where there is no surface.
        base_m: heights up to this count as floor.
    """

    x_m: Array
    y_m: Array
    height_m: Array
    base_m: float = -np.inf

    def __post_init__(self) -> None:
        for name, nodes in (("x_m", self.x_m), ("y_m", self.y_m)):
            steps = np.diff(nodes)
            if len(nodes) < 2 or not np.all(steps > 0.0):
                raise InputError(f"{name} of the height grid must increase; minimum: two nodes")
            if np.ptp(steps) > 1e-6 * abs(nodes[-1] - nodes[0]):
                raise InputError(
                    f"{name} of the height grid must be evenly spaced, steps are "
                    f"{steps.min():.6g} to {steps.max():.6g} m; resample it"
                )
        if self.height_m.shape != (len(self.x_m), len(self.y_m)):
            raise InputError(
                f"a height grid of {len(self.x_m)} by {len(self.y_m)} nodes has heights of shape "
                f"{self.height_m.shape}; give one height per node"
            )
        if np.isinf(self.height_m).any():
            raise InputError("the height grid contains an infinite height; leave the cell empty")

    def moved(self, x_m: float, y_m: float, z_m: float) -> HeightGrid:
        """Return the grid displaced."""
        return replace(
            self,
            x_m=self.x_m + x_m,
            y_m=self.y_m + y_m,
            height_m=self.height_m + z_m,
            base_m=self.base_m + z_m,
        )

    def check_coverage(self, path_m: Array, margin_m: float, label: str) -> None:
        """Raise if a path (m, 2) comes nearer than a margin to the edge of the grid."""
        for axis, nodes in enumerate((self.x_m, self.y_m)):
            low, high = nodes[0] + margin_m, nodes[-1] - margin_m
            coordinate = path_m[:, axis]
            for value in (coordinate.min(), coordinate.max()):
                if not low <= value <= high:
                    raise InputError(
                        f"the map does not cover {label}: {'xy'[axis]} is {value:g} m; allowed: "
                        f"{low:g} to {high:g} m (map minus {margin_m:.2g} m for the rotors); "
                        f"use a larger map or a shorter path"
                    )

    def interpolate(self, values: Array, x: Array, y: Array) -> Array:
        """Return values at positions, bilinear; constant beyond the edge."""
        u = np.clip((x - self.x_m[0]) / (self.x_m[1] - self.x_m[0]), 0.0, len(self.x_m) - 1.0)
        v = np.clip((y - self.y_m[0]) / (self.y_m[1] - self.y_m[0]), 0.0, len(self.y_m) - 1.0)
        i = np.minimum(u.astype(int), len(self.x_m) - 2)
        j = np.minimum(v.astype(int), len(self.y_m) - 2)
        a, b = u - i, v - j
        interpolated: Array = (1.0 - a) * ((1.0 - b) * values[i, j] + b * values[i, j + 1]) + a * (
            (1.0 - b) * values[i + 1, j] + b * values[i + 1, j + 1]
        )
        return interpolated


@lru_cache(maxsize=8)
def average_grid(grid: HeightGrid, radius_m: float) -> DiscGrid:
    """Return the averages over a disc of that radius at every node (cached).

    Samples are on a sunflower spiral of equal areas; between nodes both fraction and height are
    bilinear, so an edge is blurred over one cell.
    """
    k = np.arange(SAMPLES) + 0.5
    radius = radius_m * np.sqrt(k / SAMPLES)
    angle = np.pi * (1.0 + np.sqrt(5.0)) * k
    is_raised = np.isfinite(grid.height_m) & (grid.height_m > grid.base_m)
    raised_m = np.where(is_raised, grid.height_m, 0.0)
    share, total = np.zeros_like(raised_m), np.zeros_like(raised_m)
    x, y = np.meshgrid(grid.x_m, grid.y_m, indexing="ij")
    for dx, dy in zip(radius * np.cos(angle), radius * np.sin(angle), strict=True):
        share += grid.interpolate(is_raised.astype(float), x + dx, y + dy)
        total += grid.interpolate(raised_m, x + dx, y + dy)
    height = np.where(share > 0.0, total / np.maximum(share, 1e-12), 0.0)
    height = _extend_by_one(height, share > 0.0)
    x0_m, x1_m, y0_m, y1_m = map(float, (*grid.x_m[:2], *grid.y_m[:2]))
    return np.array([share / SAMPLES, height]), x0_m, y0_m, x1_m - x0_m, y1_m - y0_m


def _extend_by_one(height: Array, is_covered: NDArray[np.bool_]) -> Array:
    """Return heights in which nodes without coverage get the mean of their covered neighbours."""
    extended = height.copy()
    total = np.zeros_like(height)
    count = np.zeros_like(height)
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            near = np.roll(is_covered, (i, j), (0, 1))
            total += np.where(near, np.roll(height, (i, j), (0, 1)), 0.0)
            count += near
    extended[~is_covered] = (total / np.maximum(count, 1.0))[~is_covered]
    return extended


@dataclass(frozen=True, slots=True, kw_only=True)
class Environment:
    """Environment of a flight; a floor at -inf means no floor."""

    blocks: tuple[Block, ...] = ()
    grid: HeightGrid | None = None
    floor_m: float = -inf
    name: str = "free air"

    def __post_init__(self) -> None:
        if not self.floor_m < inf:
            raise InputError(f"floor_m is {self.floor_m:g}; allowed: finite, or -inf for no floor")
        for a, b in combinations(self.blocks, 2):
            if _overlap(a.x_m, b.x_m) and _overlap(a.y_m, b.y_m):
                raise InputError(f"blocks {a.name!r} and {b.name!r} overlap in plan; shorten one")
        for block in self.blocks:
            if block.top_m <= self.floor_m:
                raise InputError(
                    f"{block.name}: top_m {block.top_m:g} is not above the floor at "
                    f"{self.floor_m:g} m; raise one or lower the other"
                )

    def moved(self, x_m: float = 0.0, y_m: float = 0.0, z_m: float = 0.0) -> Environment:
        """Return the environment displaced, such as a map with an error."""
        return replace(
            self,
            blocks=tuple(
                replace(
                    block,
                    x_m=(block.x_m[0] + x_m, block.x_m[1] + x_m),
                    y_m=(block.y_m[0] + y_m, block.y_m[1] + y_m),
                    top_m=block.top_m + z_m,
                )
                for block in self.blocks
            ),
            grid=None if self.grid is None else self.grid.moved(x_m, y_m, z_m),
            floor_m=self.floor_m + z_m,
        )

    def tables(self, radius_m: float) -> Tables:
        """Return the tables for the compiled loop, for a disc radius."""
        planes = list(dict.fromkeys(block.plane for block in self.blocks))
        rows = [
            BlockRow(
                *block.x_m, *block.y_m, block.top_m, block.slope_x, block.slope_y, *block.times_s,
                *block.slide_m, planes.index(block.plane),
            )
            for block in self.blocks
        ]  # fmt: skip
        blocks = np.array(rows, float).reshape(len(rows), len(BlockRow._fields)).T.copy()
        cells, *grid = NO_GRID if self.grid is None else average_grid(self.grid, radius_m)
        return Tables(blocks, cells, np.array([*grid, self.floor_m, len(planes)], float))


BlockRow = namedtuple(  # a `Block` in the compiled loop, with the number of its surface
    "BlockRow",
    "x1_m x2_m y1_m y2_m top_m slope_x slope_y insert_start_s insert_end_s remove_start_s "
    "remove_end_s slide_x_m slide_y_m surface",
    defaults=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)
BLOCK = Slot(0, BlockRow())  # one column of `Tables.blocks`

# First node and steps of a grid (m; 0 without grid), height of the floor (m, -inf without), and
# number of surfaces of the blocks.
MapNumbers = namedtuple(
    "MapNumbers",
    "grid_x_m grid_y_m step_x_m step_y_m floor_m n_planes",
    defaults=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)

MAP = Slot(0, MapNumbers())  # `Tables.numbers`


class Tables(NamedTuple):
    """Environment in the compiled loop.

    Attributes:
        blocks: (n_numbers, b), a `BlockRow` per column.
        cells: (2, nx, ny) of a disc centred on a node of the grid: fraction over raised cells, and
            the mean height of these.
    """

    blocks: Array = PLANE
    cells: Array = SOLID
    numbers: Array = LINE


def _overlap(a: Sequence[float], b: Sequence[float]) -> bool:
    return min(a[1], b[1]) - max(a[0], b[0]) > 1e-9


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
    """Return the environment of a TOML file, or the height grid of a CSV file."""
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
