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

from collections.abc import Callable
from typing import Any, TypeAlias, TypeVar

from benchtool.errors import MissingLibrary

Quantity: TypeAlias = Any
"""A scalar in a compiled loop; outside, anything that broadcasts: float, complex, array."""

Function = TypeVar("Function", bound=Callable[..., Any])

_recorded: list[Callable[..., Any]] = []
_registered: set[int] = set()
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
    for function in _recorded:
        if id(function) not in _registered:
            register_jitable(error_model="numpy")(function)
            _registered.add(id(function))
