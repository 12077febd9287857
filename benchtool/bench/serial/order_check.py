"""The device's check of an order: whether it comes late, and whether the device is armed. Pure."""

from __future__ import annotations

from math import inf

from benchtool.bench.serial.sample_order import TIME_MODULUS_US

LAST_NUMBER = TIME_MODULUS_US - 1
"""Largest number of an order; they grow from the hello on and never start over."""

OLDEST_S = 0.5
"""Orders are refused from this age on: a host waits 5 x 100 ms for an answer and then commands a
stop, so that an older order has been given up."""

LATE = "late: "
"""How the reason of such a refusal begins."""


def too_old(reason: str) -> bool:
    """Return whether an order was refused for its age."""
    return reason.startswith(LATE) and " ms old" in reason


class OrderCheck:
    """Know which orders are late.

    An order carries a number that grows and the last device time that its host has read. Its age is
    the time since then on the device's own clock, so that neither the host's clock nor the delay
    of the way to the host matters.

    Args:
        speed: device seconds per wall second; the age limit is wall time.

    Attributes:
        armed: whether orders to turn or to move are obeyed.
        number: of the last order that was carried out.
    """

    def __init__(self, speed: float = 1.0) -> None:
        self.armed = False
        self.number = 0
        self._speed = speed
        self._stopped_us = -inf

    def greet(self, number: int, now_us: int) -> None:
        """Begin anew with a host that says hello."""
        self.stop(now_us)
        self.number = number

    def stop(self, now_us: int) -> None:
        """Note a stop: what was ordered before it is refused from now on."""
        self.armed = False
        self._stopped_us = now_us

    def refusal(self, number: int, time: str, now_us: int) -> str:
        """Return why an order is refused as late, nothing when it may be carried out.

        Args:
            number: of the order.
            time: device time that the order repeats, as it came.
            now_us: device time, not wrapped.
        """
        if number <= self.number:
            return f"{LATE}number {number} comes after {self.number}"
        if not (time.isdecimal() and len(time) <= 10 and int(time) < TIME_MODULUS_US):
            return f"{time!r} is no device time; repeat that of the last sample or answer"
        age_us = (now_us - int(time)) % TIME_MODULUS_US
        age_s = age_us / 1e6 / self._speed
        if age_s > OLDEST_S:
            return f"{LATE}{1000.0 * age_s:.0f} ms old; limit {1000.0 * OLDEST_S:.0f} ms"
        if now_us - age_us < self._stopped_us:
            return f"{LATE}given before the last stop"
        return ""
