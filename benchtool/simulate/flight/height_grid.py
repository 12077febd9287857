"""Height grid, and its average over a rotor disc: covered fraction and mean height.

The average is computed once per grid and disc radius at the nodes and interpolated in flight. Cells
at or below `base_m`, and cells without a height, count as floor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError

SAMPLES = 199  # sample points per disc: error of areas about 1 %


class DiscGrid(NamedTuple):
    """Averages over a disc at the nodes of a grid; see `environment.Tables`."""

    cells: Array
    grid_x_m: float
    grid_y_m: float
    step_x_m: float
    step_y_m: float


NO_GRID = DiscGrid(np.zeros((2, 2, 2)), 0.0, 0.0, 0.0, 0.0)


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
    cells = np.array([share / SAMPLES, height])
    return DiscGrid(cells, x0_m, y0_m, x1_m - x0_m, y1_m - y0_m)


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
