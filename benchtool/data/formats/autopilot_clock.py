"""Give every message of a telemetry log a time on the autopilot's own clock.

A log's stamps say when the host got a message, and radio links deliver late and in bursts.
Attitude carries the autopilot's time since boot; where messages carry it, it is taken, and where
they do not, it is interpolated between attitudes by the host's stamps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.int64]

_WRAP_US = 1 << 32  # time_usec of SERVO_OUTPUT_RAW holds 32 bits


@dataclass(frozen=True, slots=True, eq=False)
class AutopilotClock:
    """Hold pairs of host stamps and autopilot times, both in microseconds and rising.

    Attributes:
        host_us, boot_us: (m,) of the attitudes; boot_us goes on over a reboot.
        starts: rows at which the autopilot booted anew.
        offsets_us: (m,) added to the autopilot's own count.
    """

    host_us: Times
    boot_us: Times
    starts: tuple[int, ...]
    offsets_us: Times

    @classmethod
    def of(cls, host_us: Times, boot_ms: NDArray[np.float64]) -> AutopilotClock:
        """Return the clock that attitudes tell, in the order in which the host got them."""
        own = (1000.0 * boot_ms).astype(np.int64)
        steps = np.diff(own, prepend=own[:1])
        # Late messages step back by less than a second; a reboot by all the time since the last.
        booted = np.flatnonzero(steps < -1_000_000)
        offsets = np.zeros(own.size, np.int64)
        for row in booted.tolist():
            waited = max(int(host_us[row] - host_us[row - 1]), 0)
            offsets[row:] = own[row - 1] + offsets[row - 1] + waited - own[row]
        return cls(host_us, own + offsets, tuple(booted.tolist()), offsets)

    def of_host(self, host_us: Times) -> Times:
        """Return the time of messages that carry none."""
        if not self.host_us.size:
            return host_us
        order = np.argsort(self.host_us, kind="stable")
        known, boot = self.host_us[order], np.maximum.accumulate(self.boot_us[order])
        inside = np.interp(host_us.astype(float), known.astype(float), boot.astype(float))
        before, after = np.minimum(host_us - known[0], 0), np.maximum(host_us - known[-1], 0)
        times: Times = np.rint(inside).astype(np.int64) + before + after
        return times

    def of_boot_ms(self, host_us: Times, boot_ms: NDArray[np.float64]) -> Times:
        """Return the time of messages that carry milliseconds since boot."""
        return (1000.0 * boot_ms).astype(np.int64) + self._offset(host_us)

    def of_wrapped_us(self, host_us: Times, count_us: NDArray[np.float64]) -> Times:
        """Return the time of messages that carry the lowest 32 bits of microseconds since boot."""
        near = self.of_host(host_us) - self._offset(host_us)
        ahead = (count_us.astype(np.int64) - near + _WRAP_US // 2) % _WRAP_US - _WRAP_US // 2
        times: Times = near + ahead + self._offset(host_us)
        return times

    def _offset(self, host_us: Times) -> Times:
        if not self.host_us.size:
            return np.zeros(host_us.size, np.int64)
        rows = np.searchsorted(np.maximum.accumulate(self.host_us), host_us, "right") - 1
        return self.offsets_us[np.clip(rows, 0, self.host_us.size - 1)]
