"""One source for scalars, arrays, complex steps and compiled loops."""

from __future__ import annotations

import ast
import inspect
import pkgutil
import textwrap
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import pytest

import benchtool.physics
from benchtool.physics.body_lift import notes_weight
from benchtool.physics.expression import (
    _expressions,
    compile_expressions,
    expression,
    shared_view,
)
from benchtool.physics.images import (
    half_plane_coverage,
    image_velocity,
    partial_factor,
    rectangle_coverage,
    self_image,
    thrust_factor,
)
from benchtool.physics.rotor import ground_effect_thrust_N, speed_from_pwm
from benchtool.simulate.layout import lend_rows

X = np.array([0.225, 0.0, -0.225, 0.0])
Y = np.array([0.0, 0.225, 0.0, -0.225])
DISTANCES = np.hypot(X[:, None] - X, Y[:, None] - Y)
ARMS = np.hypot(X, Y)


@expression
def images_at(height, sources, distances):
    """Return the velocity at a height from images of given strengths and distances."""
    total = 0.0 * height
    for j in range(len(sources)):
        total = total + sources[j] * image_velocity(height, height, distances[j])
    return total


def thrusts(height, coverage, distances, arms, pwm_us, out):
    """Combine most expressions; the same source for NumPy and for the compiled loop."""
    weight = notes_weight(coverage)
    speed = speed_from_pwm(pwm_us, 1.1, 1100.0, 15.2, 14.8)
    for i in range(len(height)):
        images = self_image(height[i]) + images_at(height[i], coverage, distances[i])
        body = 2.0 * weight * 0.12 * 0.12 * images_at(height[i], coverage, arms)
        factor = thrust_factor(0.0144 * images + body)
        out[i] = ground_effect_thrust_N(speed, 1e-5, partial_factor(factor, coverage[i]))


def areas(x, y, out):
    """Combine the coverage expressions."""
    out[0] = half_plane_coverage(x, 0.12)
    out[1] = rectangle_coverage(x, y, 0.12, -0.1, 0.3, -0.04, 0.5)


def test_compiled_loops_and_arrays_give_the_same_numbers(rng):
    numba = pytest.importorskip("numba")
    compile_expressions()
    compile_expressions()
    heights = rng.uniform(0.06, 0.6, (4, 50))
    coverages = rng.uniform(0.0, 1.0, (4, 50))
    pwm = rng.uniform(1000.0, 1900.0, 50)
    batch = np.empty((4, 50))
    thrusts(heights, coverages, DISTANCES, ARMS, pwm, batch)
    compiled = numba.njit(thrusts)
    lanes = np.empty((4, 50))
    for k in range(50):
        compiled(heights[:, k].copy(), coverages[:, k].copy(), DISTANCES, ARMS, pwm[k], lanes[:, k])
    assert np.ptp(batch) > 1.0
    np.testing.assert_allclose(lanes, batch, rtol=1e-14, atol=1e-14)
    x, y = rng.uniform(-0.4, 0.4, (2, 80))
    batch, lanes, compiled = np.empty((2, 80)), np.empty((2, 80)), numba.njit(areas)
    areas(x, y, batch)
    for k in range(80):
        compiled(x[k], y[k], lanes[:, k])
    np.testing.assert_allclose(lanes, batch, rtol=0, atol=1e-14)


def test_expressions_are_branch_free():
    for info in pkgutil.iter_modules(benchtool.physics.__path__, "benchtool.physics."):
        import_module(info.name)
    hooks = [f for f in _expressions if f.__module__.startswith("benchtool.physics.")]
    assert len(hooks) > 20
    branches = {}
    for function in hooks:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
        nodes = [
            ast.unparse(node)
            for node in ast.walk(tree)
            if isinstance(node, ast.If | ast.IfExp | ast.While | ast.BoolOp | ast.Try)
            or (isinstance(node, ast.Attribute) and node.attr in {"where", "abs", "hypot", "clip"})
            or (isinstance(node, ast.Name) and node.id == "abs")
        ]
        if nodes:
            branches[function.__qualname__] = nodes
    assert branches == {}


class Two(NamedTuple):
    counts: Any = (0,)
    plane: Any = ((0.0,),)


class Shared(NamedTuple):
    line: Any = (0.0,)
    two: Two = Two()


def test_a_compiled_loop_writes_to_shared_arrays_without_counting_references():
    numba = pytest.importorskip("numba")
    compile_expressions()
    like = Shared()

    @numba.njit
    def fill(table):
        first, second = shared_view(table, like)
        for i in range(len(first)):
            first[i] = second.plane[i, 1] + second.counts[i]
        second.plane[2, 0] = 9.0
        return first[0]

    arrays = Shared(np.zeros(3), Two(np.arange(3) * 10, np.arange(1.0, 7.0).reshape(3, 2)))
    assert fill(lend_rows(fill, arrays)) == 2.0
    np.testing.assert_array_equal(arrays.line, [2.0, 14.0, 26.0])
    assert arrays.two.plane[2, 0] == 9.0
    assert "call void @NRT_incref" not in fill.inspect_llvm(fill.signatures[0])
    assert shared_view(arrays, like) is lend_rows(fill.py_func, arrays) is arrays
    for other in (np.zeros((3, 1)), np.arange(3), np.zeros(6)[::2]):
        with pytest.raises(TypeError, match="with 1 axes"):
            lend_rows(fill, arrays._replace(line=other))
