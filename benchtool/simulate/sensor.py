"""How a sensor turns a quantity into readings: its own rate, white noise, a quantum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array


@dataclass(frozen=True, slots=True)
class Reader:
    """Read a quantity with white noise (sd) and a quantum, both in the quantity's unit.

    Zero noise, a zero quantum and a zero rate are exactly absent; rate 0 reads at every tick.
    """

    noise: float = 0.0
    quantum: float = 0.0
    rate_Hz: float = 0.0

    def read(self, true: Array, white: Array) -> Array:
        """Return the readings of `true`, given standard normal draws of its shape."""
        return quantised(true + self.noise * white if self.noise else true, self.quantum)

    def due(self, first_tick: int, ticks: int, stream_Hz: float) -> NDArray[np.bool_]:
        """Return at which of `ticks` stream ticks from `first_tick` on there is a new reading."""
        return due(first_tick, ticks, self.rate_Hz, stream_Hz)


def quantised(values: Array, quantum: float) -> Array:
    """Return `values` rounded to whole quanta; a zero quantum leaves them alone."""
    return np.round(values / quantum) * quantum if quantum else values


def due(first_tick: int, ticks: int, rate_Hz: float, stream_Hz: float) -> NDArray[np.bool_]:
    """Return at which stream ticks a sensor of its own rate has a new reading (ticks,).

    Tick k shows the conversion that ended in (k - 1, k] / stream_Hz. A sensor as fast as the
    stream, or of rate 0, has one at every tick.
    """
    if not rate_Hz or rate_Hz >= stream_Hz:
        return np.ones(ticks, bool)
    # The small addition keeps a conversion that ends exactly on a tick on that tick.
    edges = np.arange(first_tick - 1, first_tick + ticks, dtype=float) * (rate_Hz / stream_Hz)
    whole = np.floor(edges + 1e-9)
    fresh: NDArray[np.bool_] = whole[1:] > whole[:-1]
    return fresh
