from __future__ import annotations

import numpy as np
import pytest

from benchtool.acquire.average import average, is_settled, slope_of, statistical_inefficiency
from benchtool.acquire.measure import shortage
from benchtool.core.channel import Channel
from benchtool.core.recording import Recording


def autoregressive(rng: np.random.Generator, shape: tuple[int, int], rho: float) -> np.ndarray:
    noise = rng.normal(size=shape)
    values = np.empty(shape)
    values[:, 0] = noise[:, 0] / np.sqrt(1.0 - rho**2)
    for i in range(1, shape[1]):
        values[:, i] = rho * values[:, i - 1] + noise[:, i]
    return values


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8])
def test_the_standard_error_is_the_scatter_of_means(rho: float) -> None:
    values = autoregressive(np.random.default_rng(5), (400, 500), rho)
    scatter = values.mean(axis=1).std(ddof=1)
    stated = np.sqrt(np.mean([average(row).se ** 2 for row in values]))
    assert stated == pytest.approx(scatter, rel=0.12)


def test_inefficiency_of_a_first_order_process() -> None:
    values = autoregressive(np.random.default_rng(6), (1, 200_000), 0.6)[0]
    # (1 + rho)/(1 - rho) for an AR(1) process.
    assert statistical_inefficiency(values) == pytest.approx(4.0, rel=0.1)


def test_alternating_and_constant_values_count_as_independent() -> None:
    assert statistical_inefficiency(np.tile([1.0, -1.0], 50)) == 1.0
    assert statistical_inefficiency(np.ones(50)) == 1.0


def test_gaps_are_left_out_and_few_values_are_told() -> None:
    found = average(np.array([1.0, np.nan, 3.0]))
    assert (found.mean, found.n) == (2.0, 2)
    assert average(np.array([np.nan])).n == 0
    assert np.isnan(average(np.array([4.0])).se)


def test_a_silent_channel_has_the_error_of_rounding() -> None:
    assert average(np.full(100, 2.0), quantum=0.12).se == pytest.approx(0.12 / np.sqrt(12.0))


def test_slope_and_error_of_a_noisy_line() -> None:
    rng = np.random.default_rng(7)
    time_s = np.arange(400) / 100.0
    found = slope_of(time_s, 3.0 + 0.5 * time_s + 0.1 * rng.normal(size=400))
    assert found.per_s == pytest.approx(0.5, abs=4.0 * found.se_per_s)
    expected = 0.1 / np.sqrt(((time_s - time_s.mean()) ** 2).sum())
    assert found.se_per_s == pytest.approx(expected, rel=0.25)
    assert not found.settled(0.01)
    assert found.settled(0.2)


def test_settled_needs_a_whole_window_and_every_channel() -> None:
    time_s = np.arange(150) / 100.0
    flat = np.full(150, 5.0)
    falling = 5.0 - 0.1 * time_s
    assert is_settled(time_s, [flat], 1.0, 0.002)
    assert not is_settled(time_s[:50], [flat[:50]], 1.0, 0.002)
    assert not is_settled(time_s, [flat, falling], 1.0, 0.002)
    assert not is_settled(np.empty(0), [np.empty(0)], 1.0, 0.002)
    assert not is_settled(time_s, [np.full(150, np.nan)], 1.0, 0.002)
    assert not is_settled(time_s, [], 1.0, 0.002)


def test_an_exponential_settles_when_its_slope_has_gone() -> None:
    time_s = np.arange(600) / 100.0
    values = 10.0 - 4.0 * np.exp(-time_s / 0.5)
    settled = [
        time_s[i]
        for i in range(100, 600, 10)
        if is_settled(time_s[: i + 1], [values[: i + 1]], 1.0, 0.002)
    ]
    # 8 exp(-t/0.5) falls to 0.02 per s at t = 3.0 s, in the middle of the window.
    assert 3.0 < settled[0] < 4.5


def span(thrust_values: int, rpm_values: int) -> Recording:
    rows = np.full((200, 2), np.nan)
    rows[:thrust_values, 0], rows[:rpm_values, 1] = 1.0, 4500.0
    return Recording((Channel("thrust_N", "N"), Channel("rpm1", "rpm")), rows)


@pytest.mark.parametrize(
    ("thrust", "rpm", "said"),
    [
        (160, 200, ""),
        (127, 200, ""),  # one below 80 %: the span may begin just behind a value
        (126, 200, "126 of 160 samples of thrust_N came, at least 80 % are needed"),
        (0, 200, "0 of 160 samples of thrust_N"),
        (160, 40, "40 of 200 samples of rpm1"),
    ],
)
def test_a_point_needs_its_share(thrust: int, rpm: int, said: str) -> None:
    text = shortage(span(thrust, rpm), {"thrust_N": 80.0, "rpm1": 100.0}, 2.0, 0.8)
    assert text.startswith(said)
    assert bool(text) == bool(said)


def test_a_channel_that_never_had_a_value_is_short_whatever_its_rate() -> None:
    assert "0 of 0 samples of thrust_N" in shortage(span(0, 0), {"thrust_N": 0.0}, 2.0, 0.8)
