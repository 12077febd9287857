"""Layout of named records in one flat block, and table of array addresses for fast calls.

Each array argument of a compiled function costs about 50 ns per call, a named tuple microseconds:
twenty of them cost more than a control tick. A table of their addresses costs one array.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.physics.expression import Slot, flat_values


class Layout:
    """Layout of records in order: `slots` for a loop, rows by name for Python.

    Args:
        key: equal for records of the same types.
        examples: a record of zeros for each name, from `zero_record`.
    """

    def __init__(self, key: str, examples: Mapping[str, Any]) -> None:
        self.key = key
        first, slots = 0, []
        for like in examples.values():
            slots.append(Slot(first, like))
            first += len(flat_values(like))
        self.slots, self.n_rows = _slots_type(" ".join(examples))(*slots), first
        self._rows: dict[str, slice] = {}
        self._row_numbers: dict[tuple[str, ...], NDArray[np.int64]] = {}

    def rows(self, path: str) -> slice:
        """Return the rows of a record or of one of its fields, for example "hinge.theta_rad"."""
        if path not in self._rows:
            record, _, field = path.partition(".")
            self._rows[path] = rows_in(getattr(self.slots, record), field)
        return self._rows[path]

    def row_numbers(self, fields: Iterable[str]) -> NDArray[np.int64]:
        """Return the rows of fields; those of `nothing` for missing fields of a law's state."""
        names = tuple(fields)
        if names not in self._row_numbers:
            numbers: list[int] = []
            for field in names:
                try:
                    rows = self.rows(field)
                except (ValueError, AttributeError):
                    if not field.startswith("law_state."):
                        raise
                    rows = self.rows("nothing")
                numbers += range(self.n_rows)[rows]
            self._row_numbers[names] = np.array(numbers, np.int64)
        return self._row_numbers[names]


_LAYOUTS: dict[str, Layout] = {}  # by key: a layout costs a third of a millisecond


def record_layout(**records: Any) -> Layout:
    """Return the layout of records; only their types matter."""
    key = "; ".join(f"{name} {_type_key(record)}" for name, record in records.items())
    if key not in _LAYOUTS:
        examples = {name: zero_record(record) for name, record in records.items()}
        _LAYOUTS[key] = Layout(key, examples)
    return _LAYOUTS[key]


@lru_cache(maxsize=256, typed=True)
def _type_key(record: Any) -> str:
    """Return a text that is equal for records of the same types (cached)."""
    return repr(zero_record(record))


@cache
def _slots_type(names: str) -> Any:
    """Return the named tuple of the slots of records."""
    return namedtuple("Slots", names)


def rows_in(slot: Slot, path: str) -> slice:
    """Return the rows of a field of a slot, such as "setpoint.plate_z_m"; all rows for ""."""
    first, like = slot
    for name in filter(None, path.split(".")):
        k = like._fields.index(name)
        first, like = first + len(flat_values(like[:k])), like[k]
    return slice(first, first + len(flat_values(like)))


def zero_record(record: Any) -> Any:
    """Return a record of the same type with zeros for numbers."""
    if not isinstance(record, tuple):
        return 0.0
    parts: list[Any] = [zero_record(part) if isinstance(part, tuple) else 0.0 for part in record]
    return type(record)(*parts) if hasattr(record, "_fields") else tuple(parts)


# Array types, as defaults of records of arrays: floats with 1, 2 and 3 axes, and integers.
ARRAY_TYPES: Any = ((0.0,), ((0.0,),), (((0.0,),),), (0,))
LINE, PLANE, SOLID, COUNTS = ARRAY_TYPES


def lend_rows(loop: Callable[..., Any], arrays: Any) -> Any:
    """Return the table of array addresses for a loop, see `shared_view`; keep the arrays alive.

    Args:
        loop: from `compiled_closure`; for an uncompiled loop the record itself is returned.
        arrays: a named tuple whose defaults are the array types.
    """
    if not hasattr(loop, "py_func"):
        return arrays
    leaves = list(record_leaves(arrays))
    for array, (dtype, axes) in zip(leaves, _array_types(arrays.__class__), strict=True):
        if (array.dtype, array.ndim, array.flags.c_contiguous) != (dtype, axes, True):
            raise TypeError(f"a loop needs an array of {dtype} with {axes} axes, got {array!r}")
    return np.array(
        [(array.ctypes.data, *array.shape, *(1,) * (3 - array.ndim)) for array in leaves], np.int64
    )


def record_leaves(record: Any) -> Iterator[Any]:
    """Yield the leaf fields of a nested record, in order."""
    for part in record:
        if hasattr(part, "_fields"):
            yield from record_leaves(part)
        else:
            yield part


@cache
def _array_types(record_type: Callable[[], Any]) -> list[tuple[np.dtype[Any], int]]:
    return [(np.asarray(leaf).dtype, np.ndim(leaf)) for leaf in record_leaves(record_type())]
