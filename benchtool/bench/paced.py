"""A bench on a virtual clock, held to the pace of life or a multiple of it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.bench import Bench, Identity, Readings
from benchtool.bench.transport.opened import Opened

Array = NDArray[np.float64]

SLICE_S = 0.02
"""Wall time of one read at most; a choice, a frame of a live chart has two of them."""

LATE_S = 0.5
"""A clock that is off by more, as after a move of the plate, is set anew instead of caught up."""


class PacedBench(Opened):
    """Be a bench whose reads take as long as they say, divided by `speed`.

    For people who watch. Only reading takes time: a virtual plate moves at once.

    Args:
        bench: on a virtual clock.
        speed: bench seconds per wall second; may be changed at any time.
        clock: monotonic wall clock in seconds.
        wait: waits at most so long for an event.
    """

    def __init__(
        self,
        bench: Bench,
        speed: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[threading.Event, float], object] = threading.Event.wait,
    ) -> None:
        self.speed = speed
        self._bench = bench
        self._clock = clock
        self._wait = wait
        self._woken = threading.Event()
        self._due_s = clock()

    def halt(self) -> None:
        """Let the present read return at once: no motor turns here, and its owner then stops."""
        self._woken.set()

    @property
    def identity(self) -> Identity:
        return self._bench.identity

    def now_s(self) -> float:
        return self._bench.now_s()

    def open(self) -> None:
        self._due_s = self._clock()
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
        speed = self.speed
        step_s = min(timeout_s, SLICE_S * speed)
        if abs(self._due_s - self._clock()) > LATE_S:
            self._due_s = self._clock()
        self._due_s += step_s / speed
        if (left_s := self._due_s - self._clock()) > 0.0:
            self._wait(self._woken, left_s)
        self._woken.clear()
        return self._bench.read(step_s)
