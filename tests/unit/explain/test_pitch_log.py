"""Recordings that can be followed, what is mended with words, and what is refused with words."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.rig_file import load_rig_by_name
from benchtool.explain.pitch.log import pitch_log

Array = np.ndarray


@pytest.fixture
def rig():
    return load_rig_by_name("beam")


def recording(**changed: Array | None) -> Recording:
    """Return ten seconds at 100 Hz, some columns changed or, with None, left out."""
    n = 1000
    rng = np.random.default_rng(0)
    columns: dict[str, tuple[str, Array]] = {
        "time_s": ("s", np.arange(n) / 100.0),
        "theta_ref_rad": ("rad", np.zeros(n)),
        "theta_rad": ("rad", 0.01 * rng.standard_normal(n)),
        "gyro_rad_s": ("rad/s", 0.1 * rng.standard_normal(n)),
        "pwm1_us": ("us", np.full(n, 1450.0)),
        "pwm2_us": ("us", np.full(n, 1460.0)),
        "rpm1": ("rpm", np.full(n, 5400.0)),
        "rpm2": ("rpm", np.full(n, 5520.0)),
        "plate_z_m": ("m", np.full(n, 1.0)),
    }
    pairs = []
    for name, (unit, values) in columns.items():
        given = changed.get(name, values)
        if given is not None:
            pairs.append((Channel(name, unit), given))
    return Recording.from_columns(pairs, {"file": "made.csv"})


def test_without_pulses_the_plant_is_driven_by_speeds(rig):
    log = pitch_log(recording(pwm1_us=None, pwm2_us=None), rig)
    assert log.logged.from_speeds
    p = rig.propulsion
    settled = p.speed_per_us_rad_s * (log.logged.pwm_us[:, 0] - p.pwm_start_us)
    np.testing.assert_allclose(settled, np.array([5400.0, 5520.0]) * np.pi / 30.0)
    assert not np.isfinite(log.logged.speed_rad_s).any()


def test_gaps_and_a_clock_that_jumps_back_part_it(rig):
    time_s = np.arange(1000) / 100.0
    time_s[400:] += 0.5
    time_s[700:] -= 3.0
    log = pitch_log(recording(time_s=time_s), rig)
    assert [float(mode) for mode in log.logged.mode[[0, 400, 700]]] == [2.0, 2.0, 2.0]
    assert log.logged.mode.sum() == 1000 + 3
    assert "1 gap in time, the first at 3.990 s, the longest 0.510 s" in log.remarks[1]
    assert "jumps back once" in log.remarks[0]
    assert log.logged.rate_Hz == pytest.approx(100.0)


def test_blank_cells_are_held_or_stay_blank(rig):
    pwm = np.full(1000, 1450.0)
    pwm[10:14] = np.nan
    theta = 0.01 * np.random.default_rng(1).standard_normal(1000)
    theta[30:40] = np.nan
    log = pitch_log(recording(pwm1_us=pwm, theta_rad=theta), rig)
    assert np.all(log.logged.pwm_us[0] == 1450.0)
    assert np.isnan(log.logged.theta_rad[30:40]).all()


def test_what_drives_a_plant_is_not_made_up(rig):
    pwm = np.full(1000, 1450.0)
    pwm[300:420] = np.nan
    log = pitch_log(recording(pwm1_us=pwm), rig)
    assert len(log.logged) == 1000 - 115  # five rows are within what may be held
    assert np.flatnonzero(log.logged.mode == 2.0).tolist() == [0, 305]
    assert any("1.15 s without angle or drive" in one for one in log.remarks)


def test_a_plant_that_is_driven_seldom_is_said_or_refused(rig):
    seldom = np.full(1000, np.nan)
    seldom[::4] = 1450.0
    log = pitch_log(recording(pwm1_us=seldom), rig)
    assert any("sampling rate of pwm1_us is 25 Hz" in one for one in log.remarks)
    seldom[::8] = np.nan
    with pytest.raises(InputError, match=r"rate of pwm1_us in .* is 12\.5 Hz; minimum"):
        pitch_log(recording(pwm1_us=seldom), rig)


def test_only_gaps_is_refused(rig):
    time_s = np.arange(1000) / 100.0 + 0.3 * (np.arange(1000) // 120)
    with pytest.raises(InputError, match=r"longest segment of made.csv .* is 1\.20 s"):
        pitch_log(recording(time_s=time_s), rig)


def test_a_noisy_plate_is_smoothed_where_it_stands(rig):
    rng = np.random.default_rng(2)
    plate = np.where(np.arange(1000) < 500, 1.0, 0.2) + 0.001 * rng.standard_normal(1000)
    log = pitch_log(recording(plate_z_m=plate), rig)
    # 0.6 s before and after it jumps are left out, and the last 0.6 s: it may be on its way out.
    inside = log.logged.plate_z_m[460:]
    assert inside.std() < 0.5 * 0.001
    assert abs(inside.mean() - 0.2) < 2e-4
    np.testing.assert_array_equal(log.logged.plate_share, (np.arange(820) >= 440) * 1.0)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"time_s": None}, "has no time_s"),
        ({"theta_rad": None}, "has no theta_rad"),
        ({"theta_rad": np.zeros(1000)}, "theta_rad of made.csv is 0 in every row: sensor failure"),
        ({"time_s": np.zeros(1000)}, "does not increase"),
        ({"time_s": np.arange(1000) * 10.0}, "is 0.1 Hz; minimum: 20 Hz, .* unit of time_s"),
        ({"pwm1_us": None, "rpm1": None}, "neither the pulses nor the speeds of all 2 rotors"),
        ({"time_s": np.arange(1000) / 1000.0}, r"is too short: 1\.0 s; minimum: 4 s"),
    ],
)
def test_what_cannot_be_judged_is_refused(rig, changed, words):
    with pytest.raises(InputError, match=words):
        pitch_log(recording(**changed), rig)
