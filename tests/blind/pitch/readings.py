"""What the bench's instruments show: play, wobble, bias, scale, noise and quanta."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tests.blind.pitch.plant import Plant
from tests.blind.pitch.sheet import PARKED_M, SHEET, Sheet

Array = NDArray[np.float64]


def quantised(value: float, quantum: float) -> float:
    """Return the nearest multiple of a quantum."""
    return round(value / quantum) * quantum


class Instruments:
    """Read encoder, gyro and rotor speeds, with noise drawn beforehand."""

    def __init__(
        self, plant: Plant, n: int, rng: np.random.Generator, sheet: Sheet = SHEET
    ) -> None:
        self._plant, self._sheet = plant, sheet
        self._theta = (sheet.sd_theta * rng.standard_normal(n)).tolist()
        self._gyro = (sheet.sd_gyro * rng.standard_normal(n)).tolist()
        self._speed = (sheet.sd_rpm * rng.standard_normal((n, 2))).tolist()
        self._shaft = 0.0

    def theta(self, k: int, true_rad: float) -> float:
        """Return the encoder's angle at sample k: rad."""
        plant = self._plant
        play = plant.encoder_play_rad
        if play:
            self._shaft = min(max(self._shaft, true_rad - play), true_rad + play)
        else:
            self._shaft = true_rad
        shown = self._shaft
        if plant.encoder_wobble_rad:
            shown += plant.encoder_wobble_rad * np.sin(shown + plant.encoder_phase_rad)
        return quantised(shown + self._theta[k], self._sheet.q_theta)

    def gyro(self, k: int, true_rad_s: float) -> float:
        """Return the gyro's rate at sample k: rad/s."""
        plant = self._plant
        shown = plant.gyro_scale * true_rad_s + plant.gyro_bias_rad_s
        return quantised(shown + self._gyro[k], self._sheet.q_gyro)

    def speeds(self, k: int, true_rpm: tuple[float, float]) -> tuple[float, float]:
        """Return both rotors' speeds at sample k: rpm."""
        noise, quantum = self._speed[k], self._sheet.q_rpm
        return (
            quantised(true_rpm[0] + noise[0], quantum),
            quantised(true_rpm[1] + noise[1], quantum),
        )


def plate_readings(plate_m: Array, rng: np.random.Generator, sheet: Sheet = SHEET) -> Array:
    """Return what the plate's gauge shows (n,): m; exactly PARKED_M where it is parked."""
    noisy = plate_m + sheet.sd_z * rng.standard_normal(len(plate_m))
    return np.where(plate_m >= PARKED_M, PARKED_M, noisy)
