"""Wrappers of a bench: real-time pacing, and stop requests from another thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol, runtime_checkable

from benchtool.bench.bench import Bench, ContextBench, DeviceInfo, Listener, Readings, Subscribable
from benchtool.core.errors import BenchtoolError, CommandRefused, RunInterrupted, StageError
from benchtool.core.units import Array

PACING_INTERVAL_S = 0.02  # longest wall time of one read; half a frame of a live chart, assumed
MAX_LAG_S = 0.5  # a larger lag, as after a plate move, resets the schedule of reads


class BenchWrapper(ContextBench):
    """Wrapper that forwards every call; subclasses override what they change."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    @property
    def identity(self) -> DeviceInfo:
        return self._bench.identity

    def now_s(self) -> float:
        return self._bench.now_s()

    def open(self) -> None:
        self._bench.open()

    def close(self) -> None:
        self._bench.close()

    def set_pwm(self, pwm_us: Array) -> None:
        self._bench.set_pwm(pwm_us)

    def stop(self) -> None:
        self._bench.stop()

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        self._bench.move_plate(z_m, x_m, tilt_rad)

    def tare(self) -> None:
        self._bench.tare()

    def set_rate(self, rate_Hz: float) -> None:
        self._bench.set_rate(rate_Hz)

    def read(self, timeout_s: float) -> Readings:
        return self._bench.read(timeout_s)


class PacedBench(BenchWrapper):
    """Wrapper that slows reads to real time, divided by `speed`.

    Only reads take time; a virtual plate moves at once.

    Args:
        speed: bench seconds per wall second; may be changed at any time.
    """

    def __init__(
        self,
        bench: Bench,
        speed: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[threading.Event, float], object] = threading.Event.wait,
    ) -> None:
        super().__init__(bench)
        self.speed = speed
        self._clock = clock
        self._wait = wait
        self._woken = threading.Event()
        self._next_read_s = clock()

    def halt(self) -> None:
        """End the present read early. No motor turns here, and the owner then calls `stop`."""
        self._woken.set()

    def open(self) -> None:
        self._next_read_s = self._clock()
        self._bench.open()

    def read(self, timeout_s: float) -> Readings:
        speed = self.speed
        step_s = min(timeout_s, PACING_INTERVAL_S * speed)
        if abs(self._next_read_s - self._clock()) > MAX_LAG_S:
            self._next_read_s = self._clock()
        self._next_read_s += step_s / speed
        if (left_s := self._next_read_s - self._clock()) > 0.0:
            self._wait(self._woken, left_s)
        self._woken.clear()
        return self._bench.read(step_s)


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


class StoppableBench(BenchWrapper):
    """Wrapper that accepts stop requests from any thread.

    `request_stop` and `request_pause` send zero from the calling thread if the bench supports that.
    The owner's next call raises StopRequested or PauseRequested once. A pulse width that the owner
    commands at the same time is followed by a stop, or rejected by a device that has already
    received the zero.

    Args:
        listener: gets every sample once: on arrival if the bench publishes samples, else with the
            read that returns it.
    """

    def __init__(self, bench: Bench, listener: Listener | None = None) -> None:
        super().__init__(bench)
        self._listener = listener
        if listener is not None and isinstance(bench, Subscribable):
            bench.subscribe(listener)
            self._listener = None
        self._request: RunInterrupted | None = None

    def request_stop(self, reason: str) -> None:
        """Stop from any thread; the owner's next call raises the reason."""
        self._request = StopRequested(f"{reason}; zero was commanded to the motors")
        send_halt(self._bench)

    def request_pause(self, reason: str) -> None:
        """Pause from any thread unless a stop is pending; the owner's next call raises it."""
        if self._request is None:
            self._request = PauseRequested(reason)
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
        readings = self._bench.read(min(timeout_s, STOP_SLICE_S))
        if self._listener is not None:
            self._listener(readings)
        return readings

    def _raise_if_requested(self) -> None:
        request, self._request = self._request, None
        if request is not None:
            raise request
