"""What makes a virtual bench as imperfect as a real one, each with a value where it is absent."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import isinf, isnan, nan
from typing import Annotated

from annotated_types import Ge

from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.toml_text import FiniteTable

NotNegative = Annotated[float, Ge(0.0)]

OPEN = nan
"""A number that is left to the rig."""


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
        drift_walk_N_per_sqrt_s: random walk of the zero: sd after one second.
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
    drift_walk_N_per_sqrt_s: NotNegative = 2e-4
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
        own = {
            "motor_lag_s": rig.propulsion.lag_s,
            "backlash_m": rig.plate.backlash_m,
            "thrust_rate_Hz": sensors["thrust_N"].rate_Hz if "thrust_N" in sensors else 0.0,
        }
        for family, quantity, unit in _FAMILIES:
            sensor = sensors.get(family)
            own[f"{quantity}_noise_{unit}"] = sensor.noise if sensor else 0.0
            own[f"{quantity}_quantum_{unit}"] = sensor.quantum if sensor else 0.0
        return replace(
            self, **{name: value for name, value in own.items() if isnan(getattr(self, name))}
        )


_FAMILIES = (
    ("thrust_N", "thrust", "N"),
    ("rpm", "rpm", "rpm"),
    ("voltage_V", "voltage", "V"),
    ("current_A", "current", "A"),
    ("plate_z_m", "plate", "m"),
)
