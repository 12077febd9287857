"""A load cell with its amplifier: zero that wanders, noise, whole counts, a tare in the device."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.simulate.imperfections import Imperfections
from benchtool.simulate.sensor import due

COUNT_TOP = 2**23
"""Counts of a 24-bit two's complement converter end here (HX711 data sheet, Avia Semiconductor)."""

RATING_COUNTS = 2**22
"""Counts at the cell's rating when no quantum is stated: 2 mV/V at 5 V over +-20 mV (gain 128)."""

TARE_READINGS = 16
"""A tare averages so many conversions: 0.2 s at 80 Hz; an assumption, common in HX711 code."""


class LoadCell:
    """Turn the force on the cell into counts and into thrust since the tare.

    Args:
        flaws: noise, quantum, rate, offset and drift; nothing left open.
        rating_N: of the cell, which scales the counts where no quantum is stated.
    """

    def __init__(self, flaws: Imperfections, rating_N: float) -> None:
        self.count_N = flaws.thrust_quantum_N or rating_N / RATING_COUNTS
        self.rate_Hz = flaws.thrust_rate_Hz
        self._flaws = flaws
        self._zero_N = 0.0
        self._walk_N = 0.0
        self._carried_N = 0.0
        self._recent_N: Array = np.empty(0)

    @property
    def has_read(self) -> bool:
        """Whether there is a conversion that a tare could average."""
        return len(self._recent_N) > 0

    def due(self, first_tick: int, ticks: int, stream_Hz: float) -> NDArray[np.bool_]:
        """Return at which stream ticks a conversion has ended (ticks,)."""
        return due(first_tick, ticks, self.rate_Hz, stream_Hz)

    def wander_N(self, time_s: Array, tick_s: float, white: Array) -> Array:
        """Return the zero (m,): N at every tick, since power-on: offset, creep and random walk."""
        flaws = self._flaws
        walk_N = self._walk_N + np.cumsum(white) * (flaws.drift_walk_N_per_sqrt_s * np.sqrt(tick_s))
        self._walk_N = float(walk_N[-1])
        zero_N: Array = walk_N + flaws.drift_N_per_s * time_s + flaws.start_offset_N
        return zero_N

    def convert(self, force_N: Array, white: Array) -> tuple[Array, Array]:
        """Return thrust since the tare (m,): N, and counts (m,), of that many conversions."""
        shown_N = force_N + self._carried_N
        if self._flaws.thrust_noise_N:
            shown_N = shown_N + self._flaws.thrust_noise_N * white
        counts = shown_N / self.count_N
        if self._flaws.thrust_quantum_N:
            counts = np.round(counts)
        counts = np.clip(counts, -COUNT_TOP, COUNT_TOP - 1)
        read_N = counts * self.count_N
        self._recent_N = np.concatenate([self._recent_N, read_N])[-TARE_READINGS:]
        return read_N - self._zero_N, counts

    def tare(self, before_N: float, after_N: float) -> None:
        """Take the last conversions as zero thrust.

        Args:
            before_N: the model's own reading at rest just before: an offset, and drift so far.
            after_N: the same just after, with the time since the tare at zero; it stays on the
                reading, since a model's tare offset is what a tare leaves behind.
        """
        self._carried_N += before_N - after_N
        self._zero_N = float(np.mean(self._recent_N)) - after_N
