"""Where named records stand in one flat block, and many arrays in one block for quick calls.

Each array that is handed to a compiled function costs some 50 ns a call, and a named tuple
microseconds: twenty of them cost more than a control tick itself. In one block with a table of
places they cost two arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.physics.expression import Slot, loop_part, numbers_of


class Layout:
    """Know where records stand: `places` for a loop, rows by name for Python.

    Args:
        places: makes a named tuple of slots, which a loop takes.
        records: an example of each, in the order in which they stand.
    """

    def __init__(self, places: Callable[..., Any], **records: Any) -> None:
        self.records = records
        first, slots = 0, {}
        for name, like in records.items():
            slots[name] = Slot(first, like)
            first += len(numbers_of(like))
        self.places, self.n_rows = places(**slots), first
        self._rows: dict[str, slice] = {}

    def rows(self, path: str) -> slice:
        """Return the rows of a record, or of a field of it, as "hinge.theta_rad"."""
        if path not in self._rows:
            record, _, field = path.partition(".")
            self._rows[path] = rows_in(getattr(self.places, record), field)
        return self._rows[path]

    def column(self, **records: Any) -> Array:
        """Return one lane's block (n_rows,) with these records; as at the beginning elsewhere."""
        return np.array(numbers_of(tuple({**self.records, **records}.values())), float)


def rows_in(slot: Slot, path: str) -> slice:
    """Return the rows of a field of a slot's record, as "setpoint.plate_z_m"; of all of it, ""."""
    first, like = slot
    for name in filter(None, path.split(".")):
        k = like._fields.index(name)
        first, like = first + len(numbers_of(like[:k])), like[k]
    return slice(first, first + len(numbers_of(like)))


def zeroed(record: Any) -> Any:
    """Return a record of the same type with zeros for numbers."""
    if not isinstance(record, tuple):
        return 0.0
    parts = [zeroed(part) for part in record]
    return type(record)(*parts) if hasattr(record, "_fields") else tuple(parts)


WIDTH_BYTES = 8
"""Of an element of the block; arrays of floats and of 64-bit integers fit."""


def in_one_block(
    arrays: Sequence[NDArray[Any]],
) -> tuple[NDArray[np.float64], NDArray[np.int64], list[NDArray[Any]]]:
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
    views: list[NDArray[Any]] = []
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
