"""Numbers that wrap: what is lost, what comes twice, what comes late, and what is not believed."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.bench.serial.frames import (
    MAX_LEAP,
    SEQUENCE_MODULUS,
    TIME_MODULUS_US,
    SampleOrder,
    signed_step,
)

PERIOD_US = 6100  # 164 Hz


def stamp(place: int) -> tuple[int, int]:
    """Return number and time of the sample at a place of a steady stream."""
    return place % SEQUENCE_MODULUS, place * PERIOD_US % TIME_MODULUS_US


class Stream:
    """Sort blocks, given as places of a steady stream."""

    def __init__(self, *first: int) -> None:
        self.order = SampleOrder()
        self.lost = self.repeated = 0
        self.first = first[0]
        self.take(*first)

    def take(self, *places: int) -> list[int]:
        return self.take_stamps(*map(stamp, places))

    def take_stamps(self, *stamps: tuple[int, int]) -> list[int]:
        """Return rows; their times have gone on without a jump."""
        found = self.order.sort(stamps)
        self.lost += found.lost
        self.repeated += found.repeated
        self.time_us = found.time_us
        return list(np.arange(len(stamps))[found.rows])


@pytest.mark.parametrize(
    ("new", "old", "step"),
    [(5, 3, 2), (3, 5, -2), (0, 65535, 1), (65535, 0, -1), (40_000, 5, -25_541), (7, 7, 0)],
)
def test_a_step_is_signed(new, old, step):
    assert signed_step(new, old, SEQUENCE_MODULUS) == step


def test_samples_twice_are_left_out_and_counted():
    stream = Stream(10, 11, 12)
    assert stream.take(13, 13, 14, 14) == [0, 2]
    assert stream.take(14, 15) == [1]
    assert stream.take(12, 13) == []
    assert (stream.lost, stream.repeated) == (0, 5)


@pytest.mark.parametrize(
    ("places", "rows"), [((12, 13, 14), [0, 1, 2]), ((13, 12, 15, 14), [1, 0, 3, 2])]
)
def test_within_a_block_samples_are_sorted(places, rows):
    stream = Stream(10, 11)
    assert stream.take(*places) == rows
    assert stream.time_us == [place * PERIOD_US for place in sorted(places)]
    assert (stream.lost, stream.repeated) == (0, 0)


def test_the_first_block_is_sorted_as_well():
    stream = Stream(65_537, 65_536, 65_535)
    assert stream.time_us == [(65_535 + i) * PERIOD_US for i in range(3)]
    assert (stream.lost, stream.repeated) == (0, 0)


def test_a_sample_that_comes_after_its_block_stays_lost():
    stream = Stream(10, 11)
    assert stream.take(13) == [0]
    assert stream.take(12, 14) == [1]
    assert (stream.lost, stream.repeated) == (1, 1)


@pytest.mark.parametrize("gap", [2, 700, MAX_LEAP - 1, 20000, 40000, 65535, 65536, 65537, 200000])
def test_a_gap_of_any_length_is_counted(gap):
    stream = Stream(65_530, 65_531)
    rows = sum(len(stream.take(65_531 + gap + i)) for i in range(5))
    assert stream.lost == gap + 4 - rows
    assert rows >= 4
    if gap * PERIOD_US < TIME_MODULUS_US // 2:
        assert stream.time_us == [(65_535 + gap) * PERIOD_US]


def test_one_sample_of_a_wild_number_is_not_believed():
    stream = Stream(10, 11)
    wild = [(30_000, 12 * PERIOD_US), (12, 4_000_000_000), (9_000, 9_000 * PERIOD_US)]
    for number, sample in enumerate(wild):
        assert stream.take_stamps(sample) == []
        assert stream.take(12 + number) == [0]
    assert stream.time_us == [14 * PERIOD_US]
    assert (stream.lost, stream.repeated) == (0, 0)


def test_a_wild_number_is_not_confirmed_by_one_of_the_same_time():
    stream = Stream(10, 11)
    assert stream.take_stamps((30_000, 12 * PERIOD_US)) == []
    assert stream.take_stamps((30_001, 12 * PERIOD_US)) == []
    assert stream.take(12) == [0]


def test_a_device_that_restarted_goes_on_in_time():
    stream = Stream(100_000, 100_001)
    assert stream.take(0) == []
    assert stream.take(1, 2) == [0, 1]
    assert stream.time_us == [(100_002 + i) * PERIOD_US for i in range(2)]
    assert stream.lost == 0


def test_a_stream_that_was_switched_off_and_on_lost_nothing():
    stream = Stream(10, 11)
    assert stream.take_stamps((12, 11 * PERIOD_US + 90_000_000)) == [0]
    assert stream.take_stamps((13, 12 * PERIOD_US + 90_000_000)) == [0]
    assert stream.lost == 0


def test_random_losses_doubles_and_exchanges_add_up(rng):
    stream = Stream(64_000, 64_001)
    handed_on = 2
    place = 64_001
    for _ in range(300):
        block = place + 1 + np.arange(rng.integers(1, 40))
        place = int(block[-1])
        block = block[rng.random(len(block)) > 0.2]
        block = rng.permutation(np.concatenate([block, block[rng.random(len(block)) < 0.1]]))
        before_us = stream.time_us[-1] if stream.time_us else 0
        handed_on += len(stream.take(*block.tolist()))
        if stream.time_us:
            assert (np.diff([before_us, *stream.time_us]) > 0).all()
    stream.take(place + 1)
    assert stream.lost + handed_on + 1 == place + 1 - 64_000 + 1
