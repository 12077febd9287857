"""Branch-free functions from one source, for NumPy and for compiled loops (numba).

The decorator `@expression` returns the function unchanged: in Python it works on scalars, arrays
and complex steps with NumPy. It only registers the function, so that `compile_expressions` can make
the same source callable from compiled loops if numba is installed.

Allowed in an expression: arithmetic, NumPy's elementwise functions, `np.minimum` and `np.maximum`,
loops over rotors, other expressions. Forbidden: `if`, `np.where`, and `abs` of values that depend
on a parameter (not differentiable by complex steps). The rotor axis comes first: `q[i]` is a scalar
in a compiled loop, else any broadcastable array.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from benchtool.core.errors import MissingLibrary
from benchtool.core.user_file import user_folder

Quantity: TypeAlias = Any  # scalar in a compiled loop; else float, complex or array

Function = TypeVar("Function", bound=Callable[..., Any])

_expressions: list[Callable[..., Any]] = []
_loop_parts: list[Callable[..., Any]] = []
_registered: set[int | str] = set()
_watchers: dict[Callable[[float], None], int] = {}  # compiled functions since the start of each
_is_compiling: bool = False

PARTS_OF_LOOP = 150  # compiled functions of a loop: 136 of a pitch bench, 170 of a flight

# Of the parts of a loop: they allocate nothing, so that no references need to be counted.
PART_OPTIONS = {
    "error_model": "numpy", "forceinline": True, "no_cfunc_wrapper": True, "_nrt": False,
}  # fmt: skip


def expression(function: Function) -> Function:
    """Register a branch-free function for `compile_expressions` and return it unchanged."""
    _expressions.append(function)
    if _is_compiling:
        compile_expressions()
    return function


def compile_expressions() -> None:
    """Make all registered functions callable from compiled loops that are compiled afterwards.

    Functions registered later become callable immediately. Division by zero follows NumPy's rules
    (infinity, not an exception) in compiled code too. numba invalidates a cached loop only by the
    age of the loop's own file, so the cache needs a key that covers all sources.
    """
    global _is_compiling
    try:
        from numba.extending import register_jitable
    except ImportError as missing:
        raise MissingLibrary("numba", "a compiled simulation", "fast") from missing
    _is_compiling = True
    for function in (*_expressions, *_loop_parts):
        if id(function) not in _registered:
            register_jitable(**PART_OPTIONS)(function)
            _registered.add(id(function))
    if "records" not in _registered:
        _register_records()
        _register_watchers()
        _registered.add("records")


WIDTH_BYTES = 8  # per number in a shared array: floats and 64-bit integers


class Slot(NamedTuple):
    """Position of a record in a block of rows with one column per lane."""

    first: int  # first row
    like: Any  # example of the record's type: numbers, tuples and named tuples


def read_record(block: Any, slot: Any, lane: Any, lanes: Any) -> Any:
    """Return the record of one lane, of the type of `slot.like`, from a block of rows and lanes."""
    flat = block.reshape(-1)
    return _fill_record(slot.like, iter(range(slot.first * lanes + lane, flat.size, lanes)), flat)


def write_record(block: Any, slot: Any, lane: Any, lanes: Any, record: Any) -> None:
    """Write a record of the type of `slot.like` to one lane of a block of rows and lanes."""
    flat = block.reshape(-1)
    for position, value in enumerate(flat_values(record)):
        flat[(slot.first + position) * lanes + lane] = value


def shared_view(table: Any, like: Any) -> Any:
    """Return a record of arrays, owned by the caller, from a table of their addresses.

    A compiled loop does not count references to these arrays. Counting would take longer than a
    plant step, because each part of a loop counts every array of its records.

    Args:
        table: one row per array: address and lengths of three axes (`simulate.layout.lend_rows`);
            or its address, which takes less time per call. In Python it is the record itself.
        like: record of the same type, with a number in nested tuples for an array, one tuple per
            axis.
    """
    return table


def at_least(value: Quantity, limit: Quantity) -> Quantity:
    """Return the larger one; in a compiled loop one instruction, for a limit that is not nan."""
    return np.maximum(value, limit)


def at_most(value: Quantity, limit: Quantity) -> Quantity:
    """Return the smaller one; in a compiled loop one instruction, for a limit that is not nan."""
    return np.minimum(value, limit)


def unless_zero(weight: Quantity, term: Quantity) -> Quantity:
    """Return a term that is 0 where its weight is 0.

    A compiled loop of one lane does not wait for the term of an absent effect, which would
    otherwise delay the next plant step.
    """
    return term


def with_fields(values: Any, i: int, value: Any) -> Any:
    """Return the tuple with the value at index i replaced; for loops over discs."""
    return (*values[:i], value, *values[i + 1 :])


def flat_values(record: Any) -> list[Any]:
    """Return the numbers of a record in the order of their rows."""
    if not isinstance(record, tuple):
        return [record]
    values = []
    for part in record:
        if isinstance(part, tuple):
            values += flat_values(part)
        else:
            values.append(part)
    return values


def _fill_record(like: Any, indices: Iterator[int], flat: Any) -> Any:
    if not isinstance(like, tuple):
        return flat[next(indices)]
    parts = [_fill_record(part, indices, flat) for part in like]
    return type(like)(*parts) if hasattr(like, "_fields") else tuple(parts)


def _register_records() -> None:
    """Register the functions for records in compiled loops, as plain loads and stores."""
    from numba import types
    from numba.core import cgutils
    from numba.extending import lower_builtin, type_callable
    from numba.np.arrayobj import populate_array

    tools: Any = cgutils
    record_type: Any = types.BaseTuple.from_types
    populate: Any = populate_array

    def row_addresses(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
        """Return a function that returns the address of the next row at every call."""
        block, slot, lane, lanes = values[:4]
        data = context.make_array(kinds[0])(context, builder, block).data
        width = context.cast(builder, lanes, kinds[3], types.intp)
        first = context.cast(builder, builder.extract_value(slot, 0), kinds[1].types[0], types.intp)
        start = builder.mul(first, width)
        offset = [builder.add(start, context.cast(builder, lane, kinds[2], types.intp))]

        def next_address() -> Any:
            address = builder.gep(data, [offset[0]])
            offset[0] = builder.add(offset[0], width)
            return address

        return next_address

    def read(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        next_address = row_addresses(context, builder, signature.args, values)
        element = signature.args[0].dtype

        def load(kind: Any) -> Any:
            if hasattr(kind, "types"):
                return context.make_tuple(builder, kind, [load(part) for part in kind.types])
            return context.cast(builder, builder.load(next_address()), element, kind)

        return load(signature.return_type)

    def write(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        next_address = row_addresses(context, builder, signature.args, values)
        element = signature.args[0].dtype

        def store(kind: Any, value: Any) -> None:
            if hasattr(kind, "types"):
                for position, part in enumerate(kind.types):
                    store(part, builder.extract_value(value, position))
            else:
                builder.store(context.cast(builder, value, kind, element), next_address())

        store(signature.args[4], values[4])
        return context.get_dummy_value()

    def replace(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        tuple_kind, index, value = signature.args
        copy = tools.alloca_once_value(builder, values[0])
        address = builder.gep(
            copy, [tools.intp_t(0), context.cast(builder, values[1], index, types.intp)]
        )
        builder.store(context.cast(builder, values[2], value, tuple_kind.dtype), address)
        return builder.load(copy)

    def array_types(kind: Any) -> Any:
        """Return the type of a record of arrays for the type of its `like`."""
        if hasattr(kind, "instance_class"):
            return record_type([array_types(part) for part in kind.types], kind.instance_class)
        axes = 0
        while hasattr(kind, "types"):
            kind, axes = kind.types[0], axes + 1
        return types.Array(kind, axes, "C")

    def build_view(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        table = values[0]
        if isinstance(signature.args[0], types.Integer):
            table = builder.inttoptr(table, tools.intp_t.as_pointer())
        else:
            table = context.make_array(signature.args[0])(context, builder, table).data
        row = count()

        def next_number() -> Any:
            return builder.load(builder.gep(table, [tools.intp_t(next(row))]))

        def build(kind: Any) -> Any:
            if hasattr(kind, "types"):
                return context.make_tuple(builder, kind, [build(part) for part in kind.types])
            array = context.make_array(kind)(context, builder)
            address, *lengths = [next_number() for _ in range(4)]
            shape, strides = lengths[: kind.ndim], [tools.intp_t(WIDTH_BYTES)]
            for length in reversed(shape[1:]):
                strides.insert(0, builder.mul(strides[0], length))
            data = builder.inttoptr(address, array.data.type)
            populate(array, data, shape, strides, WIDTH_BYTES, None)
            return array._getvalue()  # noqa: SLF001

        return build(signature.return_type)

    def select_limit(operator: str) -> Any:
        def select(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            value, limit = (
                context.cast(builder, number, kind, types.float64)
                for number, kind in zip(values, signature.args, strict=True)
            )
            return builder.select(builder.fcmp_ordered(operator, value, limit), limit, value)

        return select

    def skip_zero(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        weight, term = (
            context.cast(builder, number, kind, types.float64)
            for number, kind in zip(values, signature.args, strict=True)
        )
        zero, start = weight.type(0.0), builder.block
        with tools.if_unlikely(builder, builder.fcmp_unordered("!=", weight, zero)):
            within = builder.block
        result = builder.phi(weight.type)
        result.add_incoming(zero, start)
        result.add_incoming(term, within)
        return result

    set_type: Any = type_callable
    lower: Any = lower_builtin
    set_type(read_record)(lambda context: lambda block, slot, lane, lanes: slot.types[1])
    set_type(write_record)(lambda context: lambda block, slot, lane, lanes, record: types.none)
    set_type(shared_view)(lambda context: lambda table, like: array_types(like))
    set_type(with_fields)(lambda context: lambda values, i, value: values)
    for function, lowering in (
        (at_least, select_limit("<")),
        (at_most, select_limit(">")),
        (unless_zero, skip_zero),
    ):
        set_type(function)(lambda context: lambda first, second: types.float64)
        lower(function, types.Any, types.Any)(lowering)
    lower(shared_view, types.Any, types.Any)(build_view)
    lower(with_fields, types.UniTuple, types.Any, types.Any)(replace)
    lower(read_record, types.Array, *[types.Any] * 3)(read)
    lower(write_record, types.Array, *[types.Any] * 4)(write)


def inlined_expression(function: Function) -> Function:
    """Register a scalar function for use in compiled loops and return it unchanged.

    Unlike an expression it may contain `if`, `while` and indexed arrays. Without numba it runs as
    Python.
    """
    _loop_parts.append(function)
    if _is_compiling:
        compile_expressions()
    return function


def compiled_closure(function: Function, key: str) -> Function:
    """Compile a closure, cached on disk under a key of its components.

    numba identifies a closure only by its source position, which many closures share. Without
    numba the closure is returned unchanged.
    """
    try:
        compile_expressions()
    except MissingLibrary:
        return function
    import numba

    machine_code: Any = numba.njit(error_model="numpy", nogil=True)(function)
    try:
        machine_code._cache = _build_cache_class(key)(function)  # noqa: SLF001
    except (ImportError, AttributeError, TypeError, OSError, RuntimeError, IndexError):
        pass  # no writable folder, or an incompatible numba: compile in every process
    return machine_code  # type: ignore[no-any-return]


@contextmanager
def watch_compilation(report: Callable[[float], None]) -> Iterator[None]:
    """Call `report` with the compiled share, 0 to 1, of a loop at its first run after setup."""
    _watchers[report] = 0
    try:
        yield
    finally:
        del _watchers[report]


def _register_watchers() -> None:
    """Count each compiled function for the callers of `watch_compilation`."""
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, _event: Any) -> None: ...

        def on_end(self, _event: Any) -> None:
            for report in _watchers:
                _watchers[report] += 1
                report(min(_watchers[report] / PARTS_OF_LOOP, 1.0))

    register: Any = event.register
    register("numba:compile", Listener())


def _build_cache_class(key: str) -> Any:
    """Return numba's function cache in `compiled_folder`, with an additional key in its index.

    numba's folder setting is global for the process and therefore not safe with several threads
    that compile.
    """
    from numba.core.caching import FunctionCache

    default_implementation: Any = FunctionCache._impl_class  # noqa: SLF001
    source_locator: Any = default_implementation._locator_classes[1]  # noqa: SLF001

    class CompiledFolder(source_locator):  # type: ignore[misc]
        def get_cache_path(self) -> str:
            return str(compiled_folder() / self.get_suitable_cache_subpath(self._py_file))

    class Implementation(default_implementation):  # type: ignore[misc]
        _locator_classes = (CompiledFolder,)

    class KeyedCache(FunctionCache):
        _impl_class = Implementation

        def _index_key(self, sig: Any, codegen: Any) -> Any:
            return sig, codegen.magic_tuple(), key

    return KeyedCache


@lru_cache(maxsize=1)
def compiled_folder() -> Path:
    """Return the folder of compiled loops for this user and these sources."""
    import hashlib

    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(sys.version.encode())
    for part in ("physics", "simulate"):
        for path in sorted((package / part).rglob("*.py")):
            digest.update(path.name.encode() + path.read_bytes())
    folder = os.environ.get("NUMBA_CACHE_DIR")
    root = Path(folder) if folder else user_folder("XDG_CACHE_HOME", ".cache", mac="Caches")
    return root / f"compiled-{digest.hexdigest()[:16]}"


def can_compile() -> bool:
    """Return True if numba is installed."""
    return find_spec("numba") is not None
