"""Disturbance observer and gain files."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.simulate.controllers.blocks import estimate_disturbance, next_explained_momentum
from benchtool.simulate.gain_file import gain_names, load_gains


def estimated(rates_per_s: float | np.ndarray, known: np.ndarray, disturbance: np.ndarray,
              dt_s: float, steps: int) -> np.ndarray:  # fmt: skip
    """Return the estimate after some periods of a momentum that starts from zero."""
    momentum, explained, estimate = np.zeros(6), np.zeros(6), np.zeros(6)
    for _ in range(steps + 1):
        estimate = estimate_disturbance(momentum, explained, rates_per_s)
        explained = next_explained_momentum(momentum, explained, known, estimate, 1.0, dt_s)
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
        explained = next_explained_momentum(momentum, explained, 1.0, 0.0, 0.0, 0.004)
    assert estimate_disturbance(0.3, explained, 10.0) == 0.0


def test_the_published_numbers():
    assert gain_names() == ("s1a", "s3", "stiff")
    s3, s1a, stiff = (load_gains(name) for name in ("s3", "s1a", "stiff"))
    shown = [
        (
            set_.position.k_x_per_s,
            set_.position.k_v_per_s,
            set_.position.k_iv_per_s2,
            set_.position.integral_limit_m_s2,
            set_.attitude.k_theta_per_s,
            set_.attitude.k_q_per_s,
            set_.observer.rate_per_s,
        )
        for set_ in (s3, s1a)
    ]
    assert shown == [(1.1, 1.5, 0.60, 0.58, 2.9, 7.4, 10.0), (0.33, 1.7, 0.55, 0.43, 1.8, 8.5, 6.0)]
    assert (stiff.attitude.k_theta_per_s, stiff.attitude.k_q_per_s) == (5.0, 12.0)
    assert stiff.attitude.k_i_q_per_s2 > 0.0
    assert s3.attitude.k_i_q_per_s2 == s3.attitude.k_i_theta_per_s2 == 0.0


def test_a_factor_acts_on_the_gains_of_a_table_and_leaves_limits_alone():
    before = load_gains("stiff")
    after = before.with_values(attitude=1.5)
    assert after.attitude.k_q_per_s == pytest.approx(18.0)
    assert after.attitude.k_i_q_per_s2 == pytest.approx(7.5)
    assert after.attitude.rate_limit_rad_s == before.attitude.rate_limit_rad_s
    assert after.position == before.position
    assert before.with_values(observer=2.0).observer.rate_per_s == pytest.approx(20.0)
