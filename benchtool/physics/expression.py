"""Physics written once: branch-free functions that NumPy runs and numba can compile.

A function marked `@expression` stays what it is: called from Python it works on scalars, arrays
and complex steps with plain NumPy. The mark only records it, so that `compile_expressions` can
make the very same source callable from compiled loops where numba is installed.

What an expression may hold: arithmetic, NumPy's elementwise functions, `np.minimum` and
`np.maximum`, loops over rotors, other expressions. What it may not: `if`, `np.where`, `abs` of
anything that depends on a parameter (complex steps have no absolute value). The rotor axis comes
first: `q[i]` is a scalar in a compiled loop and any broadcastable array outside of one.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from functools import lru_cache
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeVar

from benchtool.core.errors import MissingLibrary
from benchtool.core.user_file import user_folder

Quantity: TypeAlias = Any  # scalar in a compiled loop; else float, complex or array

Function = TypeVar("Function", bound=Callable[..., Any])

_recorded: list[Callable[..., Any]] = []
_recorded_parts: list[Callable[..., Any]] = []
_registered: set[int | str] = set()
_asked_to_compile: bool = False


def expression(function: Function) -> Function:
    """Mark a branch-free function for `compile_expressions` and return it unchanged."""
    _recorded.append(function)
    if _asked_to_compile:
        compile_expressions()
    return function


def recorded_expressions() -> tuple[Callable[..., Any], ...]:
    """Return every function marked so far, in order of definition."""
    return tuple(_recorded)


def compile_expressions() -> None:
    """Make every marked function callable from compiled loops; call it before such a loop compiles.

    What is marked later is registered as it is marked. Division by zero follows NumPy's rules
    (infinity, not an exception) in the compiled form too. A compiled loop that is cached on disk
    knows only its own file's age: key its cache by the version of the project.
    """
    global _asked_to_compile
    try:
        from numba.extending import register_jitable
    except ImportError as missing:
        raise MissingLibrary("numba", "a compiled simulation", "fast") from missing
    _asked_to_compile = True
    for function in (*_recorded, *_recorded_parts):
        if id(function) not in _registered:
            register_jitable(error_model="numpy", forceinline=True, no_cfunc_wrapper=True)(function)
            _registered.add(id(function))
    if "records" not in _registered:
        _register_records()
        _registered.add("records")


WIDTH_BYTES = 8  # of a number in an array that a loop borrows: floats and 64-bit integers


class Slot(NamedTuple):
    """Say where a record stands in a block of rows, one column per lane.

    Attributes:
        like: a record of the same type, itself of numbers, tuples and named tuples.
    """

    first: int
    like: Any


def read_record(block: Any, slot: Any, lane: Any, lanes: Any) -> Any:
    """Return the record of one lane, as `slot.like` is, from a block of rows times lanes."""
    flat = block.reshape(-1)
    return _filled(slot.like, iter(range(slot.first * lanes + lane, flat.size, lanes)), flat)


def write_record(block: Any, slot: Any, lane: Any, lanes: Any, record: Any) -> None:
    """Write a record of the type of `slot.like` to one lane of a block of rows times lanes."""
    flat = block.reshape(-1)
    for position, value in enumerate(flat_values(record)):
        flat[(slot.first + position) * lanes + lane] = value


def shared_view(table: Any, like: Any) -> Any:
    """Return a record of arrays that the caller keeps alive, from a table of where they stand.

    Args:
        table: of each array a row: address and lengths of three axes (`simulate.layout.lend_rows`).
            In Python it is the record itself.
        like: a record of the same type; for an array a number of its type in as many tuples as it
            has axes.

    A compiled loop does not count references to them: counting costs more than a plant step,
    because every part of a loop that is handed a record of arrays counts each of them.
    """
    return table


def with_fields(values: Any, i: int, value: Any) -> Any:
    """Return the tuple with another value at place i; for loops over discs."""
    return (*values[:i], value, *values[i + 1 :])


def flat_values(record: Any) -> list[Any]:
    """Return the numbers of a record in the order of their rows."""
    if not isinstance(record, tuple):
        return [record]
    found = []
    for part in record:
        if isinstance(part, tuple):
            found += flat_values(part)
        else:
            found.append(part)
    return found


def _filled(like: Any, places: Iterator[int], flat: Any) -> Any:
    if not isinstance(like, tuple):
        return flat[next(places)]
    parts = [_filled(part, places, flat) for part in like]
    return type(like)(*parts) if hasattr(like, "_fields") else tuple(parts)


def _register_records() -> None:
    """Give compiled loops the functions for records, as plain loads and stores."""
    from numba import types
    from numba.core import cgutils
    from numba.extending import lower_builtin, type_callable
    from numba.np.arrayobj import populate_array

    tools: Any = cgutils
    record_type: Any = types.BaseTuple.from_types
    populate: Any = populate_array

    def places(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
        """Return a function that gives the address of the next row at every call."""
        block, slot, lane, lanes = values[:4]
        data = context.make_array(kinds[0])(context, builder, block).data
        width = context.cast(builder, lanes, kinds[3], types.intp)
        first = context.cast(builder, builder.extract_value(slot, 0), kinds[1].types[0], types.intp)
        start = builder.mul(first, width)
        at = [builder.add(start, context.cast(builder, lane, kinds[2], types.intp))]

        def following() -> Any:
            address = builder.gep(data, [at[0]])
            at[0] = builder.add(at[0], width)
            return address

        return following

    def read(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        following = places(context, builder, signature.args, values)
        element = signature.args[0].dtype

        def made(kind: Any) -> Any:
            if hasattr(kind, "types"):
                return context.make_tuple(builder, kind, [made(each) for each in kind.types])
            return context.cast(builder, builder.load(following()), element, kind)

        return made(signature.return_type)

    def write(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        following = places(context, builder, signature.args, values)
        element = signature.args[0].dtype

        def put(kind: Any, value: Any) -> None:
            if hasattr(kind, "types"):
                for position, each in enumerate(kind.types):
                    put(each, builder.extract_value(value, position))
            else:
                builder.store(context.cast(builder, value, kind, element), following())

        put(signature.args[4], values[4])
        return context.get_dummy_value()

    def replace(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        tuple_kind, index, value = signature.args
        room = tools.alloca_once_value(builder, values[0])
        place = builder.gep(
            room, [tools.intp_t(0), context.cast(builder, values[1], index, types.intp)]
        )
        builder.store(context.cast(builder, values[2], value, tuple_kind.dtype), place)
        return builder.load(room)

    def arrays_like(kind: Any) -> Any:
        """Return the type of arrays of a form."""
        if hasattr(kind, "instance_class"):
            return record_type([arrays_like(each) for each in kind.types], kind.instance_class)
        axes = 0
        while hasattr(kind, "types"):
            kind, axes = kind.types[0], axes + 1
        return types.Array(kind, axes, "C")

    def borrow(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        table = context.make_array(signature.args[0])(context, builder, values[0]).data
        row = count()

        def number() -> Any:
            return builder.load(builder.gep(table, [tools.intp_t(next(row))]))

        def made(kind: Any) -> Any:
            if hasattr(kind, "types"):
                return context.make_tuple(builder, kind, [made(each) for each in kind.types])
            array = context.make_array(kind)(context, builder)
            address, *lengths = [number() for _ in range(4)]
            shape, strides = lengths[: kind.ndim], [tools.intp_t(WIDTH_BYTES)]
            for length in reversed(shape[1:]):
                strides.insert(0, builder.mul(strides[0], length))
            data = builder.inttoptr(address, array.data.type)
            populate(array, data, shape, strides, WIDTH_BYTES, None)
            return array._getvalue()  # noqa: SLF001

        return made(signature.return_type)

    typed: Any = type_callable
    lowered: Any = lower_builtin
    typed(read_record)(lambda context: lambda block, slot, lane, lanes: slot.types[1])
    typed(write_record)(lambda context: lambda block, slot, lane, lanes, record: types.none)
    typed(shared_view)(lambda context: lambda table, like: arrays_like(like))
    typed(with_fields)(lambda context: lambda values, i, value: values)
    lowered(shared_view, types.Array, types.Any)(borrow)
    lowered(with_fields, types.UniTuple, types.Any, types.Any)(replace)
    lowered(read_record, types.Array, *[types.Any] * 3)(read)
    lowered(write_record, types.Array, *[types.Any] * 4)(write)


def inlined_expression(function: Function) -> Function:
    """Mark a piece of a compiled loop and return it unchanged: scalars only, branches allowed.

    For what a compiled loop calls and is no expression: it may hold `if`, `while` and indexed
    arrays. Without numba it runs as it stands.
    """
    _recorded_parts.append(function)
    if _asked_to_compile:
        compile_expressions()
    return function


def compiled_closure(function: Function, key: str) -> Function:
    """Compile a closure, kept on disk under a key: what it was made of.

    numba knows a closure by the place of its source alone, which many closures share. Without
    numba the closure is returned as it stands; without a folder that can be written, or where
    numba's cache has changed, it compiles anew in every process.
    """
    try:
        compile_expressions()
    except MissingLibrary:
        return function
    import numba

    machine_code: Any = numba.njit(error_model="numpy", nogil=True)(function)
    try:
        machine_code._cache = _cache_under(key)(function)  # noqa: SLF001
    except (ImportError, AttributeError, TypeError, OSError, RuntimeError, IndexError):
        pass  # no folder that can be written, or another numba: compile in every process
    return machine_code  # type: ignore[no-any-return]


def _cache_under(key: str) -> Any:
    """Return numba's cache of functions in `compiled_folder`, with a key of ours in its index.

    numba's own setting of the folder is one for the whole process, where two threads that compile
    would change it under each other.
    """
    from numba.core.caching import FunctionCache

    usual: Any = FunctionCache._impl_class  # noqa: SLF001
    beside_the_source: Any = usual._locator_classes[1]  # noqa: SLF001

    class CompiledFolder(beside_the_source):  # type: ignore[misc]
        def get_cache_path(self) -> str:
            return str(compiled_folder() / self.get_suitable_cache_subpath(self._py_file))

    class InCompiledFolder(usual):  # type: ignore[misc]
        _locator_classes = (CompiledFolder,)

    class KeyedCache(FunctionCache):
        _impl_class = InCompiledFolder

        def _index_key(self, sig: Any, codegen: Any) -> Any:
            return sig, codegen.magic_tuple(), key

    return KeyedCache


@lru_cache(maxsize=1)
def compiled_folder() -> Path:
    """Return the folder of compiled loops: of this user, and of these very sources."""
    import hashlib

    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(sys.version.encode())
    for part in ("physics", "simulate"):
        for path in sorted((package / part).rglob("*.py")):
            digest.update(path.name.encode() + path.read_bytes())
    return _cache_root() / f"compiled-{digest.hexdigest()[:16]}"


def _cache_root() -> Path:
    """Return where this user keeps what can be made again."""
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(given)
    return user_folder("XDG_CACHE_HOME", ".cache", mac="Caches")


def can_compile() -> bool:
    """Whether numba is installed, so that loops run at full speed."""
    return find_spec("numba") is not None
