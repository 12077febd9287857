"""The seam below the protocol: something that carries bytes, with a timeout."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

NAP_S = 0.005
"""Longest sleep between two reads. A pseudo-terminal holds 0.2 s of a 1 kHz stream; a nap with one
read costs a twelfth of the processor time that a wake-up per line does (measured, see
tests/benchmarks/bench_link.py)."""


def first_bytes(take: Callable[[], bytes], timeout_s: float) -> bytes:
    """Return what `take` finds, looking again after short sleeps for at most `timeout_s`."""
    deadline_s = time.monotonic() + timeout_s
    while True:
        left_s = deadline_s - time.monotonic()
        time.sleep(min(NAP_S, max(left_s, 0.0)))
        data = take()
        if data or left_s <= NAP_S:
            return data


class Transport(Protocol):
    """Carry bytes; every foreign exception leaves as one of our link errors."""

    @property
    def baud(self) -> int | None:
        """Bits per second that the host's end was opened with, None where there is none."""
        ...

    def open(self) -> None:
        """Open the port for this process alone and throw away what is old.

        Raises:
            PortBusy, PortDenied, NoDevice: why it cannot be had.
        """
        ...

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, waiting at most `timeout_s` for the first byte; maybe nothing.

        Raises:
            LinkLost: the other end went away.
        """
        ...

    def write(self, data: bytes) -> None:
        """Send all of `data`.

        Raises:
            LinkLost: the other end went away or takes nothing.
        """
        ...

    def close(self) -> None:
        """Give the port back; safe to call twice, never raises."""
        ...
