"""Where named records stand in one flat block, and where arrays stand for quick calls.

Each array that is handed to a compiled function costs some 50 ns a call, and a named tuple
microseconds: twenty of them cost more than a control tick itself. A table of their addresses costs
one array.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.physics.expression import Slot, flat_values


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
            first += len(flat_values(like))
        self.places, self.n_rows = places(**slots), first
        self._rows: dict[str, slice] = {}

    def rows(self, path: str) -> slice:
        """Return the rows of a record, or of a field of it, as "hinge.theta_rad"."""
        if path not in self._rows:
            record, _, field = path.partition(".")
            self._rows[path] = rows_in(getattr(self.places, record), field)
        return self._rows[path]

    def row_numbers(self, fields: Iterable[str]) -> NDArray[np.int64]:
        """Return the rows of fields in turn; of `nothing` for what a law's state has no field."""
        found: list[int] = []
        for field in fields:
            try:
                rows = self.rows(field)
            except (ValueError, AttributeError):
                if not field.startswith("law_state."):
                    raise
                rows = self.rows("nothing")
            found += range(self.n_rows)[rows]
        return np.array(found, np.int64)

    def column(self, **records: Any) -> Array:
        """Return one lane's block (n_rows,) with these records; as at the beginning elsewhere."""
        return np.array(flat_values(tuple({**self.records, **records}.values())), float)


def rows_in(slot: Slot, path: str) -> slice:
    """Return the rows of a field of a slot's record, as "setpoint.plate_z_m"; of all of it, ""."""
    first, like = slot
    for name in filter(None, path.split(".")):
        k = like._fields.index(name)
        first, like = first + len(flat_values(like[:k])), like[k]
    return slice(first, first + len(flat_values(like)))


@lru_cache(maxsize=256)
def allocate(record: Any) -> Any:
    """Return a record of the same type with zeros for numbers."""
    if not isinstance(record, tuple):
        return 0.0
    parts = [allocate(part) for part in record]
    return type(record)(*parts) if hasattr(record, "_fields") else tuple(parts)


LINE, PLANE, SOLID, COUNTS = (0.0,), ((0.0,),), (((0.0,),),), (0,)  # float arrays, and integers


def lend_rows(loop: Callable[..., Any], arrays: Any) -> Any:
    """Return what a loop takes for a record of arrays, see `borrowed`; keep them while it may run.

    Args:
        loop: from `compiled_closure`; one that is not compiled takes the record itself.
        arrays: a named tuple whose defaults are the arrays' forms.
    """
    if not hasattr(loop, "py_func"):
        return arrays
    given = list(record_leaves(arrays))
    for array, (dtype, axes) in zip(given, _forms(arrays.__class__), strict=True):
        if (array.dtype, array.ndim, array.flags.c_contiguous) != (dtype, axes, True):
            raise TypeError(f"a loop takes a block of {dtype} with {axes} axes, got {array!r}")
    return np.array(
        [(array.ctypes.data, *array.shape, *(1,) * (3 - array.ndim)) for array in given], np.int64
    )


def record_leaves(record: Any) -> Iterator[Any]:
    """Yield the fields of a record that are no records themselves, in order."""
    for part in record:
        if hasattr(part, "_fields"):
            yield from record_leaves(part)
        else:
            yield part


@cache
def _forms(kind: Callable[[], Any]) -> list[tuple[np.dtype[Any], int]]:
    return [(np.asarray(form).dtype, np.ndim(form)) for form in record_leaves(kind())]
