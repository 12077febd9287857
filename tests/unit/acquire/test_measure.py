"""Which channel of a point lacks samples, and when nothing has settled."""

import numpy as np
import pytest

from benchtool.acquire.average import is_settled
from benchtool.acquire.measure import shortage
from benchtool.core.channel import Channel
from benchtool.core.recording import Recording


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


def test_nothing_has_settled_of_which_nothing_was_read() -> None:
    time_s = np.linspace(0.0, 2.0, 200)
    assert is_settled(time_s, [np.ones(200)], 1.0, 0.002)
    assert not is_settled(time_s, [np.full(200, np.nan)], 1.0, 0.002)
    assert not is_settled(time_s, [], 1.0, 0.002)
