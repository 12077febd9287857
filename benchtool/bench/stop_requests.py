"""Requests to stop a run, by signals and from other threads.

Signals are deferred during a run and ignored while it is closed.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, Protocol, Self, runtime_checkable

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

# Ctrl-C, termination request, closed terminal, Ctrl-Break (Windows); skipped where not defined.
SIGNAL_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
SHUTDOWN_TIMEOUT_S = 10.0  # signals are ignored for so long; closing takes about 1 s; assumed

_STOP_REASONS = {
    "SIGINT": "stopped by Ctrl-C",
    "SIGBREAK": "stopped by Ctrl-Break",
    "SIGHUP": "stopped because the terminal was closed",
}


class _SignalHandlers:
    """Base class that installs signal handlers and restores the previous ones."""

    def __init__(self) -> None:
        self._previous: dict[signal.Signals, Any] = {}

    def _install_handlers(self, new_handler: Callable[[int, FrameType | None], None]) -> None:
        """Install a handler in the main thread; ignored signals stay ignored (nohup)."""
        if threading.current_thread() is not threading.main_thread():
            return
        for name in SIGNAL_NAMES:
            number = getattr(signal, name, None)
            if number is None or signal.getsignal(number) in (signal.SIG_IGN, None):
                continue
            self._previous[number] = signal.signal(number, new_handler)

    def restore(self) -> None:
        """Restore the previous signal handlers."""
        while self._previous:
            number, handler = self._previous.popitem()
            signal.signal(number, handler)


class StopSignals(_SignalHandlers):
    """Scope that defers signals, from `install` to `restore`.

    A deferred signal is raised by the next `raise_if_requested`. It interrupts neither the writing
    of a sample nor a stop command. Inside `interruptible` a signal raises immediately; use it for
    long blocking waits. After the first signal, later ones never raise immediately.

    Python allows signal handlers in the main thread only. Elsewhere only exceptions end a run.
    """

    def __init__(self, note: Callable[[str], None]) -> None:
        super().__init__()
        self._note = note  # receives the reason immediately, even if the error is caught later
        self._stop_reason: str | None = None
        self._raises_immediately = False

    def install(self) -> None:
        if threading.current_thread() is threading.main_thread():
            self._stop_reason, self._raises_immediately = None, False
        self._install_handlers(self._handle)

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Raise signals immediately inside this context; raise a deferred signal on entry."""
        self.raise_if_requested()
        self._raises_immediately = True
        try:
            self.raise_if_requested()
            yield
        finally:
            self._raises_immediately = False

    def request(self, reason: str) -> None:
        """Record a reason to stop, from any thread; only the first one counts."""
        self._stop_reason = self._stop_reason or reason
        self._note(self._stop_reason)

    def raise_if_requested(self) -> None:
        """Raise RunInterrupted if a signal was received; every later call raises it again."""
        if self._stop_reason is not None:
            raise RunInterrupted(f"{self._stop_reason}; zero was commanded to the motors")

    def _handle(self, number: int, frame: FrameType | None) -> None:
        name = signal.Signals(number).name
        is_repeated = self._stop_reason is not None
        self.request(_STOP_REASONS.get(name, f"stopped by {name}"))
        if self._raises_immediately and not is_repeated:
            self._raises_immediately = False
            self.raise_if_requested()


class ClosingSignals(_SignalHandlers):
    """Context manager that ignores signals while a run is closed.

    Enter it before the guarded bench, whose own handlers replace these while it is open. Before
    `ignore_signals` the previous handlers are called, then signals are ignored; one that arrives
    `SHUTDOWN_TIMEOUT_S` or more after the first ignored signal raises KeyboardInterrupt.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._ignores_signals = False
        self._first_signal_s: float | None = None

    def ignore_signals(self) -> None:
        """Ignore signals from now on, until the run is closed."""
        self._ignores_signals = True

    def __enter__(self) -> Self:
        self._install_handlers(self._handle)
        return self

    def __exit__(self, *_: object) -> None:
        self.restore()

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if not self._ignores_signals:
            previous = self._previous[signal.Signals(number)]
            if callable(previous):
                previous(number, frame)
            else:
                signal.signal(number, previous)
                signal.raise_signal(number)
            return
        now_s = self._clock()
        if self._first_signal_s is None:
            self._first_signal_s = now_s
            # os.write, because the handler may interrupt a print.
            os.write(
                2,
                f"benchtool: the run is being closed; to exit without closing it, press Ctrl-C "
                f"again after {SHUTDOWN_TIMEOUT_S:g} s\n".encode(),
            )
        elif now_s - self._first_signal_s >= SHUTDOWN_TIMEOUT_S:
            raise KeyboardInterrupt


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

    The listener gets every sample once: on arrival if the bench publishes samples, else with the
    read that returns it.
    """

    def __init__(self, bench: Bench, listener: Listener | None = None, speed: float = 0.0) -> None:
        self._bench = bench
        self._listener = listener
        if listener is not None and isinstance(bench, StreamingBench):
            bench.subscribe(listener)
            self._listener = None
        self._request: RunInterrupted | None = None
        # Seconds of a virtual clock per wall second, to which reads are slowed; may be changed at
        # any time. A virtual plate moves at once. 0 for a bench in real time
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
