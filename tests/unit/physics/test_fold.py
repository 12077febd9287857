"""Functions combined by closures: same results as a plain loop, compiled once."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from benchtool.physics import expression as compiling
from benchtool.physics.expression import compiled_closure, expression
from benchtool.physics.fold import BoundHook, chain_hooks, multiply_hooks, sum_hooks, unrolled


class Two(NamedTuple):
    gain: Any
    offset: Any


class One(NamedTuple):
    power: Any


@expression
def term(p: Two, i: int, flow: Any) -> Any:
    return p.gain * flow[i] + p.offset


@expression
def other_term(p: One, i: int, flow: Any) -> Any:
    return flow[i] ** p.power


@expression
def change(p: Two, i: int, flow: Any, quantity: Any) -> Any:
    return p.gain * quantity + p.offset * flow[i]


TERMS = (BoundHook(term, Two, 0, 2), BoundHook(other_term, One, 2, 3), BoundHook(term, Two, 3, 5))
CHANGES = (BoundHook(change, Two, 0, 2), BoundHook(change, Two, 3, 5))
P = (2.0, 0.25, 3.0, -1.5, 0.5)
FLOW = (0.3, 0.7, 1.1)


def sum_terms(i: int, flow: Any, p: Any) -> Any:
    return p[0] * flow[i] + p[1] + flow[i] ** p[2] + (p[3] * flow[i] + p[4])


def apply_changes(i: int, quantity: Any, flow: Any, p: Any) -> Any:
    return p[3] * (p[0] * quantity + p[1] * flow[i]) + p[4] * flow[i]


CASES = {
    "sum": (lambda i, flow, p: sum_hooks(TERMS)(i, flow, p), sum_terms),
    "product": (
        lambda i, flow, p: multiply_hooks(TERMS[:2])(i, 1.5, flow, p),
        lambda i, flow, p: 1.5 * (p[0] * flow[i] + p[1]) * flow[i] ** p[2],
    ),
    "chain": (
        lambda i, flow, p: chain_hooks(CHANGES)(i, 0.9, flow, p),
        lambda i, flow, p: apply_changes(i, 0.9, flow, p),
    ),
    "nothing to add": (lambda i, flow, p: sum_hooks(())(i, flow, p), lambda i, flow, p: 0.0),
    "nothing to change": (
        lambda i, flow, p: chain_hooks(())(i, 7.0, flow, p),
        lambda i, flow, p: 7.0,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_combined_hooks_equal_the_explicit_expression(name):
    combined, expected = CASES[name]
    for i in range(3):
        assert combined(i, FLOW, P) == expected(i, FLOW, P)


def test_a_compiled_loop_gives_the_same_numbers():
    numba = pytest.importorskip("numba")
    compiling.compile_expressions()
    total = unrolled(3, expression(lambda i, flow, p: sum_hooks(TERMS)(i, flow, p)))
    fold, change_all = sum_hooks(TERMS), chain_hooks(CHANGES)

    @numba.njit(error_model="numpy")
    def loop(flow, p):
        out = 0.0
        for i in range(3):
            out += fold(i, flow, p) + change_all(i, flow[i], flow, p)
        return out

    expected = sum(sum_terms(i, FLOW, P) + apply_changes(i, FLOW[i], FLOW, P) for i in range(3))
    assert loop(FLOW, P) == pytest.approx(expected, rel=1e-15)
    assert total is not None


def loop_over(count: int) -> Any:
    """Return a compiled loop over the first `count` terms; all loops have the same source."""
    total = sum_hooks(TERMS[:count])

    def run(flow, p):
        out = 0.0
        for i in range(3):
            out += total(i, flow, p)
        return out

    return compiled_closure(run, f"terms {count}")


TWO_LOOPS = """
    from tests.unit.physics.test_fold import FLOW, P, loop_over

    for count in (1, 3):
        loop = loop_over(count)
        print(repr(loop(FLOW, P)), *(sum(counts.values()) for counts in loop.stats[1:]))
"""


def run_in_process(folder: Path) -> list[list[str]]:
    process = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(TWO_LOOPS)],
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder)},
        capture_output=True,
        text=True,
        check=True,
    )
    return [line.split() for line in process.stdout.splitlines()]


def test_a_second_process_compiles_nothing(tmp_path):
    """Closures from the same source line are distinguished by their keys."""
    pytest.importorskip("numba")
    first, second = run_in_process(tmp_path), run_in_process(tmp_path)
    expected = [sum(sum_hooks(TERMS[:count])(i, FLOW, P) for i in range(3)) for count in (1, 3)]
    assert [float(row[0]) for row in first] == pytest.approx(expected, rel=1e-15)
    assert [row[0] for row in second] == [row[0] for row in first]
    assert [row[1:] for row in first] == [["0", "1"], ["0", "1"]]
    assert [row[1:] for row in second] == [["1", "0"], ["1", "0"]]
