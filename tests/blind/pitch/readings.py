"""What the bench's instruments show: play, wobble, bias, scale, noise and quanta."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tests.blind.pitch.plant import Plant
from tests.blind.pitch.sheet import PARKED_M, SHEET, Sheet

Array = NDArray[np.float64]


def quantised(value: float, quantum: float) -> float:
    """Return the nearest multiple of a quantum."""
    return round(value / quantum) * quantum


class Instruments:
    """Show what encoder and gyro would show without noise and quanta.

    The encoder's shaft remembers on which side of its play it lies; feed it every sample.
    """

    def __init__(self, plant: Plant, shaft_rad: float = 0.0) -> None:
        self._plant = plant
        self.shaft_rad = shaft_rad

    def angle(self, true_rad: float) -> float:
        """Return the encoder's angle: rad."""
        plant = self._plant
        play = plant.encoder_play_rad
        self.shaft_rad = min(max(self.shaft_rad, true_rad - play), true_rad + play)
        turned = self.shaft_rad + plant.encoder_phase_rad
        return self.shaft_rad + plant.encoder_wobble_rad * math.sin(turned)

    def rate(self, true_rad_s: float) -> float:
        """Return the gyro's rate: rad/s."""
        return self._plant.gyro_scale * true_rad_s + self._plant.gyro_bias_rad_s


def plate_readings(plate_m: Array, rng: np.random.Generator, sheet: Sheet = SHEET) -> Array:
    """Return what the plate's gauge shows (n,): m; exactly PARKED_M where it is parked."""
    noisy = plate_m + sheet.sd_z * rng.standard_normal(len(plate_m))
    return np.where(plate_m >= PARKED_M, PARKED_M, noisy)
