"""Rows at even times: flight logs, scattered clocks, and rows that are even already."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.channel import Channel
from benchtool.core.recording import Recording
from benchtool.explain.pitch.resampling import resample_evenly

UNITS = {"time_s": "s", "theta_rad": "rad", "gyro_rad_s": "rad/s", "pwm1_us": "pwm_us"}


def recording(**columns: np.ndarray) -> Recording:
    return Recording.from_columns(
        [(Channel(name, UNITS[name]), values) for name, values in columns.items()]
    )


def moving(time_s: np.ndarray) -> np.ndarray:
    return 0.2 * np.sin(3.0 * time_s)


def test_even_rows_are_left_exactly_alone():
    time_s = 5.0 + np.arange(200) / 250.0
    rows = resample_evenly(recording(time_s=time_s, theta_rad=moving(time_s)), "a")
    np.testing.assert_array_equal(rows.recording.column("theta_rad"), moving(time_s))
    assert rows.rate_Hz == pytest.approx(250.0)
    assert rows.remarks == ()


def test_messages_of_different_times_are_joined():
    """Attitude at 100 Hz, rates 3 ms later, pulses with the rates."""
    at = np.arange(400) / 100.0
    time_s = np.sort(np.concatenate([at, at + 0.003]))
    of_attitude = np.arange(800) % 2 == 0
    pulses = np.where(of_attitude, np.nan, 1500.0 + np.floor(time_s))
    rows = resample_evenly(
        recording(
            time_s=time_s,
            theta_rad=np.where(of_attitude, moving(time_s), np.nan),
            gyro_rad_s=np.where(of_attitude, np.nan, moving(time_s)),
            pwm1_us=pulses,
        ),
        "log",
    )
    clock = rows.recording.column("time_s")
    assert rows.rate_Hz == pytest.approx(100.0)
    assert len(clock) == 400
    np.testing.assert_allclose(rows.recording.column("theta_rad"), moving(clock))
    gyro = rows.recording.column("gyro_rad_s")[1:]
    np.testing.assert_allclose(gyro, moving(clock[1:]), atol=1e-4)  # 100 Hz, interpolated
    held = rows.recording.column("pwm1_us")
    assert held[150] == pytest.approx(1501.0)
    assert held[100] == pytest.approx(1500.7)  # 1501 stands for 7 ms of its 10
    assert "rows are not even in time: resampled at 100 Hz" in rows.remarks


def test_a_scattered_clock_is_straightened():
    rng = np.random.default_rng(4)
    time_s = np.arange(1000) / 200.0 + rng.uniform(-0.001, 0.001, 1000)
    rows = resample_evenly(recording(time_s=time_s, theta_rad=moving(time_s)), "a")
    clock, theta = rows.recording.column("time_s"), rows.recording.column("theta_rad")
    assert np.ptp(np.diff(clock)) < 1e-9
    seen = np.isfinite(theta)
    assert seen.mean() > 0.99
    assert np.max(np.abs(theta - moving(clock))[seen]) < 1e-4


def test_a_gap_is_left_open_and_a_filter_begins_anew():
    time_s = np.arange(1000) / 200.0
    time_s[500:] += 0.5
    time_s += np.where(np.arange(1000) % 2, 0.0015, 0.0)  # scattered as well
    rows = resample_evenly(recording(time_s=time_s, theta_rad=moving(time_s)), "a")
    steps = np.diff(rows.recording.column("time_s"))
    begun = np.flatnonzero(rows.mode == 2.0)
    assert len(begun) == 2
    assert steps[begun[1] - 1] > 0.4
    assert np.delete(steps, begun[1] - 1).max() < 0.007
