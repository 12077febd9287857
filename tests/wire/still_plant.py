"""A plant without physics: readings that follow the commands exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.serial.hello import Hello
from benchtool.core.channel import Channel

Array = NDArray[np.float64]


class StillPlant:
    """Two motors, a load cell with a value every second tick, a plate that moves 1 mm per tick."""

    channels = (
        Channel("pwm1_us", "pwm_us"),
        Channel("pwm2_us", "pwm_us"),
        Channel("thrust_N", "N"),
        Channel("plate_z_m", "m"),
        Channel("voltage_V", "V"),
    )

    def __init__(self, rate_Hz: float = 100.0) -> None:
        self.rate_Hz = rate_Hz
        self.pwm_us: Array = np.full(2, 1000.0)
        self.z_m = self.target_z_m = 0.1
        self.zero_N = 0.0
        self.voltage_V = 12.0
        self._tick = 0

    @property
    def plate_moving(self) -> bool:
        return abs(self.z_m - self.target_z_m) > 1e-9

    def set_rate(self, rate_Hz: float) -> None:
        self.rate_Hz = rate_Hz

    def command_pwm(self, pwm_us: Array) -> None:
        self.pwm_us = np.array(pwm_us, float)

    def command_plate(self, z_m: float, x_m: float, tilt_rad: float) -> None:
        self.target_z_m = z_m

    def halt_plate(self) -> None:
        self.target_z_m = self.z_m

    def tare(self) -> None:
        self.zero_N = self._thrust_N()

    def advance(self, n: int) -> Array:
        rows = np.empty((n, 5))
        for row in rows:
            self._tick += 1
            self.z_m += float(np.clip(self.target_z_m - self.z_m, -1e-3, 1e-3))
            thrust_N = self._thrust_N() - self.zero_N if self._tick % 2 else np.nan
            row[:] = *self.pwm_us, thrust_N, round(self.z_m, 6), self.voltage_V
        return rows

    def _thrust_N(self) -> float:
        return round(float(self.pwm_us.sum() - 2000.0) * 0.01, 4)


def still_hello(**changes: object) -> Hello:
    """Return what the still device says of itself."""
    facts: dict[str, object] = {
        "device_id": "bench-0042",
        "firmware": "example 1.0",
        "n_rotors": 2,
        "channels": StillPlant.channels,
        "channel_rates_Hz": (100.0, 100.0, 50.0, 100.0, 100.0),
        "rate_Hz": 100.0,
        "limits": {
            "thrust_N": 30.0,
            "pwm_us": 1900.0,
            "voltage_min_V": 9.0,
            "plate_z_min_m": 0.05,
            "plate_z_max_m": 0.5,
        },
        "pwm_stop_us": 1000.0,
        "pwm_idle_us": 1050.0,
        "frame_bytes": 60,
        "facts": {"load_cell": "HX711 no 7"},
    }
    return Hello(**{**facts, **changes})  # type: ignore[arg-type]
