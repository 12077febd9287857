"""Lay device time on the host's clock: the smallest delay seen says how far the two are apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WINDOW_S = 10.0
"""How long a smallest delay counts; a guess: quartz clocks drift 50 ppm apart, 0.5 ms in it."""

MAX_SLEW = 2e-4
"""Fastest correction, seconds per second: four times the drift of a poor quartz (a guess), so that
host time follows the device and never runs backwards."""


class DeviceClock:
    """Turn device time into host time.

    A line arrives no sooner than it was sent, so arrival minus device time is the offset of the
    clocks plus a delay that is never negative. The minimum over a sliding window is the estimate.
    """

    def __init__(self) -> None:
        self._offset_s: float | None = None
        self._window_start_s = 0.0
        self._present_s = self._previous_s = np.inf
        self._last_device_s = 0.0

    def learn(self, device_time_us: int, arrived_s: float) -> None:
        """Note that a line stamped `device_time_us` (unwrapped) arrived at `arrived_s`."""
        device_s = device_time_us * 1e-6
        delay_s = arrived_s - device_s
        if device_s - self._window_start_s > WINDOW_S:
            self._window_start_s = device_s
            self._previous_s, self._present_s = self._present_s, delay_s
        self._present_s = min(self._present_s, delay_s)
        target_s = min(self._present_s, self._previous_s)
        if self._offset_s is None:
            self._offset_s = target_s
        else:
            step_s = MAX_SLEW * max(device_s - self._last_device_s, 0.0)
            self._offset_s += float(np.clip(target_s - self._offset_s, -step_s, step_s))
        self._last_device_s = device_s

    def host_time_s(self, device_time_us: NDArray[np.int64]) -> Array:
        """Return the host times (m,): s of device times (m,): us."""
        host_s: Array = device_time_us.astype(np.float64) * 1e-6 + (self._offset_s or 0.0)
        return host_s
