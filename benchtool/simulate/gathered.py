"""Many arrays in one block: what a compiled loop takes that is called for every control tick.

Each array that is handed over costs some 50 ns a call, and a named tuple microseconds: twenty of
them cost more than the tick itself. In one block with a table of places they cost two arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.physics.expression import loop_part

Array = NDArray[Any]

WIDTH_BYTES = 8
"""Of an element of the block; arrays of floats and of 64-bit integers fit."""


def gathered(arrays: Sequence[Array]) -> tuple[NDArray[np.float64], NDArray[np.int64], list[Array]]:
    """Return one block that holds copies of the arrays, where each stands, and views into it.

    Args:
        arrays: of 8-byte elements, with one to three axes.

    Returns:
        block (total,); places (n_arrays, 5): begin, end, lengths of three axes; views like
        `arrays`.
    """
    ends = np.cumsum([array.size for array in arrays])
    block = np.empty(int(ends[-1]))
    places = np.ones((len(arrays), 5), np.int64)
    views: list[Array] = []
    for k, array in enumerate(arrays):
        assert array.dtype.itemsize == WIDTH_BYTES
        begin, end = int(ends[k]) - array.size, int(ends[k])
        view = block[begin:end].view(array.dtype).reshape(array.shape)
        view[...] = array
        places[k, :2] = begin, end
        places[k, 2 : 2 + array.ndim] = array.shape
        views.append(view)
    return block, places, views


@loop_part
def line(block: Any, places: Any, k: int) -> Any:
    """Return array k with one axis."""
    return block[places[k, 0] : places[k, 1]]


@loop_part
def plane(block: Any, places: Any, k: int) -> Any:
    """Return array k with two axes."""
    return block[places[k, 0] : places[k, 1]].reshape((places[k, 2], places[k, 3]))


@loop_part
def solid(block: Any, places: Any, k: int) -> Any:
    """Return array k with three axes."""
    return block[places[k, 0] : places[k, 1]].reshape((places[k, 2], places[k, 3], places[k, 4]))
