"""Gain sets: what ships, where each number comes from, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.core.packaged import read_named
from benchtool.simulate.gain_file import gain_names, gains_named


def test_the_published_numbers() -> None:
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


@pytest.mark.parametrize("name", gain_names())
def test_every_number_has_a_source(name: str) -> None:
    sources = gains_named(name).sources
    assert len(sources) >= 18
    assert all(sources.values())


def test_a_factor_acts_on_the_gains_of_a_table_and_leaves_limits_alone() -> None:
    before = gains_named("stiff")
    after = before.with_values(attitude=1.5)
    assert after.attitude.k_q_per_s == pytest.approx(18.0)
    assert after.attitude.k_i_q_per_s2 == pytest.approx(7.5)
    assert after.attitude.rate_limit_rad_s == before.attitude.rate_limit_rad_s
    assert after.position == before.position
    assert before.with_values(observer=2.0).observer.rate_per_s == pytest.approx(20.0)


def test_one_gain_takes_a_value() -> None:
    assert gains_named("s3").with_values(**{"attitude.k_q_per_s": 9.0}).attitude.k_q_per_s == 9.0
    assert gains_named("s3").with_values(control_rate_Hz=500.0).control_rate_Hz == 500.0


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
        gains_named("s3").with_values(**{name: 1.0})


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
        gains_named("s3").with_values(**{name: value})


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("control_rate_Hz = 250.0", "control_rate_Hz = 0.0", "control_rate_Hz"),
        ("control_rate_Hz = 250.0", "control_rate_Hz = 1e6", "above 100000"),
        ("rate_per_s = {", "rate_pr_s = {", "rate_per_s"),
    ],
)
def test_a_bad_file_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = read_named("gain set", "gains", "s3")[0]
    assert old in text
    path = tmp_path / "own.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises((FileFormatError, UnknownChoice), match=message):
        gains_named(path)
