"""A grid of heights, and what a rotor disc sees of it: covered fraction and mean height.

The sampling is done once for each grid and disc radius, at the grid's nodes; a flight looks the two
numbers up between nodes. Cells at or below `base_m`, and cells without a height, count as floor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError

SAMPLES = 199  # points of a disc that are looked at: areas come out within about 1 %


class DiscGrid(NamedTuple):
    """Hold what discs see, node by node; see `environment.Tables`."""

    seen: Array
    grid_x_m: float
    grid_y_m: float
    step_x_m: float
    step_y_m: float

    @classmethod
    def none(cls) -> DiscGrid:
        """Return the stand-in for no grid."""
        return cls(np.zeros((2, 2, 2)), 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class HeightGrid:
    """Hold heights over a rectangle.

    Attributes:
        x_m: places of the nodes along x (nx,), evenly spaced.
        height_m: (nx, ny); nan where there is nothing.
        base_m: heights at or below are floor and no surface of their own.
    """

    x_m: Array
    y_m: Array
    height_m: Array
    base_m: float = -np.inf

    def __post_init__(self) -> None:
        for name, places in (("x_m", self.x_m), ("y_m", self.y_m)):
            steps = np.diff(places)
            if len(places) < 2 or not np.all(steps > 0.0):
                raise InputError(f"a height grid's {name} must increase over two or more nodes")
            if np.ptp(steps) > 1e-6 * abs(places[-1] - places[0]):
                raise InputError(
                    f"a height grid's {name} must be evenly spaced, got steps from "
                    f"{steps.min():.6g} to {steps.max():.6g} m; resample it"
                )
        if self.height_m.shape != (len(self.x_m), len(self.y_m)):
            raise InputError(
                f"a height grid of {len(self.x_m)} by {len(self.y_m)} nodes has heights of shape "
                f"{self.height_m.shape}; give one height per node"
            )
        if np.isinf(self.height_m).any():
            raise InputError("a height grid holds an infinite height; leave the cell empty")

    def moved(self, x_m: float, y_m: float, z_m: float) -> HeightGrid:
        """Return the grid displaced."""
        return replace(
            self,
            x_m=self.x_m + x_m,
            y_m=self.y_m + y_m,
            height_m=self.height_m + z_m,
            base_m=self.base_m + z_m,
        )

    def refuse_uncovered(self, places_m: Array, margin_m: float, what: str) -> None:
        """Refuse places (m, 2) nearer than a margin to the grid's edge, or beyond it."""
        for axis, places in enumerate((self.x_m, self.y_m)):
            low, high = places[0] + margin_m, places[-1] - margin_m
            worst = places_m[:, axis]
            for value in (worst.min(), worst.max()):
                if not low <= value <= high:
                    raise InputError(
                        f"the map does not cover {what}: {'xy'[axis]} = {value:g} m lies outside "
                        f"{low:g} to {high:g} m (the map less {margin_m:.2g} m for the rotors); "
                        f"use a larger map or a shorter path"
                    )

    def averaged(self, radius_m: float) -> DiscGrid:
        """Return what a disc of that radius sees, at every node; worked out once and kept.

        Samples lie on a sunflower spiral of equal areas; between nodes both rise and height are
        bilinear, so an edge is blurred over one cell.
        """
        return _averaged(self, radius_m)

    def sampled(self, radius_m: float) -> DiscGrid:
        """Work out what `averaged` keeps."""
        k = np.arange(SAMPLES) + 0.5
        reach = radius_m * np.sqrt(k / SAMPLES)
        turn = np.pi * (1.0 + np.sqrt(5.0)) * k
        raised = np.isfinite(self.height_m) & (self.height_m > self.base_m)
        rise = np.where(raised, self.height_m, 0.0)
        share = np.zeros_like(rise)
        total = np.zeros_like(rise)
        x, y = np.meshgrid(self.x_m, self.y_m, indexing="ij")
        for dx, dy in zip(reach * np.cos(turn), reach * np.sin(turn), strict=True):
            share += self._between(raised.astype(float), x + dx, y + dy)
            total += self._between(rise, x + dx, y + dy)
        height = np.where(share > 0.0, total / np.maximum(share, 1e-12), 0.0)
        height = _spread(height, share > 0.0)
        step_x, step_y = self.x_m[1] - self.x_m[0], self.y_m[1] - self.y_m[0]
        return DiscGrid(
            np.array([share / SAMPLES, height]),
            float(self.x_m[0]),
            float(self.y_m[0]),
            float(step_x),
            float(step_y),
        )

    def _between(self, values: Array, x: Array, y: Array) -> Array:
        """Return values at places, bilinear; the outermost cells go on beyond the edge."""
        u = np.clip((x - self.x_m[0]) / (self.x_m[1] - self.x_m[0]), 0.0, len(self.x_m) - 1.0)
        v = np.clip((y - self.y_m[0]) / (self.y_m[1] - self.y_m[0]), 0.0, len(self.y_m) - 1.0)
        i = np.minimum(u.astype(int), len(self.x_m) - 2)
        j = np.minimum(v.astype(int), len(self.y_m) - 2)
        a, b = u - i, v - j
        found: Array = (1.0 - a) * ((1.0 - b) * values[i, j] + b * values[i, j + 1]) + a * (
            (1.0 - b) * values[i + 1, j] + b * values[i + 1, j + 1]
        )
        return found


@lru_cache(maxsize=8)
def _averaged(grid: HeightGrid, radius_m: float) -> DiscGrid:
    return grid.sampled(radius_m)


def _spread(height: Array, known: NDArray[np.bool_]) -> Array:
    """Give nodes whose disc touches nothing the height of a neighbour that does, one ring wide."""
    spread = height.copy()
    total = np.zeros_like(height)
    count = np.zeros_like(height)
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            near = np.roll(known, (i, j), (0, 1))
            total += np.where(near, np.roll(height, (i, j), (0, 1)), 0.0)
            count += near
    spread[~known] = (total / np.maximum(count, 1.0))[~known]
    return spread
