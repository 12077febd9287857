from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.rig_file import rig_named
from benchtool.web.bench_process.telemetry import limit_shares

LIMITS = rig_named("pquad").limits
NAMES = ("pwm1_us", "rpm1", "rpm2", "thrust_N", "voltage_V", "current_A")


def test_the_reading_that_is_nearest_counts() -> None:
    low = np.array([1000.0, 0.0, 0.0, -30.0, 10.0, 0.0])
    high = np.array([1000.0, 900.0, 4900.0, 2.0, 11.0, np.nan])
    near = {one.name: one for one in limit_shares(NAMES, low, high, (1200.0, 1300.0), LIMITS)}
    assert list(near) == ["thrust, N", "speed, rpm", "least voltage, V", "pulse, us"]
    assert near["speed, rpm"].share == pytest.approx(4900.0 / LIMITS.rpm)
    assert near["thrust, N"].value == 30.0
    assert near["least voltage, V"].share == pytest.approx(LIMITS.voltage_min_V / 10.0)
    assert near["pulse, us"].value == 1300.0


def test_nothing_is_near_where_nothing_came() -> None:
    gone = np.full(len(NAMES), np.nan)
    assert limit_shares(NAMES, gone, gone, (), LIMITS) == ()
