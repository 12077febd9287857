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
    assert shown == [
        (1.1, 1.5, 0.60, 0.58, 2.9, 7.4, 10.0),
        (0.33, 1.7, 0.55, 0.43, 1.8, 8.5, 6.0),
    ]
    assert (stiff.attitude.k_theta_per_s, stiff.attitude.k_q_per_s) == (5.0, 12.0)
    assert stiff.attitude.k_i_q_per_s2 > 0.0
    assert s3.attitude.k_i_q_per_s2 == s3.attitude.k_i_theta_per_s2 == 0.0


@pytest.mark.parametrize("name", gain_names())
def test_every_number_has_a_source(name: str) -> None:
    sources = gains_named(name).sources
    assert len(sources) >= 18
    assert all(sources.values())


def test_gains_can_be_varied_by_their_dotted_name() -> None:
    changed = gains_named("s3").with_values(**{"attitude.k_q_per_s": 8.0, "control_rate_Hz": 500.0})
    assert changed.attitude.k_q_per_s == 8.0
    assert changed.control_rate_Hz == 500.0
    assert changed.attitude.k_theta_per_s == 2.9


@pytest.mark.parametrize("key", ["attitude.kq", "atitude.k_q_per_s", "rate_Hz"])
def test_an_unknown_gain_lists_the_known_ones(key: str) -> None:
    with pytest.raises(UnknownChoice, match="known: "):
        gains_named("s3").with_values(**{key: 1.0})


@pytest.mark.parametrize("value", [float("nan"), -1.0, float("inf")])
def test_an_unphysical_gain_is_refused(value: float) -> None:
    with pytest.raises(InputError, match=r"gain attitude\.k_q_per_s is"):
        gains_named("s3").with_values(**{"attitude.k_q_per_s": value})


def test_a_table_is_no_gain() -> None:
    with pytest.raises(InputError, match="no single gain"):
        gains_named("s3").with_values(attitude=1.0)


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
