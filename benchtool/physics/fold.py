"""Combination of functions into nested closures that NumPy runs and numba can compile.

A compiled loop cannot iterate over a list of functions, but it can call a function that calls
another. A list is therefore folded into nested closures, once, in Python. The closures run on
scalars, arrays and complex steps; numba compiles them as expressions.

Every hook is called as `hook(p, i, flow)` with the parameters of its effect as a named tuple; a
hook that changes a quantity takes it last. `p` of a combined function is one tuple with the
parameters of all effects.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from benchtool.physics.expression import expression, inlined_expression

Hook = Callable[..., Any]


class BoundHook(NamedTuple):
    """Hook with the position of its effect's parameters."""

    hook: Hook  # hook(p, i, flow) or hook(p, i, flow, quantity)
    numbers: Callable[..., Any]  # builds the hook's `p` from the parameter values
    # start, stop: the values are p[start:stop] of the combined function
    start: int
    stop: int


@cache
def unrolled(n: int, hook: Hook, start: int = 0) -> Hook:
    """Return f(*args) -> (hook(start, *args), ..., hook(start + n - 1, *args)), without a loop."""
    a, b, c, d = range(start, start + 4)
    if n == 0:
        return expression(lambda *args: ())
    if n == 1:
        return expression(lambda *args: (hook(a, *args),))
    if n == 2:
        return expression(lambda *args: (hook(a, *args), hook(b, *args)))
    if n == 3:
        return expression(lambda *args: (hook(a, *args), hook(b, *args), hook(c, *args)))
    if n == 4:
        return expression(
            lambda *args: (hook(a, *args), hook(b, *args), hook(c, *args), hook(d, *args))
        )
    half = 4 if n <= 8 else n // 8 * 4
    first, second = unrolled(half, hook, start), unrolled(n - half, hook, start + half)
    return expression(lambda *args: first(*args) + second(*args))


@cache
def sum_hooks(hooks: tuple[BoundHook, ...]) -> Hook:
    """Return f(i, flow, p), the sum over hooks from left to right; 0.0 for none."""
    if not hooks:
        return expression(lambda i, flow, p: 0.0)
    hook, numbers, start, stop = hooks[-1]
    if len(hooks) == 1:
        return expression(lambda i, flow, p: hook(numbers(*p[start:stop]), i, flow))
    before = sum_hooks(hooks[:-1])
    return expression(
        lambda i, flow, p: before(i, flow, p) + hook(numbers(*p[start:stop]), i, flow)
    )


@cache
def multiply_hooks(hooks: tuple[BoundHook, ...]) -> Hook:
    """Return f(i, first, flow, p), the product of `first` and all hooks from left to right."""
    if not hooks:
        return expression(lambda i, first, flow, p: first)
    hook, numbers, start, stop = hooks[-1]
    before = multiply_hooks(hooks[:-1])
    return expression(
        lambda i, first, flow, p: before(i, first, flow, p) * hook(numbers(*p[start:stop]), i, flow)
    )


@cache
def chain_hooks(hooks: tuple[BoundHook, ...]) -> Hook:
    """Return f(i, quantity, flow, p), the composition of the hooks from left to right."""
    if not hooks:
        return expression(lambda i, quantity, flow, p: quantity)
    hook, numbers, start, stop = hooks[-1]
    before = chain_hooks(hooks[:-1])
    return expression(
        lambda i, quantity, flow, p: hook(
            numbers(*p[start:stop]), i, flow, before(i, quantity, flow, p)
        )
    )


@cache
def sum_functions(terms: tuple[Hook, ...]) -> Hook:
    """Return f(*args), the sum of the terms from left to right; 0.0 for none."""
    if not terms:
        return expression(lambda *args: 0.0)
    last = terms[-1]
    if len(terms) == 1:
        return last
    before = sum_functions(terms[:-1])
    return expression(lambda *args: before(*args) + last(*args))


@cache
def select_function(functions: tuple[Hook, ...]) -> Hook:
    """Return f(i, *args) -> functions[i](*args), for `unrolled`, which passes a constant i."""
    last, k = functions[-1], len(functions) - 1
    if k == 0:
        return inlined_expression(lambda i, *args: last(*args))
    before = select_function(functions[:-1])
    return inlined_expression(lambda i, *args: last(*args) if i == k else before(i, *args))


@cache
def source_key(function: Hook | None) -> str:
    """Return module, name and digest of the source file of a function; empty for None."""
    if function is None:
        return ""
    import hashlib

    source = Path(inspect.getfile(function)).read_bytes()
    digest = hashlib.sha256(source).hexdigest()[:16]
    return f"{function.__module__}.{function.__qualname__}:{digest}"
