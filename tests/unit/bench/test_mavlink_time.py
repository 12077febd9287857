from __future__ import annotations

import pytest

from benchtool.bench.mavlink.frames import MODULUS, BootTime


def test_microseconds_of_32_bits_go_on_over_their_wrap() -> None:
    time = BootTime()
    told = [time.us32((MODULUS - 30_000 + 20_000 * step) % MODULUS) for step in range(5)]
    assert [us - told[0] for us in told] == [0, 20_000, 40_000, 60_000, 80_000]
    assert not time.rebooted


def test_stamps_of_every_kind_lie_on_one_count() -> None:
    time = BootTime()
    boot_ms = 5_000_000  # 83 minutes: the 32 bits of microseconds have wrapped once
    assert time.ms32(boot_ms) == 5_000_000_000
    assert time.us32((1000 * boot_ms + 700) % MODULUS) == 5_000_000_700
    assert time.us64(5_000_001_000) == 5_000_001_000
    # Since 1970, or nothing at all: as late as the last that was told.
    assert time.us64(1_700_000_000_000_000) == 5_000_001_000
    assert time.us64(0) == 5_000_001_000


def test_milliseconds_wrap_after_seven_weeks() -> None:
    time = BootTime()
    first = time.ms32(MODULUS - 5)
    assert time.ms32(5) - first == 10_000
    assert not time.rebooted


@pytest.mark.parametrize("uptime_ms", [10_000, 2_000_000, 4_000_000_000])
def test_a_reboot_shows_and_time_goes_on(uptime_ms: int) -> None:
    time = BootTime()
    before = time.ms32(uptime_ms)
    after = time.ms32(3_000)
    assert time.rebooted
    assert before <= after
    assert time.ms32(3_020) - after == 20_000


def test_datagrams_in_the_wrong_order_are_no_reboot() -> None:
    time = BootTime()
    time.ms32(10_000)
    assert time.ms32(9_900) == 9_900_000
    assert time.ms32(10_020) == 10_020_000
    assert not time.rebooted
