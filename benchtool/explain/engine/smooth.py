"""Roots of Gaussian process covariances, for smooth discrepancies."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from benchtool.core.units import Array

MIN_EIGENVALUE = 1e-4  # of the largest eigenvalue; smaller eigenvalues are dropped
STEP = 0.01  # rounding of points, in correlation lengths


def smooth_root(points: Array, step: float = STEP) -> Array:
    """Return the root (m, r) of the covariance of a unit Gaussian process at points (m, d)."""
    rounded = np.round(np.nan_to_num(points) / step) * step
    unique, rows = np.unique(rounded, axis=0, return_inverse=True)
    result: Array = _root(unique.tobytes(), unique.shape[1])[rows.reshape(-1)]
    return result


@lru_cache(maxsize=64)
def _root(points: bytes, width: int) -> Array:
    """Return the root (n, r) at points (n, width), cached: designs repeat them."""
    unique = np.frombuffer(points).reshape(-1, width)
    squares = np.sum((unique[:, None] - unique[None]) ** 2, axis=2)
    size, axes = np.linalg.eigh(np.exp(-0.5 * squares))
    is_kept = size > MIN_EIGENVALUE * size[-1]
    root: Array = axes[:, is_kept] * np.sqrt(size[is_kept])
    return root
