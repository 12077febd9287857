"""Device time on the host's clock, and whether the host ran."""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.bench import DeviceInfo
from benchtool.core.array_type import Array
from benchtool.core.errors import HostSuspended, ReadingsLate

WINDOW_S = 10.0  # wall time of a smallest delay: quartz drifts by 0.5 ms (50 ppm); assumed
MAX_SLEW_RATE = (
    2e-4  # usual correction, seconds per second: four times the drift of a poor quartz; assumed
)

DRIFT_SLEW, JITTER_S = 0.01, 0.02
"""The same where delays have grown by more than jitter makes: ceramic resonators are off by 0.5 %,
and a backlog must grow, not pass for a drift. Choices."""

INITIAL_SLEW_RATE = (
    0.5  # the same for too early readings; below 1: host time never runs back; assumed
)


class DeviceClock:
    """Turn device time into host time.

    A line arrives no sooner than it was sent, so arrival minus device time is the offset of the
    clocks plus a delay that is never negative. The minimum over a sliding window is the estimate.
    It changes freely until a time is returned, and so slowly later that times never run backwards.

    Args:
        speed: of both clocks, seconds per second of wall time: delays are of wall time.
    """

    def __init__(self, speed: float = 1.0) -> None:
        self._window_s = WINDOW_S * speed
        self._offset_s: float | None = None
        self._window_start_s = 0.0
        self._present_s = self._previous_s = inf
        self._last_device_s = 0.0
        self._returned: tuple[float, float] | None = None  # newest device time, its offset: s

    def learn(self, device_time_us: int, arrived_s: float) -> None:
        """Note that a line stamped `device_time_us` (unwrapped) arrived at `arrived_s`.

        Args:
            arrived_s: when the host received it, not when it came to look at it.
        """
        device_s = device_time_us * 1e-6
        delay_s = arrived_s - device_s
        if device_s - self._window_start_s > self._window_s:
            self._window_start_s = device_s
            self._previous_s, self._present_s = self._present_s, delay_s
        self._present_s = min(self._present_s, delay_s)
        target_s = min(self._present_s, self._previous_s)
        if self._offset_s is None or self._returned is None:
            self._offset_s = target_s
        else:
            error_s = target_s - self._offset_s
            slew = (
                INITIAL_SLEW_RATE
                if error_s < 0.0
                else DRIFT_SLEW
                if error_s > JITTER_S
                else MAX_SLEW_RATE
            )
            step_s = slew * max(device_s - self._last_device_s, 0.0)
            self._offset_s += min(max(error_s, -step_s), step_s)
        self._last_device_s = max(device_s, self._last_device_s)

    def host_time_s(self, device_time_us: NDArray[np.int64]) -> Array:
        """Return the host times (m,): s of device times (m,): us."""
        device_s: Array = device_time_us.astype(np.float64) * 1e-6
        offset_s = self._offset_s or 0.0
        before_s, before_offset_s = self._returned or (0.0, offset_s)
        if len(device_s) and (newest_s := float(device_s.max())) > before_s:
            self._returned = (newest_s, offset_s)
            # What was learnt since the last time returned spreads over the time since then.
            return device_s + np.interp(device_s, [before_s, newest_s], [before_offset_s, offset_s])
        return device_s + before_offset_s


MAX_GAP_S = 1.0  # a pause above this ends a run whatever the device's watchdog allows; assumed


class HostGapDetector:
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


class HostPauseMonitor:
    """Compare when the host came back from waiting with when it had to.

    A host that is late by more than the device's watchdog has let its orders lapse.

    Args:
        identity: watchdog in wall time, speed of the bench's clock.
    """

    def __init__(self, identity: DeviceInfo, now_s: float) -> None:
        self._limit_s = min(identity.watchdog_s, MAX_GAP_S)
        self._speed = identity.speed
        self._due_s = now_s

    def expect(self, now_s: float, wall_s: float = 0.0, bench_s: float = 0.0) -> None:
        """Expect the host back after a wait, given in wall time or on the bench's clock."""
        self._due_s = now_s + wall_s * self._speed + bench_s

    def late(self, now_s: float) -> HostSuspended | None:
        """Return the error of a host that comes back too late, None otherwise."""
        late_s = (now_s - self._due_s) / self._speed
        return HostSuspended(late_s, self._limit_s) if late_s > self._limit_s else None


MAX_READING_AGE_S = 1.0
"""Readings may be so old when they are read, or stamped so far ahead, and be so for as long before
it ends a run (wall time); a choice: no device's watchdog and no check of ours waits longer."""


class ReadingAgeMonitor:
    """Compare when readings were made with when they were read.

    One block may be old: it waited while nobody read. Where they stay old, the host reads more
    slowly than the bench sends, or the clock of the bench does not run as it states.

    Args:
        identity: speed of the bench's clock.
    """

    def __init__(self, identity: DeviceInfo) -> None:
        self._speed = identity.speed
        self._since_s: float | None = None
        self._age_s = 0.0

    def note(self, time_s: Array, now_s: float) -> None:
        """Note the times (m,): s of readings that are read now."""
        if not len(time_s):
            return
        self._age_s = (now_s - float(time_s[-1])) / self._speed
        if abs(self._age_s) <= MAX_READING_AGE_S:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s

    @property
    def late(self) -> ReadingsLate | None:
        """The error of readings that were late when they were read last, None otherwise."""
        if self._since_s is None:
            return None
        return ReadingsLate(self._age_s, MAX_READING_AGE_S, self._speed)

    def stays_late(self, now_s: float) -> bool:
        """Return whether readings have been late for too long."""
        return (
            self._since_s is not None and (now_s - self._since_s) / self._speed > MAX_READING_AGE_S
        )
