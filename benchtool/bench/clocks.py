"""Device time on the host's clock, and whether the host ran."""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.bench import Identity
from benchtool.core.array import Array
from benchtool.core.errors import HostPaused

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
        self._present_s = self._previous_s = inf
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
            self._offset_s += min(max(target_s - self._offset_s, -step_s), step_s)
        self._last_device_s = device_s

    def host_time_s(self, device_time_us: NDArray[np.int64]) -> Array:
        """Return the host times (m,): s of device times (m,): us."""
        host_s: Array = device_time_us.astype(np.float64) * 1e-6 + (self._offset_s or 0.0)
        return host_s


LONGEST_S = 1.0
"""A pause above this ends a run whatever the device's watchdog allows; a choice."""


class Gaps:
    """Notice how long a loop that waits only briefly did not run.

    A command may take long because the line loses answers; its host ran all the while.

    Attributes:
        longest_s: longest time between two rounds since `begin`.
    """

    def __init__(self) -> None:
        self.begin(0.0)

    def begin(self, now_s: float) -> None:
        self._last_s, self.longest_s = now_s, 0.0

    def note(self, now_s: float) -> None:
        self.longest_s = max(self.longest_s, now_s - self._last_s)
        self._last_s = now_s


class HostPause:
    """Compare when the host came back from waiting with when it had to.

    A host that is late by more than the device's watchdog has let its orders lapse.

    Args:
        identity: watchdog in wall time, speed of the bench's clock.
    """

    def __init__(self, identity: Identity, now_s: float) -> None:
        self._limit_s = min(identity.watchdog_s, LONGEST_S)
        self._speed = identity.speed
        self._due_s = now_s

    def expect(self, now_s: float, wall_s: float = 0.0, bench_s: float = 0.0) -> None:
        """Expect the host back after a wait, given in wall time or on the bench's clock."""
        self._due_s = now_s + wall_s * self._speed + bench_s

    def late(self, now_s: float) -> HostPaused | None:
        """Return the error of a host that comes back too late, None otherwise."""
        late_s = (now_s - self._due_s) / self._speed
        return HostPaused(late_s, self._limit_s) if late_s > self._limit_s else None
