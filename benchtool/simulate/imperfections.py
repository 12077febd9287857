"""Imperfections of a virtual bench; for each there is a value at which it is absent."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import isinf, isnan, nan
from typing import Annotated

import numpy as np
from annotated_types import Ge

from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.toml_text import FiniteTable
from benchtool.core.units import Array

NotNegative = Annotated[float, Ge(0.0)]

FROM_RIG = nan  # the value of the rig


@dataclass(frozen=True, slots=True, kw_only=True)
class Imperfections(FiniteTable):
    """Imperfections of a virtual bench; zero always means absent.

    The default nan ("rig") means the value of the rig: of its propulsion for the motor lag, of its
    plate for the backlash, else of the sensor. So a file contains only differences. The other
    defaults are assumptions about a hobby-class bench; none is measured.

    Attributes:
        *_noise_*, *_quantum_*: white noise (sd) and resolution of the readings of a sensor; of
            the load cell each sample and one count of its amplifier, of the speeds only turning
            rotors.
        motor_lag_s: first-order time constant of rotor speed.
        battery_resistance_ohm: internal resistance of the pack and its leads.
        battery_drop_V_per_Ah: decrease of the open-circuit voltage with the charge drawn.
        battery_excess_V: open-circuit voltage of the fresh pack above the nominal one.
        thrust_rate_Hz: conversions per second, 0 for one at every stream tick.
        drift_N_per_s: steady zero drift of the load cell since power-on.
        drift_walk_N_per_sqrt_s: random walk of the zero (sd after one second).
        start_offset_N: reading of the untared cell at power-on.
        vibration_N: amplitude at the frequency of each rotor's shaft, at its highest speed; it
            grows with the square of speed and reaches the samples aliased.
        esc_heating_K: steady temperature rise of the ESC at full throttle.
        esc_time_s: first-order time constant of that temperature.
    """

    motor_lag_s: NotNegative = FROM_RIG
    battery_resistance_ohm: NotNegative = 0.012
    battery_drop_V_per_Ah: NotNegative = 0.08
    battery_excess_V: float = 0.0
    thrust_noise_N: NotNegative = FROM_RIG
    thrust_quantum_N: NotNegative = FROM_RIG
    thrust_rate_Hz: NotNegative = FROM_RIG
    drift_N_per_s: float = 0.0
    drift_walk_N_per_sqrt_s: NotNegative = FROM_RIG
    start_offset_N: float = 0.35
    vibration_N: NotNegative = 0.03
    rpm_noise_rpm: NotNegative = FROM_RIG
    rpm_quantum_rpm: NotNegative = FROM_RIG
    voltage_noise_V: NotNegative = FROM_RIG
    voltage_quantum_V: NotNegative = FROM_RIG
    current_noise_A: NotNegative = FROM_RIG
    current_quantum_A: NotNegative = FROM_RIG
    esc_heating_K: NotNegative = 35.0
    esc_time_s: NotNegative = 40.0
    plate_noise_m: NotNegative = FROM_RIG
    plate_quantum_m: NotNegative = FROM_RIG
    backlash_m: NotNegative = FROM_RIG

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinf(value) or (isnan(value) and item.default is not FROM_RIG):
                raise InputError(f"imperfection {item.name} is {value:g}; allowed: finite numbers")

    @classmethod
    def none(cls) -> Imperfections:
        """Return a perfect bench: every imperfection is exactly absent."""
        return cls(**{item.name: 0.0 for item in fields(cls)})

    def resolve(self, rig: Rig) -> Imperfections:
        """Return the values for `rig`, with its own numbers instead of nan."""
        sensors = rig.sensors
        load_cell = sensors.get("thrust_N")
        rig_values = {
            "motor_lag_s": rig.propulsion.lag_s,
            "backlash_m": rig.plate.backlash_m,
            "thrust_rate_Hz": load_cell.rate_Hz if load_cell else 0.0,
            "drift_walk_N_per_sqrt_s": load_cell.walk if load_cell else 0.0,
        }
        for family, quantity, unit in FAMILIES:
            sensor = sensors.get(family)
            rig_values[f"{quantity}_noise_{unit}"] = sensor.noise if sensor else 0.0
            rig_values[f"{quantity}_quantum_{unit}"] = sensor.quantum if sensor else 0.0
        return replace(
            self,
            **{name: value for name, value in rig_values.items() if isnan(getattr(self, name))},
        )


FAMILIES = (  # sensors with noise and quantum: name, quantity and unit of the numbers
    ("thrust_N", "thrust", "N"),
    ("rpm", "rpm", "rpm"),
    ("voltage_V", "voltage", "V"),
    ("current_A", "current", "A"),
    ("plate_z_m", "plate", "m"),
)


@dataclass(frozen=True, slots=True)
class Reader:
    """Sensor model with white noise (sd) and quantum, in the unit of the quantity.

    Zero noise, a zero quantum and a zero rate are exactly absent; rate 0 reads at every tick.
    """

    noise: float = 0.0
    quantum: float = 0.0
    rate_Hz: float = 0.0

    def read(self, true: Array, draws: Array) -> Array:
        """Return the readings of `true`, given standard normal draws of its shape."""
        noisy = true + self.noise * draws if self.noise else true
        return np.round(noisy / self.quantum) * self.quantum if self.quantum else noisy


MAX_COUNT = 2**23  # end of a 24-bit two's complement converter (HX711 data sheet)
RATING_COUNTS = 2**22  # at the load cell rating by default: 2 mV/V at 5 V over +-20 mV (gain 128)
TARE_READINGS = 16  # conversions averaged by a tare: 0.2 s at 80 Hz, common in HX711 code; assumed


class LoadCell:
    """Load cell: converts force to counts and to thrust since the tare."""

    def __init__(self, flaws: Imperfections, rating_N: float) -> None:
        self.count_N = flaws.thrust_quantum_N or rating_N / RATING_COUNTS
        self.rate_Hz = flaws.thrust_rate_Hz
        self._flaws = flaws
        self._zero_N = 0.0
        self._walk_N = 0.0
        self._tare_offset_N = 0.0
        self._recent_N: Array = np.empty(0)

    @property
    def has_read(self) -> bool:
        """True if there is a conversion for a tare."""
        return len(self._recent_N) > 0

    def drifting_zero_N(self, time_s: Array, tick_s: float, draws: Array) -> Array:
        """Return the zero at every tick (m,): N; offset, steady drift and random walk."""
        flaws = self._flaws
        walk_N = self._walk_N + np.cumsum(draws) * (flaws.drift_walk_N_per_sqrt_s * np.sqrt(tick_s))
        self._walk_N = float(walk_N[-1])
        zero_N: Array = walk_N + flaws.drift_N_per_s * time_s + flaws.start_offset_N
        return zero_N

    def convert(self, force_N: Array, draws: Array) -> tuple[Array, Array]:
        """Return thrust since the tare (m,): N, and counts (m,) of each conversion."""
        noisy_N = force_N + self._tare_offset_N
        if self._flaws.thrust_noise_N:
            noisy_N = noisy_N + self._flaws.thrust_noise_N * draws
        counts = noisy_N / self.count_N
        if self._flaws.thrust_quantum_N:
            counts = np.round(counts)
        counts = np.clip(counts, -MAX_COUNT, MAX_COUNT - 1)
        reading_N = counts * self.count_N
        self._recent_N = np.concatenate([self._recent_N, reading_N])[-TARE_READINGS:]
        return reading_N - self._zero_N, counts

    def tare(self, before_N: float, after_N: float) -> None:
        """Set the mean of the last conversions as zero thrust.

        Args:
            before_N: reading of the model at rest before the tare: offset and drift.
            after_N: the same after it, with zero time since the tare. It remains in the reading:
                the tare offset of a model is the remaining error of a tare.
        """
        self._tare_offset_N += before_N - after_N
        self._zero_N = float(np.mean(self._recent_N)) - after_N


TILT_FEED_RAD_S = 0.2  # of the tilt axis; a rig defines only the linear feed; assumed


class Axis:
    """Axis that moves at constant feed, with backlash.

    Attributes:
        reported: position that the stage reports.
        true: position of the plate. Equal to `reported` after an approach from farther, as in a
            sweep and at the zero measurement; otherwise nearer by at most the backlash.
    """

    def __init__(self, feed: float, start: float, backlash: float = 0.0) -> None:
        self.target = self.reported = self.true = start
        self._feed = feed
        self._backlash = backlash

    @property
    def moving(self) -> bool:
        """True until the stage reaches its target."""
        return self.reported != self.target

    def advance(self, elapsed_s: Array) -> tuple[Array, Array]:
        """Return reported and true positions (m,) after these times, and store the last ones.

        The target is constant, so the motion is monotonic and the clipping of the true position is
        exact.
        """
        if not self.moving:
            ones = np.ones_like(elapsed_s)
            return self.reported * ones, self.true * ones
        remaining = self.target - self.reported
        travelled = np.minimum(self._feed * elapsed_s, abs(remaining))
        reported = np.where(
            travelled >= abs(remaining),
            self.target,
            self.reported + np.copysign(travelled, remaining),
        )
        true = np.clip(self.true, reported - self._backlash, reported)
        self.reported, self.true = float(reported[-1]), float(true[-1])
        return reported, true


class BacklashState:
    """State of a load cell with play of constant width, as caused by dry friction.

    The initial state is that after an unloading.
    """

    def __init__(self, half_width_N: float) -> None:
        self._half_N = half_width_N
        self._reading_N = half_width_N

    def follow(self, load_N: Array) -> Array:
        """Return the side (m,) of the play after each load: +1 from below, -1 from above.

        The reading of the load cell is the load minus side times half the width.
        """
        reading_N, half_N = self._reading_N, self._half_N
        side = np.empty(len(load_N))
        for row, load in enumerate(load_N.tolist()):
            reading_N = min(max(reading_N, load - half_N), load + half_N)
            side[row] = (load - reading_N) / half_N
        self._reading_N = reading_N
        return side
