"""Bounded Gauss-Newton steps against scipy's own bounded solver and closed forms."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import least_squares

from benchtool.explain.engine import bounded_least_squares as bounded

Array = np.ndarray


def curved(sets: Array) -> Array:
    """Return residuals (40, n_sets) of a decaying exponential with three numbers, scaled."""
    t = np.linspace(0.0, 3.0, 40)[:, None]
    a, b, c = 2.0 + sets[:, 0], 1.0 + 0.5 * sets[:, 1], 0.3 * sets[:, 2]
    data = 2.6 * np.exp(-1.7 * t) + 0.2 + 0.01 * np.sin(37.0 * t)
    rows: Array = (a * np.exp(-b * t) + c - data) / 0.05
    return rows


def search(residuals: Callable[[Array], Array], upper: Array) -> bounded.BoundedSearch:
    def linearise(at: Array) -> bounded.Linearisation:
        table = bounded.finite_differences(residuals, at, upper)
        rows, jacobian = table[:, 0], table[:, 1:]
        return bounded.Linearisation(
            at, float(rows @ rows), jacobian.T @ rows, jacobian.T @ jacobian
        )

    return bounded.BoundedSearch(lambda sets: np.sum(residuals(sets) ** 2, axis=0), linearise)


@pytest.mark.parametrize(
    ("lower", "upper"),
    [
        ([-9.0, -9.0, -9.0], [9.0, 9.0, 9.0]),
        ([-0.2, -9.0, -9.0], [0.2, 9.0, 9.0]),
        ([-0.2, -0.3, 0.0], [0.2, 0.3, 0.1]),
    ],
)
def test_it_finds_what_scipy_finds(lower, upper):
    minimizer = search(curved, np.full(3, 10.0))
    region = bounded.BoundedRegion(
        lower=np.array(lower), upper=np.array(upper), penalty=np.zeros(3)
    )
    found = minimizer.minimize(np.zeros(3), region, min_gain=1e-9, max_steps=40)
    theirs = least_squares(
        lambda x: curved(x[None])[:, 0], np.full(3, 0.05), bounds=(lower, upper), xtol=1e-12,
        ftol=1e-12, gtol=1e-12,
    )  # fmt: skip
    assert found.cost == pytest.approx(2.0 * theirs.cost, rel=1e-4)
    np.testing.assert_allclose(found.values, theirs.x, atol=0.02)  # differences over steps of 0.05


def test_a_penalty_is_a_prior():
    """One residual (x - 3) beside a prior of width 1/2 about 0: the mean is 3 / (1 + 4)."""
    found = search(lambda sets: sets.T - 3.0, np.array([9.0])).minimize(
        np.zeros(1),
        bounded.BoundedRegion(
            lower=np.array([-9.0]), upper=np.array([9.0]), penalty=np.array([2.0])
        ),
        min_gain=1e-12,
    )
    assert found.values[0] == pytest.approx(0.6, rel=1e-6)
    assert found.cost == pytest.approx(2.4**2 + 4.0 * 0.36, rel=1e-6)
