"""What makes a virtual bench as imperfect as a real one, each with a value where it is absent."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import isinf, isnan, nan
from typing import Annotated

import numpy as np
from annotated_types import Ge
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.schedule import due_ticks
from benchtool.core.toml_text import FiniteTable

NotNegative = Annotated[float, Ge(0.0)]

OPEN = nan  # a number that is left to the rig


@dataclass(frozen=True, slots=True, kw_only=True)
class Imperfections(FiniteTable):
    """State how far a virtual bench is from a perfect one; zero means absent, everywhere.

    A value left open (nan) is the rig's own number, so that a file needs to name only what differs.
    The defaults of the others are assumptions about a hobby-class bench; none is measured.

    Attributes:
        motor_lag_s: first-order time constant of rotor speed; open: the rig's propulsion.
        battery_resistance_ohm: internal resistance of the pack and its leads.
        battery_drop_V_per_Ah: fall of the open-circuit voltage with the charge drawn.
        battery_excess_V: open-circuit voltage of the fresh pack above the nominal one.
        thrust_noise_N: white noise of each load-cell sample (sd); open: the rig's sensor.
        thrust_quantum_N: one count of the load-cell amplifier; open: the rig's sensor.
        thrust_rate_Hz: conversions per second, 0 for one at every stream tick; open: the rig's
            sensor.
        drift_N_per_s: steady creep of the load cell's zero since power-on.
        drift_walk_N_per_sqrt_s: random walk of the zero (sd after one second); open: the rig's
            sensor.
        start_offset_N: reading of the untared cell at power-on.
        vibration_N: amplitude at the frequency of each rotor's shaft, at its highest speed; it
            grows with the square of speed and reaches the samples aliased.
        rpm_noise_rpm: white noise of a turning rotor's speed reading (sd); open: the rig's sensor.
        rpm_quantum_rpm: step of the speed reading; open: the rig's sensor.
        voltage_noise_V, voltage_quantum_V: of the voltage reading; open: the rig's sensor.
        current_noise_A, current_quantum_A: of the current reading; open: the rig's sensor.
        esc_heating_K: rise of the ESC's temperature at full throttle, after a long time.
        esc_time_s: first-order time constant of that temperature.
        plate_noise_m, plate_quantum_m: of the plate's distance reading; open: the rig's sensor.
        backlash_m: play of the plate when its direction changes; open: the rig's plate.
    """

    motor_lag_s: NotNegative = OPEN
    battery_resistance_ohm: NotNegative = 0.012
    battery_drop_V_per_Ah: NotNegative = 0.08
    battery_excess_V: float = 0.0
    thrust_noise_N: NotNegative = OPEN
    thrust_quantum_N: NotNegative = OPEN
    thrust_rate_Hz: NotNegative = OPEN
    drift_N_per_s: float = 0.0
    drift_walk_N_per_sqrt_s: NotNegative = OPEN
    start_offset_N: float = 0.35
    vibration_N: NotNegative = 0.03
    rpm_noise_rpm: NotNegative = OPEN
    rpm_quantum_rpm: NotNegative = OPEN
    voltage_noise_V: NotNegative = OPEN
    voltage_quantum_V: NotNegative = OPEN
    current_noise_A: NotNegative = OPEN
    current_quantum_A: NotNegative = OPEN
    esc_heating_K: NotNegative = 35.0
    esc_time_s: NotNegative = 40.0
    plate_noise_m: NotNegative = OPEN
    plate_quantum_m: NotNegative = OPEN
    backlash_m: NotNegative = OPEN

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinf(value) or (isnan(value) and item.default is not OPEN):
                raise InputError(f"imperfection {item.name} is {value:g}; give a finite number")

    @classmethod
    def none(cls) -> Imperfections:
        """Return a perfect bench: every imperfection exactly absent."""
        return cls(**{item.name: 0.0 for item in fields(cls)})

    def on(self, rig: Rig) -> Imperfections:
        """Return the numbers that hold on `rig`, with nothing left open."""
        sensors = rig.sensors
        cell = sensors.get("thrust_N")
        own = {
            "motor_lag_s": rig.propulsion.lag_s,
            "backlash_m": rig.plate.backlash_m,
            "thrust_rate_Hz": cell.rate_Hz if cell else 0.0,
            "drift_walk_N_per_sqrt_s": cell.walk if cell else 0.0,
        }
        for family, quantity, unit in FAMILIES:
            sensor = sensors.get(family)
            own[f"{quantity}_noise_{unit}"] = sensor.noise if sensor else 0.0
            own[f"{quantity}_quantum_{unit}"] = sensor.quantum if sensor else 0.0
        return replace(
            self, **{name: value for name, value in own.items() if isnan(getattr(self, name))}
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
    """Read a quantity with white noise (sd) and a quantum, both in the quantity's unit.

    Zero noise, a zero quantum and a zero rate are exactly absent; rate 0 reads at every tick.
    """

    noise: float = 0.0
    quantum: float = 0.0
    rate_Hz: float = 0.0

    def read(self, true: Array, white: Array) -> Array:
        """Return the readings of `true`, given standard normal draws of its shape."""
        return quantised(true + self.noise * white if self.noise else true, self.quantum)

    def due(self, first_tick: int, ticks: int, stream_Hz: float) -> NDArray[np.bool_]:
        """Return at which of `ticks` stream ticks from `first_tick` on there is a new reading."""
        return due_ticks(first_tick, ticks, self.rate_Hz, stream_Hz)


def quantised(values: Array, quantum: float) -> Array:
    """Return `values` rounded to whole quanta; a zero quantum leaves them alone."""
    return np.round(values / quantum) * quantum if quantum else values


COUNT_TOP = 2**23  # end of a 24-bit two's complement converter (HX711 data sheet)
RATING_COUNTS = 2**22  # at the cell's rating by default: 2 mV/V at 5 V over +-20 mV (gain 128)
TARE_READINGS = 16  # conversions averaged by a tare: 0.2 s at 80 Hz, common in HX711 code; assumed


class LoadCell:
    """Turn the force on the cell into counts and into thrust since the tare."""

    def __init__(self, flaws: Imperfections, rating_N: float) -> None:
        self.count_N = flaws.thrust_quantum_N or rating_N / RATING_COUNTS
        self.rate_Hz = flaws.thrust_rate_Hz
        self._flaws = flaws
        self._zero_N = 0.0
        self._walk_N = 0.0
        self._carried_N = 0.0
        self._recent_N: Array = np.empty(0)

    @property
    def has_read(self) -> bool:
        """Whether there is a conversion that a tare could average."""
        return len(self._recent_N) > 0

    def due(self, first_tick: int, ticks: int, stream_Hz: float) -> NDArray[np.bool_]:
        """Return at which stream ticks a conversion has ended (ticks,)."""
        return due_ticks(first_tick, ticks, self.rate_Hz, stream_Hz)

    def wander_N(self, time_s: Array, tick_s: float, white: Array) -> Array:
        """Return the zero (m,): N at every tick, since power-on: offset, creep and random walk."""
        flaws = self._flaws
        walk_N = self._walk_N + np.cumsum(white) * (flaws.drift_walk_N_per_sqrt_s * np.sqrt(tick_s))
        self._walk_N = float(walk_N[-1])
        zero_N: Array = walk_N + flaws.drift_N_per_s * time_s + flaws.start_offset_N
        return zero_N

    def convert(self, force_N: Array, white: Array) -> tuple[Array, Array]:
        """Return thrust since the tare (m,): N, and counts (m,), of that many conversions."""
        shown_N = force_N + self._carried_N
        if self._flaws.thrust_noise_N:
            shown_N = shown_N + self._flaws.thrust_noise_N * white
        counts = shown_N / self.count_N
        if self._flaws.thrust_quantum_N:
            counts = np.round(counts)
        counts = np.clip(counts, -COUNT_TOP, COUNT_TOP - 1)
        read_N = counts * self.count_N
        self._recent_N = np.concatenate([self._recent_N, read_N])[-TARE_READINGS:]
        return read_N - self._zero_N, counts

    def tare(self, before_N: float, after_N: float) -> None:
        """Take the last conversions as zero thrust.

        Args:
            before_N: the model's own reading at rest just before: an offset, and drift so far.
            after_N: the same just after, with the time since the tare at zero; it stays on the
                reading, since a model's tare offset is what a tare leaves behind.
        """
        self._carried_N += before_N - after_N
        self._zero_N = float(np.mean(self._recent_N)) - after_N


TILT_FEED_RAD_S = 0.2  # of the tilt axis; a rig states only the linear feed; assumed


class Axis:
    """Move one axis at constant feed.

    Attributes:
        shown: what the stage counts.
        true: where the plate stands: as shown after an approach from farther, from where a sweep
            comes and the zero is measured; else nearer, by the play at most.
    """

    def __init__(self, feed: float, start: float, play: float = 0.0) -> None:
        self.target = self.shown = self.true = start
        self._feed = feed
        self._play = play

    @property
    def moving(self) -> bool:
        """Whether the stage has not reached its target yet."""
        return self.shown != self.target

    def advance(self, elapsed_s: Array) -> tuple[Array, Array]:
        """Return counted and true positions (m,) at times since now, and stay at the last.

        The target does not change meanwhile, so the motion is monotonic and the true position
        follows it through the play exactly.
        """
        if not self.moving:
            still = np.ones_like(elapsed_s)
            return self.shown * still, self.true * still
        way = self.target - self.shown
        travelled = np.minimum(self._feed * elapsed_s, abs(way))
        shown = np.where(
            travelled >= abs(way), self.target, self.shown + np.copysign(travelled, way)
        )
        true = np.clip(self.true, shown - self._play, shown)
        self.shown, self.true = float(shown[-1]), float(true[-1])
        return shown, true
