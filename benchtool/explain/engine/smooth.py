"""Smooth functions of what a departure may depend on, as roots of a Gaussian process."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from benchtool.core.array_type import Array

SHOWN = 1e-4  # directions below this share of the largest variance are left out
STEP = 0.01  # places are rounded to so much of the length over which the process changes


def smooth_root(places: Array, step: float = STEP) -> Array:
    """Return the root (m, r) of the covariance of a smooth process of size 1 at places (m, d)."""
    near = np.round(np.nan_to_num(places) / step) * step
    unique, rows = np.unique(near, axis=0, return_inverse=True)
    found: Array = _root(unique.tobytes(), unique.shape[1])[rows.reshape(-1)]
    return found


@lru_cache(maxsize=64)
def _root(places: bytes, width: int) -> Array:
    """Return the root (n, r) at places (n, width); the same ones come again with every design."""
    unique = np.frombuffer(places).reshape(-1, width)
    squares = np.sum((unique[:, None] - unique[None]) ** 2, axis=2)
    size, axes = np.linalg.eigh(np.exp(-0.5 * squares))
    shown = size > SHOWN * size[-1]
    root: Array = axes[:, shown] * np.sqrt(size[shown])
    return root
