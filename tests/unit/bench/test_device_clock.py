"""Device time on the host's clock."""

from __future__ import annotations

import numpy as np

from benchtool.bench.clocks import DeviceClock


def test_host_time_is_right_to_the_smallest_delay(rng: np.random.Generator) -> None:
    clock = DeviceClock()
    drift = 1.0 + 50e-6
    device_us = np.arange(0, 120_000_000, 5_000)
    true_s = 1000.0 + device_us * 1e-6 * drift
    arrived_s = true_s + 0.001 + rng.exponential(0.004, len(true_s))
    host_s = np.empty_like(true_s)
    for i in range(0, len(device_us), 4):
        part = slice(i, i + 4)
        clock.learn(int(device_us[part][-1]), float(arrived_s[part][-1]))
        host_s[part] = clock.host_time_s(device_us[part])
    error_s = (host_s - true_s)[len(host_s) // 4 :]
    assert np.all(np.diff(host_s) > 0.0)
    # One millisecond of delay is always there; the window lets drift add half of one.
    assert np.all(error_s > -0.001)
    assert np.all(error_s < 0.002)


def test_a_late_first_line_is_made_up_for() -> None:
    clock = DeviceClock()
    clock.learn(0, 0.05)
    for step in range(1, 60_000):
        clock.learn(5_000 * step, 0.005 * step)
    assert abs(float(clock.host_time_s(np.array([0]))[0])) < 1e-9
