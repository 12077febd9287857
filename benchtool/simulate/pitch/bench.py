"""Pitch bench: hinge, rotors, plate, sensors and limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from math import isfinite, pi
from typing import Any

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig import Rig
from benchtool.physics.model import Model
from benchtool.simulate.controllers.controller import GRAVITY_M_S2

STEPS_PER_LAG = 2.0  # minimum number of plant steps per motor lag


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchSensor:
    """Sensor in SI units; 0 means exactly absent.

    Attributes:
        rate_Hz: sampling rate; 0 is one reading per control tick.
        delay_s: age of a reading, rounded to control ticks.
    """

    noise: float = 0.0
    bias: float = 0.0
    quantum: float = 0.0
    rate_Hz: float = 0.0
    delay_s: float = 0.0


PERFECT_SENSOR = PitchSensor()
SENSOR_NAMES = ("theta_rad", "gyro_rad_s", "plate_z_m", "rpm")  # in loop order


@dataclass(frozen=True, kw_only=True)
class PitchBench:
    """Pitch bench.

    Attributes:
        model: its rig defines rotors, inertia, mass and pulse map.
        sensors: by name, see `SENSOR_NAMES`; a missing one is perfect. Rotor speeds in rad/s.
        covered: (n_discs,) share of each disc over the fully inserted plate.
    """

    model: Model
    inertia_kgm2: float
    sensors: Mapping[str, PitchSensor] = field(default_factory=dict)
    covered: tuple[float, ...] = (1.0,)
    stop_rad: float = pi / 3.0
    pwm_min_us: float = 1000.0
    pwm_max_us: float = 2000.0
    pwm_quantum_us: float = 0.0
    plant_rate_Hz: float = 1000.0

    @classmethod
    def from_model(cls, model: Model, **changes: Any) -> PitchBench:
        """Return the bench of the rig of a model, with some attributes changed.

        The plate is under the first disc. Sensors are those of the rig, and so is `motor_lag` if
        the model has none.
        """
        rig = model.rig
        model = model.with_rig_lag()
        return cls(
            **{
                "model": model,
                "inertia_kgm2": model.parameters["inertia_kgm2"].value,
                "sensors": rig_sensors(rig),
                "covered": (1.0, *(0.0,) * (rig.n_discs - 1)),
                "pwm_min_us": rig.propulsion.pwm_start_us,
                "pwm_max_us": rig.propulsion.pwm_max_us,
                "pwm_quantum_us": 1.0,
                **changes,
            }
        )

    def __post_init__(self) -> None:
        rig = self.model.rig
        unknown = [name for name in self.sensors if name not in SENSOR_NAMES]
        if unknown:
            raise UnknownChoice("sensor of a pitch bench", unknown[0], SENSOR_NAMES)
        if len(self.covered) != rig.n_discs:
            raise InputError(
                f"covered has {len(self.covered)} numbers for {rig.n_discs} discs; give one per "
                f"disc"
            )
        for name in ("inertia_kgm2", "stop_rad", "plant_rate_Hz", "pwm_max_us"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0.0):
                raise InputError(f"{name} is {value:g}; allowed: finite numbers above 0")
        if self.stop_rad > 1.5:
            raise InputError(f"stop_rad is {self.stop_rad:g}; allowed: up to 1.5 (86 degrees)")
        for name, sensor in self.sensors.items():
            for item in fields(sensor):
                value = getattr(sensor, item.name)
                if not isfinite(value) or (value < 0.0 and item.name != "bias"):
                    raise InputError(
                        f"{name}.{item.name} is {value:g}; allowed: finite numbers from 0"
                    )
        for name, value in self.model.parameters.items():
            if not isfinite(value.value):
                raise InputError(f"{name} is {value.value:g}; allowed: finite numbers")
        lag_s = self.model.lag_s
        if 0.0 < lag_s < STEPS_PER_LAG / self.plant_rate_Hz:
            raise InputError(
                f"motor_lag.tau_s is {lag_s:g} s, but a plant step takes "
                f"{1.0 / self.plant_rate_Hz:g} s; raise plant_rate_Hz to "
                f"{STEPS_PER_LAG / lag_s:.0f} or more, or remove the lag"
            )

    @property
    def loop_sensors(self) -> tuple[PitchSensor, ...]:
        """Sensors in the order of `SENSOR_NAMES`, perfect ones where missing."""
        return tuple(self.sensors.get(name, PERFECT_SENSOR) for name in SENSOR_NAMES)

    @property
    def hover_N(self) -> float:
        """Thrust of one rotor at hover: weight over the number of rotors."""
        return self.model.rig.body.mass_kg * GRAVITY_M_S2 / self.model.rig.n_rotors


def rig_sensors(rig: Rig) -> dict[str, PitchSensor]:
    """Return the sensors of a rig that a pitch bench has, in SI units."""
    sensors = {}
    for name in SENSOR_NAMES:
        if name in rig.sensors:
            sensor, factor = rig.sensors[name], pi / 30.0 if name == "rpm" else 1.0
            sensors[name] = PitchSensor(
                noise=sensor.noise * factor, quantum=sensor.quantum * factor, rate_Hz=sensor.rate_Hz
            )
    return sensors
