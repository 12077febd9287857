"""Limits hold however a device spreads its channels over rows."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from benchtool.bench.limit_check import LimitCheck
from benchtool.core.channel import Channel
from benchtool.errors import LimitExceeded
from benchtool.library import rig_named

RIG = rig_named("pquad")
CHANNELS = (
    *(Channel(f"rpm{i + 1}", "rpm") for i in range(4)),
    Channel("thrust_N", "N"),
)
RATE_HZ = 100.0
TOGETHER = np.ones((1, 5), bool)
ALTERNATING = np.array([[1, 1, 1, 1, 0], [0, 0, 0, 0, 1]], bool)
ONE_BY_ONE = np.eye(5, dtype=bool)
SPREADS = pytest.mark.parametrize(
    "spread", [TOGETHER, ALTERNATING, ONE_BY_ONE], ids=["together", "alternating", "one by one"]
)


def stopped_at_s(
    spread: NDArray[np.bool_], rpm: list[float], thrust_N: float, pwm_us: float, block: int = 5
) -> tuple[float, LimitExceeded | None]:
    """Return when a check stops a bench that reads the same for ever, at most ten seconds."""
    check = LimitCheck(CHANNELS, RIG, RIG.limits, 1.0, 0.0)
    check.commanded(np.full(4, pwm_us), 0.0)
    row = np.array([*rpm, thrust_N])
    rng = np.random.default_rng(3)
    n = int(10.0 * RATE_HZ)
    values = np.where(spread[np.arange(n) % len(spread)], row, np.nan)
    values[:, 4] += rng.normal(0.0, 0.01, n)
    values[:, :4] += np.where(np.array(rpm) > 0.0, rng.normal(0.0, 5.0, (n, 4)), 0.0)
    time_s = (1.0 + np.arange(n)) / RATE_HZ
    for start in range(0, n, block):
        rows = slice(start, start + block)
        if error := check.breach(time_s[rows], values[rows]):
            return float(time_s[start]), error
    return float(time_s[-1]), None


@SPREADS
def test_a_healthy_bench_goes_on(spread: NDArray[np.bool_]) -> None:
    assert stopped_at_s(spread, [4512.0] * 4, 9.2, 1500.0)[1] is None


@SPREADS
def test_thrust_of_the_wrong_sign_stops_it(spread: NDArray[np.bool_]) -> None:
    when_s, error = stopped_at_s(spread, [4512.0] * 4, -5.0, 1500.0)
    assert error is not None
    assert error.channel == "thrust_N"
    assert when_s < 1.0


@SPREADS
@pytest.mark.parametrize("block", [1, 3, 5])
def test_a_rotor_that_does_not_turn_stops_it(spread: NDArray[np.bool_], block: int) -> None:
    when_s, error = stopped_at_s(spread, [4512.0, 4512.0, 0.0, 4512.0], 6.9, 1500.0, block)
    assert error is not None
    assert error.channel == "rpm3"
    assert when_s < 2.5
