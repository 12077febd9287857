"""Benches around another bench: held to the pace of life, or stopped from another thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol, runtime_checkable

from benchtool.bench.bench import Bench, ContextBench, DeviceInfo, Listener, Readings, Subscribable
from benchtool.core.array_type import Array
from benchtool.core.errors import BenchtoolError, CommandRefused, RunInterrupted, StageError

PACING_INTERVAL_S = (
    0.02  # wall time of one read at most; assumed, a frame of a live chart has two of them
)
MAX_LAG_S = 0.5  # a clock that is off by more, as after a move, is set anew


class BenchWrapper(ContextBench):
    """Be another bench; a wrapper overrides what it changes."""

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
    """Be a bench whose reads take as long as they say, divided by `speed`.

    For people who watch. Only reading takes time: a virtual plate moves at once.

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
        self._due_s = clock()

    def halt(self) -> None:
        """Let the present read return at once: no motor turns here, and its owner then stops."""
        self._woken.set()

    def open(self) -> None:
        self._due_s = self._clock()
        self._bench.open()

    def read(self, timeout_s: float) -> Readings:
        speed = self.speed
        step_s = min(timeout_s, PACING_INTERVAL_S * speed)
        if abs(self._due_s - self._clock()) > MAX_LAG_S:
            self._due_s = self._clock()
        self._due_s += step_s / speed
        if (left_s := self._due_s - self._clock()) > 0.0:
            self._wait(self._woken, left_s)
        self._woken.clear()
        return self._bench.read(step_s)


STOP_SLICE_S = 0.05  # longest wait of one read, and so of a stop request


@runtime_checkable
class SupportsEmergencyStop(Protocol):
    """Be able to send zero from any thread."""

    def halt(self) -> None:
        """Send zero to every motor without waiting for the answer, from any thread.

        The owner of the bench may be in the middle of a command of its own.
        """


def send_halt(bench: Bench) -> None:
    """Send zero from any thread, where a bench can do that and its link is not lost."""
    if isinstance(bench, SupportsEmergencyStop):
        with suppress(BenchtoolError, OSError):
            bench.halt()


class StopRequested(RunInterrupted):
    """Requested stop; the owner of the bench decides whether it is used again."""


class PauseRequested(StopRequested):
    """Requested pause of a sweep, whose run stays open; elsewhere a stop."""


class StoppableBench(BenchWrapper):
    """Be another bench until somebody asks to stop.

    `request_stop` and `request_pause` send zero from the calling thread, where the bench can do
    that, and the owner's next call raises StopRequested or PauseRequested once. A pulse that the
    owner sends in the same moment is taken back, or refused by a device that the stop had reached
    before.

    Args:
        listener: is given every sample once: as it comes from a bench that publishes them, else
            with the read that brings it.
    """

    def __init__(self, bench: Bench, listener: Listener | None = None) -> None:
        super().__init__(bench)
        self._listener = listener
        if listener is not None and isinstance(bench, Subscribable):
            bench.subscribe(listener)
            self._listener = None
        self._requested: RunInterrupted | None = None

    def request_stop(self, reason: str) -> None:
        """Stop from any thread; the owner gets the reason."""
        self._requested = StopRequested(f"{reason}; zero was commanded to the motors")
        send_halt(self._bench)

    def request_pause(self, reason: str) -> None:
        """Pause from any thread, unless a stop is requested already; the owner gets the reason."""
        if self._requested is None:
            self._requested = PauseRequested(reason)
        send_halt(self._bench)

    def set_pwm(self, pwm_us: Array) -> None:
        self._raise_if_requested()
        try:
            self._bench.set_pwm(pwm_us)
        except CommandRefused:
            self._raise_if_requested()
            raise
        if self._requested is not None:
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
        # Not raised behind the read: no sample is lost to a request.
        readings = self._bench.read(min(timeout_s, STOP_SLICE_S))
        if self._listener is not None:
            self._listener(readings)
        return readings

    def _raise_if_requested(self) -> None:
        requested, self._requested = self._requested, None
        if requested is not None:
            raise requested
