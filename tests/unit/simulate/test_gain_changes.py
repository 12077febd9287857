"""Gains by the names of the command line: one gain, a factor on a table, and what is refused."""

from __future__ import annotations

import pytest

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.simulate.gain_changes import changed_gains
from benchtool.simulate.gain_file import gains_named


def test_a_factor_acts_on_the_gains_of_a_table_and_leaves_limits_alone() -> None:
    before = gains_named("stiff")
    after = changed_gains(before, "attitude", 1.5)
    assert after.attitude.k_q_per_s == pytest.approx(18.0)
    assert after.attitude.k_i_q_per_s2 == pytest.approx(7.5)
    assert after.attitude.rate_limit_rad_s == before.attitude.rate_limit_rad_s
    assert after.position == before.position
    assert changed_gains(before, "observer", 2.0).observer.rate_per_s == pytest.approx(20.0)


def test_one_gain_takes_a_value() -> None:
    assert changed_gains(gains_named("s3"), "attitude.k_q_per_s", 9.0).attitude.k_q_per_s == 9.0
    assert changed_gains(gains_named("s3"), "control_rate_Hz", 500.0).control_rate_Hz == 500.0


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("atitude", "unknown table of gains 'atitude'; did you mean 'attitude'"),
        ("atitude.k_q_per_s", "unknown table of gains 'atitude'"),
        ("attitude.k_q", "unknown gain of attitude 'k_q'; did you mean 'k_q_per_s'. known: k_i_q"),
        ("title", "unknown table of gains 'title'"),
    ],
)
def test_an_unknown_name_lists_the_known_ones(name: str, says: str) -> None:
    with pytest.raises(UnknownChoice, match=says):
        changed_gains(gains_named("s3"), name, 1.0)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("attitude", float("nan"), "0 or more"),
        ("attitude", -1.0, "0 or more"),
        ("control_rate_Hz", 0.0, "above 0"),
        ("attitude.rate_limit_rad_s", 0.0, "above 0"),
    ],
)
def test_a_value_that_no_gain_can_have_is_refused(name: str, value: float, says: str) -> None:
    with pytest.raises(InputError, match=says):
        changed_gains(gains_named("s3"), name, value)
