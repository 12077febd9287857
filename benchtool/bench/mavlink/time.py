"""An autopilot's time since boot, from stamps of 32 and 64 bits that wrap, jump and are missing."""

from __future__ import annotations

import numpy as np

from benchtool.bench.serial.device_clock import DeviceClock

MODULUS = 1 << 32

REBOOT_US = 2_000_000
"""A clock that goes back by more has begun anew; reordered datagrams are off by less. A choice."""

LEAP_US = 600_000_000
"""A clock that leaps ahead by more has begun anew as well: seen through a wrap, back is ahead. A
link that was silent for so long has ended its run before. A choice."""

EPOCH_US = 1 << 50
"""Stamps above (35 years) count since 1970, not since boot; MAVLink allows both, told by size."""


class BootTime:
    """Unwrap stamps of every kind onto one count of microseconds.

    `SERVO_OUTPUT_RAW.time_usec` holds 32 bits and wraps after 71.6 minutes, `time_boot_ms` after
    49.7 days. A message without a stamp happened at the last one.

    Attributes:
        last_us: of the newest stamp.
        rebooted: whether the clock has begun anew; time goes on from the last stamp then.
    """

    def __init__(self) -> None:
        self.last_us = 0
        self.rebooted = False
        self._anchored = False
        self._offset_us = 0

    def us32(self, stamp: int) -> int:
        """Return a stamp of 32 bits in us, unwrapped."""
        return self._nearest(stamp, MODULUS, whole=False)

    def ms32(self, stamp: int) -> int:
        """Return a stamp of 32 bits in ms as us, unwrapped."""
        return self._nearest(1000 * stamp, 1000 * MODULUS)

    def us64(self, stamp: int) -> int:
        """Return a stamp of 64 bits; one since 1970 says nothing about the boot."""
        return self.last_us if stamp == 0 or stamp >= EPOCH_US else self._nearest(stamp, 1 << 64)

    def _nearest(self, stamp: int, modulus: int, whole: bool = True) -> int:
        if not self._anchored and (whole or not self.last_us):
            # The first stamp that cannot have wrapped says how long it has been up.
            self._anchored = whole
            self.last_us = stamp
            return stamp
        step = (stamp + self._offset_us - self.last_us + modulus // 2) % modulus - modulus // 2
        if not -REBOOT_US <= step <= LEAP_US:
            self.rebooted = True
            # What comes now lies behind what came before: no time of a recording runs backwards.
            self._offset_us -= step
            step = 0
        self.last_us = max(self.last_us, self.last_us + step)
        return self.last_us if step > 0 else self.last_us + step


class CompanionTime:
    """Lay the stamps of another component on the autopilot's time.

    It has a clock of its own. What it stamps arrives no sooner than it was sent, so that the
    smallest delay lately seen tells how far the two clocks are apart.
    """

    def __init__(self) -> None:
        self._boot, self._clock = BootTime(), DeviceClock()

    def us(self, stamp_ms: int, arrived_us: int) -> int:
        """Return a stamp of 32 bits in ms as the autopilot's us.

        Args:
            stamp_ms: of the component.
            arrived_us: the autopilot's time when it arrived.
        """
        sent_us = self._boot.ms32(stamp_ms)
        if self._boot.rebooted:
            self._boot, self._clock = BootTime(), DeviceClock()
            sent_us = self._boot.ms32(stamp_ms)
        self._clock.learn(sent_us, 1e-6 * arrived_us)
        at_s = self._clock.host_time_s(np.array([sent_us], np.int64))[0]
        return min(round(1e6 * float(at_s)), arrived_us)
