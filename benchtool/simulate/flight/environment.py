"""Environment of a flight: boxes, ramps, moving plates, and a height grid.

A block is a rectangle in plan with a flat or sloping top and vertical sides. Blocks with a common
plane form one surface. A height grid is one more surface, and the floor is the last. The thrust
increments of all surfaces are summed (`flight.ground`).
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import inf, isfinite

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.toml_text import FileTable
from benchtool.core.units import Array
from benchtool.physics.expression import Slot
from benchtool.simulate.flight.height_grid import DiscGrid, HeightGrid
from benchtool.simulate.layout import LINE, PLANE, SOLID

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

    def row(self, surface: int) -> BlockRow:
        """Return the column of `Tables.blocks`."""
        return BlockRow(
            *self.x_m, *self.y_m, self.top_m, self.slope_x, self.slope_y,
            *self.times_s, *self.slide_m, surface,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Environment:
    """Environment of a flight.

    Attributes:
        floor_m: height of the floor; -inf means no floor.
    """

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

    def check_coverage(self, path_m: Array, margin_m: float, label: str) -> None:
        """Raise if a path (m, 2) leaves the height grid."""
        if self.grid is not None:
            self.grid.check_coverage(path_m, margin_m, label)

    def tables(self, radius_m: float) -> Tables:
        """Return the tables for the compiled loop, for a disc radius."""
        planes = list(dict.fromkeys(block.plane for block in self.blocks))
        rows = [block.row(planes.index(block.plane)) for block in self.blocks]
        blocks = np.array(rows, float).reshape(len(rows), len(BlockRow._fields)).T.copy()
        grid = DiscGrid.none() if self.grid is None else self.grid.averaged(radius_m)
        cells, *grid_numbers = grid
        return Tables(blocks, cells, np.array([*grid_numbers, self.floor_m, len(planes)], float))


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

Tables = namedtuple("Tables", "blocks cells numbers", defaults=(PLANE, SOLID, LINE))
"""Environment in the compiled loop.

Attributes:
    blocks: (n_numbers, b), a `BlockRow` per column.
    cells: (2, nx, ny) of a disc centred on a node of the grid: fraction over raised cells, and the
        mean height of these.
"""


def _overlap(a: Sequence[float], b: Sequence[float]) -> bool:
    return min(a[1], b[1]) - max(a[0], b[0]) > 1e-9
