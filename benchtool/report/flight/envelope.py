"""Thin a long signal for drawing without losing its spikes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def envelope(time_s: Array, values: Array, slots: int = 900) -> tuple[Array, Array]:
    """Return times and values with the smallest and the largest of every slot, nan left out.

    Args:
        time_s: (n,) s.
        values: (n,) the signal; nan where it had no new value.
        slots: how many stretches of equal sample count are kept, two samples of each.
    """
    present = np.isfinite(values) & np.isfinite(time_s)
    time_s, values = time_s[present], values[present]
    if values.size <= 2 * slots:
        return time_s, values
    edges = np.linspace(0, values.size, slots + 1).astype(int)
    kept: set[int] = {0, values.size - 1}
    for start, end in pairwise(edges):
        stretch = values[start:end]
        kept.update((start + int(stretch.argmin()), start + int(stretch.argmax())))
    index = np.array(sorted(kept))
    return time_s[index], values[index]
