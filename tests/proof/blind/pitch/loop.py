"""A bench under its own controller: one part of a record."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.signal import lfilter

from tests.proof.blind.pitch.beam import STEP_S
from tests.proof.blind.pitch.moving import STEPS, Moving, State
from tests.proof.blind.pitch.plant import Plant
from tests.proof.blind.pitch.programme import Programme
from tests.proof.blind.pitch.sheet import (
    INTEGRAL_LIMIT_RAD_S,
    PARKED_M,
    PULSE_LIMITS_US,
    SHEET,
    Sheet,
)

Array = NDArray[np.float64]


TURNED_OVER_RAD = math.radians(45.0)


class TurnedOver(Exception):
    """The beam left the range in which the bench is run; nobody would keep such a recording."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Hold one part of a record and what really went on in it."""

    table: pd.DataFrame  # the columns of the CSV
    states: list[State]  # where everything was at each row
    plate_m: Array  # (n,) plate distance without the gauge's noise
    wake_Nm: Array  # (n,) torque of the wake
    capped: int  # physics steps in which the ground effect was capped


def wake_torque(rng: np.random.Generator, n: int, sd_Nm: float, tau_s: float) -> Array:
    """Draw a stationary Ornstein-Uhlenbeck torque at n physics steps: N m."""
    keep = math.exp(-STEP_S / tau_s)
    kicks = rng.standard_normal(n)
    kicks[1:] *= math.sqrt(1.0 - keep * keep)
    return sd_Nm * np.asarray(lfilter([1.0], [1.0, -keep], kicks))


def clipped(pulse_us: float) -> int:
    """Keep a pulse within the controller's limits."""
    low, high = PULSE_LIMITS_US
    return int(min(max(pulse_us, low), high))


def closed_loop(
    plant: Plant, programme: Programme, rng: np.random.Generator, sheet: Sheet = SHEET
) -> Part:
    """Run one part: the controller reads, sends whole pulses, and the bench moves on."""
    n = len(programme)
    sensors, wakes, gauge = rng.spawn(3)
    instruments = Instruments(plant)
    theta_noise = (sheet.sd_theta * sensors.standard_normal(n)).tolist()
    gyro_noise = (sheet.sd_gyro * sensors.standard_normal(n)).tolist()
    speed_noise = (sheet.sd_rpm * sensors.standard_normal((2, n))).tolist()
    wake = wake_torque(wakes, n * STEPS, plant.wake_sd_Nm, plant.wake_tau_s)
    wake_rows = wake.reshape(n, STEPS).tolist()
    bench = Moving(plant, sheet)
    bench.rest((sheet.base_pwm, sheet.base_pwm))
    references = programme.theta_ref_rad.tolist()
    collectives = programme.collective_us.tolist()
    dithers = programme.dither_us.tolist()
    plates = programme.plate_m.tolist()
    total = 0.0
    rows: list[tuple[float, float, int, int, float, float]] = []
    states: list[State] = []
    for k in range(n):
        states.append(bench.state())
        theta = quantised(instruments.angle(bench.theta_rad) + theta_noise[k], sheet.q_theta)
        gyro = quantised(instruments.rate(bench.rate_rad_s) + gyro_noise[k], sheet.q_gyro)
        rpm1, rpm2 = (
            quantised(speed + noise[k], sheet.q_rpm)
            for speed, noise in zip(bench.speed_rpm, speed_noise, strict=True)
        )
        error = references[k] - theta
        total += error * sheet.dt
        total = min(max(total, -INTEGRAL_LIMIT_RAD_S), INTEGRAL_LIMIT_RAD_S)
        asked = sheet.kp * error + sheet.ki * total - sheet.kd * gyro
        asked = round(asked + dithers[k])
        pulses = (clipped(collectives[k] + asked), clipped(collectives[k] - asked))
        rows.append((theta, gyro, *pulses, rpm1, rpm2))
        bench.advance(pulses, plates[k], wake_rows[k], k * sheet.dt)
        if abs(bench.theta_rad) > TURNED_OVER_RAD:
            raise TurnedOver(f"the beam stands at {math.degrees(bench.theta_rad):.0f} deg")
    theta_column, gyro_column, pwm1, pwm2, rpm1_column, rpm2_column = zip(*rows, strict=True)
    table = pd.DataFrame(
        {
            "t": np.round(np.arange(n) * sheet.dt, 6),
            "theta_ref": programme.theta_ref_rad,
            "theta": np.array(theta_column),
            "gyro": np.array(gyro_column),
            "pwm1": np.array(pwm1),
            "pwm2": np.array(pwm2),
            "rpm1": np.array(rpm1_column),
            "rpm2": np.array(rpm2_column),
            "plate_z": plate_readings(programme.plate_m, gauge, sheet),
        }
    )
    return Part(table, states, programme.plate_m, wake[::STEPS], bench.capped)


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
