"""The disturbance observer: a first-order filter of the true disturbance, per component."""

from __future__ import annotations

import numpy as np

from benchtool.simulate.controllers.observer import next_explained, observed


def estimated(rates_per_s: float | np.ndarray, known: np.ndarray, disturbance: np.ndarray,
              dt_s: float, steps: int) -> np.ndarray:  # fmt: skip
    """Return the estimate after some periods of a momentum that starts from zero."""
    momentum, explained, estimate = np.zeros(6), np.zeros(6), np.zeros(6)
    for _ in range(steps + 1):
        estimate = observed(momentum, explained, rates_per_s)
        explained = next_explained(momentum, explained, known, estimate, 1.0, dt_s)
        momentum = momentum + dt_s * (disturbance + known)
    return estimate


def test_it_filters_the_disturbance_with_its_own_rate():
    """With momentum p = F t + known t, the estimate is F (1 - exp(-L t)) as dt goes to 0."""
    rates = np.array([0.0, 4.0, 6.0, 8.0, 10.0, 12.0])
    disturbance = np.array([1.0, -2.0, 3.0, -0.1, 0.2, -0.3])
    found = estimated(rates, np.linspace(-1.0, 1.0, 6), disturbance, 1e-5, 30_000)
    np.testing.assert_allclose(found, disturbance * (1.0 - np.exp(-rates * 0.3)), rtol=1e-4)


def test_switched_on_it_starts_from_zero():
    explained = 0.0
    for momentum in (0.1, 0.2, 0.3):
        explained = next_explained(momentum, explained, 1.0, 0.0, 0.0, 0.004)
    assert observed(0.3, explained, 10.0) == 0.0
