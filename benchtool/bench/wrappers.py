"""Wrapper of a bench for the page: stop requests from another thread, pacing of a virtual clock."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from typing import Protocol, runtime_checkable

from benchtool.bench.bench import (
    Bench,
    ContextBench,
    DeviceInfo,
    Listener,
    Readings,
    StreamingBench,
)
from benchtool.core.errors import BenchtoolError, CommandRefused, RunInterrupted, StageError
from benchtool.core.units import Array

PACING_INTERVAL_S = 0.02  # longest wall time of one read; half a frame of a live chart, assumed
MAX_LAG_S = 0.5  # a larger lag, as after a plate move, resets the schedule of reads
STOP_SLICE_S = 0.05  # longest wait of one read, and so the longest delay of a stop request


@runtime_checkable
class SupportsEmergencyStop(Protocol):
    """Bench that can send zero throttle from any thread."""

    def halt(self) -> None:
        """Send zero to every motor from any thread, without waiting for the acknowledgement.

        The bench's owner may be waiting for a command meanwhile.
        """


def send_halt(bench: Bench) -> None:
    """Send zero from any thread if the bench supports that; ignore a lost link."""
    if isinstance(bench, SupportsEmergencyStop):
        with suppress(BenchtoolError, OSError):
            bench.halt()


class StopRequested(RunInterrupted):
    """Stop requested; the bench's owner decides whether the bench is used again."""


class PauseRequested(StopRequested):
    """Requested pause of a sweep, whose run stays open; elsewhere a stop."""


class StoppableBench(ContextBench):
    """Wrapper that accepts stop requests from any thread.

    `request_stop` and `request_pause` send zero from the calling thread if the bench supports that.
    The owner's next call raises StopRequested or PauseRequested once. A pulse width that the owner
    commands at the same time is followed by a stop, or rejected by a device that has already
    received the zero.

    Args:
        listener: gets every sample once: on arrival if the bench publishes samples, else with the
            read that returns it.
        speed: seconds of a virtual clock per wall second, to which reads are slowed; may be changed
            at any time. A virtual plate moves at once. 0 for a bench in real time.
    """

    def __init__(self, bench: Bench, listener: Listener | None = None, speed: float = 0.0) -> None:
        self._bench = bench
        self._listener = listener
        if listener is not None and isinstance(bench, StreamingBench):
            bench.subscribe(listener)
            self._listener = None
        self._request: RunInterrupted | None = None
        self.speed = speed
        self._woken = threading.Event()
        self._next_read_s = 0.0

    @property
    def identity(self) -> DeviceInfo:
        return self._bench.identity

    def now_s(self) -> float:
        return self._bench.now_s()

    def open(self) -> None:
        self._next_read_s = time.monotonic()
        self._bench.open()

    def close(self) -> None:
        self._bench.close()

    def stop(self) -> None:
        self._bench.stop()

    def set_rate(self, rate_Hz: float) -> None:
        self._bench.set_rate(rate_Hz)

    def request_stop(self, reason: str) -> None:
        """Stop from any thread; the owner's next call raises the reason."""
        self._request = StopRequested(f"{reason}; zero was commanded to the motors")
        self._halt()

    def request_pause(self, reason: str) -> None:
        """Pause from any thread unless a stop is pending; the owner's next call raises it."""
        if self._request is None:
            self._request = PauseRequested(reason)
        self._halt()

    def _halt(self) -> None:
        """Send zero, and end a paced read early."""
        self._woken.set()
        send_halt(self._bench)

    def set_pwm(self, pwm_us: Array) -> None:
        self._raise_if_requested()
        try:
            self._bench.set_pwm(pwm_us)
        except CommandRefused:
            self._raise_if_requested()
            raise
        if self._request is not None:
            self._bench.stop()
            self._raise_if_requested()

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        self._raise_if_requested()
        try:
            self._bench.move_plate(z_m, x_m, tilt_rad)
        except (CommandRefused, StageError):
            self._raise_if_requested()
            raise

    def tare(self) -> None:
        self._raise_if_requested()
        self._bench.tare()

    def read(self, timeout_s: float) -> Readings:
        self._raise_if_requested()
        # Not checked after the read, so that a request loses no sample.
        readings = self._bench.read(self._pace(min(timeout_s, STOP_SLICE_S)))
        if self._listener is not None:
            self._listener(readings)
        return readings

    def _raise_if_requested(self) -> None:
        request, self._request = self._request, None
        if request is not None:
            raise request

    def _pace(self, timeout_s: float) -> float:
        """Return the duration of the next read, after waiting for it on a virtual clock."""
        if not (speed := self.speed):
            return timeout_s
        step_s = min(timeout_s, PACING_INTERVAL_S * speed)
        if abs(self._next_read_s - time.monotonic()) > MAX_LAG_S:
            self._next_read_s = time.monotonic()
        self._next_read_s += step_s / speed
        if (left_s := self._next_read_s - time.monotonic()) > 0.0:
            self._woken.wait(left_s)
        self._woken.clear()
        return step_s
