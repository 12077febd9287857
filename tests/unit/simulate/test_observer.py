"""The disturbance observer: a first-order filter of the true disturbance, in six components."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.errors import InputError
from benchtool.simulate.controllers.observer import (
    COMPONENTS,
    DisturbanceObserver,
    next_explained,
    observed,
)


def test_it_filters_the_disturbance_with_its_own_rate() -> None:
    """With momentum p = F t + known t, the estimate is F (1 - exp(-L t)) as dt goes to 0."""
    rates = np.array([2.0, 4.0, 6.0, 8.0, 10.0, 12.0])
    disturbance = np.array([1.0, -2.0, 3.0, -0.1, 0.2, -0.3])
    known = np.linspace(-1.0, 1.0, 6)
    dt_s, steps = 1e-5, 30_000
    observer = DisturbanceObserver(rates)
    momentum = np.zeros(6)
    for _ in range(steps):
        observer.step(momentum, known, dt_s)
        momentum = momentum + dt_s * (disturbance + known)
    estimate = observer.step(momentum, known, dt_s)
    expected = disturbance * (1.0 - np.exp(-rates * steps * dt_s))
    np.testing.assert_allclose(estimate, expected, rtol=1e-4)
    assert len(COMPONENTS) == 6


def test_in_the_steady_state_it_is_the_disturbance_whatever_the_period() -> None:
    observer = DisturbanceObserver(np.full(6, 10.0))
    momentum = np.zeros(6)
    for _ in range(2000):
        estimate = observer.step(momentum, np.full(6, 0.7), 0.004)
        momentum = momentum + 0.004 * (0.7 + 0.05)
    np.testing.assert_allclose(estimate, 0.05, rtol=1e-9)


def test_a_rate_of_zero_leaves_a_component_out() -> None:
    rates = np.array([0.0, 0.0, 0.0, 0.0, 10.0, 0.0])
    estimate = DisturbanceObserver(rates).step(np.ones(6), np.zeros(6), 0.004)
    np.testing.assert_array_equal(estimate, [0.0, 0.0, 0.0, 0.0, 10.0, 0.0])


def test_switched_on_it_starts_from_zero() -> None:
    explained = 0.0
    for momentum in (0.1, 0.2, 0.3):
        explained = next_explained(momentum, explained, 1.0, 0.0, 0.0, 0.004)
    assert observed(0.3, explained, 10.0) == 0.0
    observer = DisturbanceObserver(np.full(6, 10.0))
    observer.restart(np.full(6, 3.0))
    np.testing.assert_array_equal(observer.step(np.full(6, 3.0), np.zeros(6), 0.004), np.zeros(6))


def test_a_wrong_number_of_rates_is_refused() -> None:
    with pytest.raises(InputError, match="six rates"):
        DisturbanceObserver(np.array([1.0, -1.0]))
