"""Device time on the host's clock, and detection of host pauses."""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.bench import DeviceInfo
from benchtool.core.errors import HostSuspended, ReadingsLate
from benchtool.core.units import Array

WINDOW_S = 10.0  # wall time of the delay minimum; quartz drifts by 0.5 ms (50 ppm) in it; assumed
MAX_SLEW_RATE = 2e-4  # correction, seconds per second: four times a poor quartz's drift; assumed

# The same if delays have grown by more than jitter: ceramic resonators are off by 0.5 %, and a
# backlog must grow instead of passing for drift; both assumed.
DRIFT_SLEW, JITTER_S = 0.01, 0.02

INITIAL_SLEW_RATE = 0.5  # for too early readings; below 1, so host time is monotonic; assumed


class DeviceClock:
    """Conversion of device time to host time.

    A line arrives no sooner than it was sent, so arrival minus device time is the offset of the
    clocks plus a delay that is never negative. The estimate is the minimum over a sliding window.
    It changes freely before the first returned time, and later so slowly that times never decrease.
    Delays are wall time; `speed` is the seconds of both clocks per wall second.
    """

    def __init__(self, speed: float = 1.0) -> None:
        self._window_s = WINDOW_S * speed
        self._offset_s: float | None = None
        self._window_start_s = 0.0
        self._present_s = self._previous_s = inf
        self._last_device_s = 0.0
        self._newest: tuple[float, float] | None = None  # newest device time, its offset: s

    def update(self, device_time_us: int, arrived_s: float) -> None:
        """Update the offset from a line with this stamp (unwrapped), received at a host time.

        That is the time at which the line was received, not at which it was read.
        """
        device_s = device_time_us * 1e-6
        delay_s = arrived_s - device_s
        if device_s - self._window_start_s > self._window_s:
            self._window_start_s = device_s
            self._previous_s, self._present_s = self._present_s, delay_s
        self._present_s = min(self._present_s, delay_s)
        target_s = min(self._present_s, self._previous_s)
        if self._offset_s is None or self._newest is None:
            self._offset_s = target_s
        else:
            error_s = target_s - self._offset_s
            slew = DRIFT_SLEW if error_s > JITTER_S else MAX_SLEW_RATE
            slew = INITIAL_SLEW_RATE if error_s < 0.0 else slew
            step_s = slew * max(device_s - self._last_device_s, 0.0)
            self._offset_s += min(max(error_s, -step_s), step_s)
        self._last_device_s = max(device_s, self._last_device_s)

    def host_time_s(self, device_time_us: NDArray[np.int64] | Array) -> Array:
        """Return the host times (m,): s of device times (m,): us."""
        device_s = np.asarray(device_time_us, float) * 1e-6
        offset_s = self._offset_s or 0.0
        from_s, from_offset_s = self._newest or (0.0, offset_s)
        if len(device_s) and (newest_s := max(device_s.tolist())) > from_s:
            self._newest = (newest_s, offset_s)
            if offset_s != from_offset_s:  # spread over the time since the last returned time
                offsets_s = np.interp(device_s, [from_s, newest_s], [from_offset_s, offset_s])
                return device_s + offsets_s
        return device_s + from_offset_s


MAX_GAP_S = 1.0  # a longer pause ends a run for every watchdog of a device; assumed


class HostGapDetector:
    """Detector of host pauses: longest time between two rounds of a polling loop.

    Lost acknowledgements also delay a command, but without a pause of the host.
    """

    def __init__(self) -> None:
        self.begin(0.0)

    def begin(self, now_s: float) -> None:
        self._last_s, self.longest_s = now_s, 0.0

    def update(self, now_s: float) -> None:
        self.longest_s = max(self.longest_s, now_s - self._last_s)
        self._last_s = now_s


class HostPauseMonitor:
    """Comparison of the actual with the expected end of a wait of the host.

    The commands of a host that is later than the device's watchdog have expired.
    """

    def __init__(self, identity: DeviceInfo, now_s: float) -> None:
        self._limit_s = min(identity.watchdog_s, MAX_GAP_S)
        self._speed = identity.speed
        self._due_s = now_s

    def expect(self, now_s: float, wall_s: float = 0.0, bench_s: float = 0.0) -> None:
        """Set the expected end of a wait, given in wall time or in bench time."""
        self._due_s = now_s + wall_s * self._speed + bench_s

    def find_late_error(self, now_s: float) -> HostSuspended | None:
        """Return an error if the host is late by more than the limit, else None."""
        late_s = (now_s - self._due_s) / self._speed
        return HostSuspended(late_s, self._limit_s) if late_s > self._limit_s else None


# Largest age of readings, or lead of their stamps, and longest time of either before the run ends
# (wall time); assumed: no watchdog of a device and no check of benchtool waits longer.
MAX_READING_AGE_S = 1.0


class ReadingAgeMonitor:
    """Age of readings when they are read.

    One block may be old because it waited for a read. If readings stay old, the host reads more
    slowly than the bench sends, or the bench's clock does not run at its stated speed.
    """

    def __init__(self, identity: DeviceInfo) -> None:
        self._speed = identity.speed
        self._since_s: float | None = None
        self._age_s = 0.0

    def update(self, time_s: Array, now_s: float) -> None:
        """Record the times (m,): s of readings that are read now."""
        if not len(time_s):
            return
        self._age_s = (now_s - float(time_s[-1])) / self._speed
        if abs(self._age_s) <= MAX_READING_AGE_S:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = now_s

    @property
    def late_error(self) -> ReadingsLate | None:
        """The error of the last readings if they were late, else None."""
        if self._since_s is None:
            return None
        return ReadingsLate(self._age_s, MAX_READING_AGE_S, self._speed)

    def stays_late(self, now_s: float) -> bool:
        """Return whether readings have been late for too long."""
        return (
            self._since_s is not None and (now_s - self._since_s) / self._speed > MAX_READING_AGE_S
        )
