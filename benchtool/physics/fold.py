"""Join functions into one function that NumPy runs and numba can compile, without writing source.

A compiled loop cannot walk a list of functions, but it can call a function that calls another. So
a list is folded into nested closures, once, in Python. Every piece stays ordinary source. The
closures run on scalars, arrays and complex steps as they stand; numba takes them as expressions.

Every hook is called as `hook(p, i, flow)`, with its effect's own numbers as a named tuple; a hook
that changes a quantity takes that quantity last. `p` of a joined function holds the numbers of all
effects in one tuple.
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
    """Hold a hook and where its effect's own numbers stand among all of them.

    Attributes:
        hook: hook(p, i, flow) or hook(p, i, flow, quantity).
        numbers: makes the hook's `p` of those numbers: the effect's `P`.
        start, stop: the numbers are p[start:stop].
    """

    hook: Hook
    numbers: Callable[..., Any]
    start: int
    stop: int


@cache
def unrolled(n: int, hook: Hook, start: int = 0) -> Hook:
    """Return f(*given) -> (one(start, *given), ..., one(start + n - 1, *given)), without a loop."""
    a, b, c, d = range(start, start + 4)
    if n == 0:
        return expression(lambda *given: ())
    if n == 1:
        return expression(lambda *given: (hook(a, *given),))
    if n == 2:
        return expression(lambda *given: (hook(a, *given), hook(b, *given)))
    if n == 3:
        return expression(lambda *given: (hook(a, *given), hook(b, *given), hook(c, *given)))
    if n == 4:
        return expression(
            lambda *given: (hook(a, *given), hook(b, *given), hook(c, *given), hook(d, *given))
        )
    half = 4 if n <= 8 else n // 8 * 4
    first, rest = unrolled(half, hook, start), unrolled(n - half, hook, start + half)
    return expression(lambda *given: first(*given) + rest(*given))


@cache
def summed(hooks: tuple[BoundHook, ...]) -> Hook:
    """Return f(i, flow, p), the sum over hooks from left to right; 0.0 without any."""
    if not hooks:
        return expression(lambda i, flow, p: 0.0)
    hook, numbers, start, stop = hooks[-1]
    if len(hooks) == 1:
        return expression(lambda i, flow, p: hook(numbers(*p[start:stop]), i, flow))
    before = summed(hooks[:-1])
    return expression(
        lambda i, flow, p: before(i, flow, p) + hook(numbers(*p[start:stop]), i, flow)
    )


@cache
def multiplied(hooks: tuple[BoundHook, ...]) -> Hook:
    """Return f(i, first, flow, p), `first` times every hook from left to right."""
    if not hooks:
        return expression(lambda i, first, flow, p: first)
    hook, numbers, start, stop = hooks[-1]
    before = multiplied(hooks[:-1])
    return expression(
        lambda i, first, flow, p: before(i, first, flow, p) * hook(numbers(*p[start:stop]), i, flow)
    )


@cache
def chained(hooks: tuple[BoundHook, ...]) -> Hook:
    """Return f(i, quantity, flow, p), the quantity changed by every hook in turn."""
    if not hooks:
        return expression(lambda i, quantity, flow, p: quantity)
    hook, numbers, start, stop = hooks[-1]
    before = chained(hooks[:-1])
    return expression(
        lambda i, quantity, flow, p: hook(
            numbers(*p[start:stop]), i, flow, before(i, quantity, flow, p)
        )
    )


@cache
def added(terms: tuple[Hook, ...]) -> Hook:
    """Return f(*given), the sum of the terms from left to right; 0.0 without any."""
    if not terms:
        return expression(lambda *given: 0.0)
    last = terms[-1]
    if len(terms) == 1:
        return last
    before = added(terms[:-1])
    return expression(lambda *given: before(*given) + last(*given))


@cache
def selected(functions: tuple[Hook, ...]) -> Hook:
    """Return f(i, *given) -> functions[i](*given), for `unrolled`, which gives i as a constant."""
    last, k = functions[-1], len(functions) - 1
    if k == 0:
        return inlined_expression(lambda i, *given: last(*given))
    before = selected(functions[:-1])
    return inlined_expression(lambda i, *given: last(*given) if i == k else before(i, *given))


@cache
def identity(function: Hook | None) -> str:
    """Return module, name and a digest of the source file of a function; empty for None."""
    if function is None:
        return ""
    import hashlib

    source = Path(inspect.getfile(function)).read_bytes()
    digest = hashlib.sha256(source).hexdigest()[:16]
    return f"{function.__module__}.{function.__qualname__}:{digest}"
