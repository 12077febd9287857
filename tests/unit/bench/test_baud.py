"""A stream has to fit its line."""

from __future__ import annotations

import pytest

from benchtool.bench.serial.bench import check_rate, highest_rate_Hz
from benchtool.core.errors import InputError


def test_the_refusal_shows_the_arithmetic() -> None:
    with pytest.raises(InputError) as caught:
        check_rate(1000.0, 101, 921_600)
    assert str(caught.value) == (
        "1000 frames/s x 101 bytes x 10 bits = 1,010,000 baud, but the link runs at 921,600 baud; "
        "ask for at most 912 Hz or raise baud on both ends"
    )


def test_what_fits_passes() -> None:
    check_rate(912.0, 101, 921_600)
    check_rate(1e6, 101, 0)
    assert highest_rate_Hz(100, 1_000_000) == 1000.0


@pytest.mark.parametrize("rate_Hz", [-1.0, float("nan")])
def test_a_rate_that_is_none(rate_Hz: float) -> None:
    with pytest.raises(InputError, match="makes no sense"):
        check_rate(rate_Hz, 101, 0)
