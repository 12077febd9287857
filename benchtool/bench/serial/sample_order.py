"""The order of samples: numbers that wrap, samples twice, too late, or not at all. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SEQUENCE_MODULUS = 1 << 16
TIME_MODULUS_US = 1 << 32

WINDOW = 64
"""A sample that comes so many places late is out of order; an earlier one is not believed at once.
A choice: radios and UDP reorder neighbours."""

LEAP = 4096
"""Neither is a sample so many places ahead: its number passed the checksum by chance, or the device
restarted. A choice, 4 s at 1 kHz."""


def signed_step(new: int, old: int, modulus: int) -> int:
    """Return how far a wrapping count went, negative where it went back (RFC 1982)."""
    half = modulus // 2
    return (new - old + half) % modulus - half


@dataclass(frozen=True, slots=True, eq=False)
class Sorted:
    """Hold which samples of a block are kept, in their order.

    Attributes:
        rows: (m,) indices into the block.
        time_us: (m,) their device time, unwrapped.
        lost: samples that are missing before or between them.
        repeated: samples left out because they came twice, or after a later one was handed on.
    """

    rows: NDArray[np.int64]
    time_us: NDArray[np.int64]
    lost: int
    repeated: int


class SampleOrder:
    """Put blocks of samples in order by their numbers and device times.

    Within a block samples are sorted. A gap longer than half of the numbers' range is told from a
    shorter one by the device time that has passed, once two neighbours have shown the period.
    """

    def __init__(self) -> None:
        self._newest: tuple[int, int] | None = None  # number and time as sent
        self._place = 0  # of the newest sample, counted on over all wraps
        self._time_us = 0  # of the newest sample, unwrapped
        self._period_us = 0.0
        self._doubted: tuple[int, int] | None = None

    def sort(self, stamps: NDArray[np.int64]) -> Sorted:
        """Sort a block with stamps (m, 2): number, device time in us, both wrapped."""
        return self._follow(stamps) or self._search(stamps.tolist())

    def _follow(self, stamps: NDArray[np.int64]) -> Sorted | None:
        """Take a block in which every sample is the next one; None where it is not so."""
        if self._newest is None or self._doubted is not None or not len(stamps):
            return None
        steps = np.diff(stamps, axis=0, prepend=np.array([self._newest]))
        steps_us = steps[:, 1] % TIME_MODULUS_US
        near = (steps_us > 0) & (steps_us < LEAP * self._period_us)
        if not (near & (steps[:, 0] % SEQUENCE_MODULUS == 1)).all():
            return None
        time_us = self._time_us + np.cumsum(steps_us)
        self._period_us = float(steps_us.mean())
        self._place += len(stamps)
        self._newest = int(stamps[-1, 0]), int(stamps[-1, 1])
        self._time_us = int(time_us[-1])
        return Sorted(np.arange(len(stamps)), time_us, 0, 0)

    def _search(self, stamps: list[list[int]]) -> Sorted:
        """Take a block sample by sample."""
        kept: dict[int, tuple[int, int]] = {}  # row and time by place
        handed_on = None if self._newest is None else self._place
        repeated = 0
        for row, (number, time_us) in enumerate(stamps):
            if self._newest is None:
                self._newest, self._time_us = (number, time_us), time_us
                step = step_us = 0
            else:
                step_us = signed_step(time_us, self._newest[1], TIME_MODULUS_US)
                step = self._step(number, step_us)
                agree = (step > 0) == (step_us > 0) and (step == 0) == (step_us == 0)
                if not (agree and -WINDOW < step < LEAP):
                    if not self._follows_doubted(number, time_us):
                        self._doubted = number, time_us
                        continue
                    if not (agree and step > 0):  # the device restarted: its time goes on from here
                        step, step_us = 1, max(1, round(self._period_us))
            self._doubted = None
            place, unwrapped_us = self._place + step, self._time_us + step_us
            if place in kept or (handed_on is not None and place <= handed_on):
                repeated += 1
                continue
            kept[place] = row, unwrapped_us
            if step > 0:
                if step == 1:
                    self._period_us = float(step_us)
                self._newest, self._place, self._time_us = (number, time_us), place, unwrapped_us
        order = sorted(kept)
        before = handed_on if handed_on is not None else order[0] - 1 if order else self._place
        rows = np.array([kept[place] for place in order], np.int64).reshape(-1, 2)
        lost = self._place - before - len(order)
        return Sorted(rows[:, 0], rows[:, 1], lost, repeated)

    def _step(self, number: int, step_us: int) -> int:
        """Return how many places a sample is from the newest one, by its number and its time."""
        assert self._newest is not None
        step = signed_step(number, self._newest[0], SEQUENCE_MODULUS)
        expected = step_us / self._period_us if self._period_us else step
        return step + SEQUENCE_MODULUS * round((expected - step) / SEQUENCE_MODULUS)

    def _follows_doubted(self, number: int, time_us: int) -> bool:
        """Whether a second sample stands for one that was not believed."""
        if self._doubted is None:
            return False
        step = signed_step(number, self._doubted[0], SEQUENCE_MODULUS)
        return 0 < step < WINDOW and signed_step(time_us, self._doubted[1], TIME_MODULUS_US) > 0
