"""A channel: one named column of a recording or of a bench's stream."""

from __future__ import annotations

import re
from dataclasses import dataclass

from benchtool.core.units import unit_named
from benchtool.errors import UnknownChoice

CHANNEL_NAMES: tuple[str, ...] = (
    *("time_s", "device_time_us", "elapsed_s", "point", "kind", "setting", "repeat", "phase"),
    *("thrust_N", "thrust_sd_N", "thrust_se_N", "thrust_raw", "n_samples", "torque_Nm"),
    *("pwm#_us", "rpm#", "rpm#_sd", "rpm#_se", "coverage#"),
    *("plate_z_m", "plate_x_m", "plate_tilt_deg", "voltage_V", "current_A", "temperature_degC"),
    *("theta_rad", "theta_ref_rad", "gyro_rad_s"),
)
"""Every channel that a table can be mapped to; # stands for a rotor's number."""


def require_known_channel(name: str) -> None:
    """Refuse a channel name that nothing reads, with the known ones."""
    if re.sub(r"\d+", "#", name) not in CHANNEL_NAMES:
        raise UnknownChoice("channel", name, (item.replace("#", "1") for item in CHANNEL_NAMES))


@dataclass(frozen=True, slots=True)
class Channel:
    """Name one measured or commanded quantity.

    Attributes:
        name: identifier whose suffix is the unit as it stands in files (`thrust_N`, `pwm1_us`).
            Rotor speed in revolutions per minute is the one habit of the field that files keep:
            `rpm1`, unit "rpm".
        unit: unit of the stored numbers, one of `core.units.UNITS`.
        description: one line for people.
    """

    name: str
    unit: str
    description: str = ""

    def __post_init__(self) -> None:
        unit_named(self.unit)
