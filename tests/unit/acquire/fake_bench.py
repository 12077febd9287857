"""A bench of one rotor on a virtual clock, that does as a test tells it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.bench import DeviceInfo, Readings
from benchtool.data.columns import find_channel

Array = NDArray[np.float64]

RATE_HZ = 100.0
NAMES = ("pwm1_us", "rpm1", "thrust_N", "thrust_raw", "temperature_degC", "voltage_V")


class FakeBench:
    """Speed follows the pulse at once; thrust is k rpm^2 plus an offset that a tare takes away.

    Attributes:
        log: commands in order, with their time.
        offset_N: what the load cell shows at rest; `tares` says how much of it a tare leaves.
        at: functions called once their time has come, to break something.
        shown_rpm: makes what the tachometer shows (m,) of times and true speeds, (m,) each.
    """

    def __init__(self, *, left_N: float = 0.0, idle_rpm: float = 0.0) -> None:
        self.log: list[tuple[str, object]] = []
        self.offset_N = 0.3
        self.left_N = left_N
        self.idle_rpm = idle_rpm
        self.temperature_degC = 20.0
        self.at: list[tuple[float, Callable[[], None]]] = []
        self.shown_rpm: Callable[[Array, Array], Array] = lambda time_s, rpm: rpm
        self._now_s = 0.0
        self._pwm_us = 1000.0
        self._given = 0

    @property
    def identity(self) -> DeviceInfo:
        return DeviceInfo(
            address="fake:1",
            device_id="fake-1",
            firmware="fake",
            protocol="fake-1",
            channels=tuple(find_channel(name) for name in NAMES),
            rate_Hz=RATE_HZ,
            n_rotors=1,
            simulated=False,
            moves_plate=True,
        )

    def now_s(self) -> float:
        return self._now_s

    def open(self) -> None:
        self.log.append(("open", None))

    def close(self) -> None:
        self.log.append(("close", None))

    def set_pwm(self, pwm_us: Array) -> None:
        self._pwm_us = float(pwm_us[0])
        self.log.append(("pwm", self._pwm_us))

    def stop(self) -> None:
        self._pwm_us = 1000.0
        self.log.append(("stop", None))

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        assert self._pwm_us == 1000.0
        self._now_s += 0.5
        self.log.append(("plate", z_m))

    def tare(self) -> None:
        assert self._pwm_us == 1000.0
        self.offset_N = self.left_N
        self.log.append(("tare", None))

    def set_rate(self, rate_Hz: float) -> None:
        raise NotImplementedError

    def read(self, timeout_s: float) -> Readings:
        self._now_s += timeout_s
        for when_s, act in list(self.at):
            if self._now_s >= when_s:
                self.at.remove((when_s, act))
                act()
        first, self._given = self._given, int(self._now_s * RATE_HZ + 1e-6)
        time_s = np.arange(first + 1, self._given + 1) / RATE_HZ
        rpm = max(0.0, 10.0 * (self._pwm_us - 1000.0)) or self.idle_rpm
        thrust = 1e-7 * rpm**2
        # A small ripple, the same in every run.
        ripple = 1e-3 * np.sin(2.0 * np.pi * 7.3 * time_s)
        seen = np.full(time_s.shape, rpm)
        if rpm > self.idle_rpm:
            seen = self.shown_rpm(time_s, seen + 5.0 * np.sin(2.0 * np.pi * 11.7 * time_s))
        columns = (
            self._pwm_us,
            seen,
            thrust + self.offset_N + ripple,
            1000.0 * (thrust + ripple) + 5000.0,
            self.temperature_degC,
            11.0,
        )
        values = np.column_stack([np.broadcast_to(column, time_s.shape) for column in columns])
        return Readings(time_s, 1e6 * time_s, values.astype(float).reshape(len(time_s), -1))

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *reason: object) -> None:
        self.close()
