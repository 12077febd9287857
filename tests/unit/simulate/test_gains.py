"""Gain sets: what ships, where each number comes from, and what is refused."""

from __future__ import annotations

import pytest

from benchtool.simulate.gain_file import gain_names, gains_named


def test_the_published_numbers():
    assert gain_names() == ("s1a", "s3", "stiff")
    s3, s1a, stiff = (gains_named(name) for name in ("s3", "s1a", "stiff"))
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
    before = gains_named("stiff")
    after = before.with_values(attitude=1.5)
    assert after.attitude.k_q_per_s == pytest.approx(18.0)
    assert after.attitude.k_i_q_per_s2 == pytest.approx(7.5)
    assert after.attitude.rate_limit_rad_s == before.attitude.rate_limit_rad_s
    assert after.position == before.position
    assert before.with_values(observer=2.0).observer.rate_per_s == pytest.approx(20.0)
