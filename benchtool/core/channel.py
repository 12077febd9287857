"""A channel: one named column of a recording or of a bench's stream."""

from __future__ import annotations

import re
from dataclasses import dataclass

from benchtool.core.errors import UnknownChoice
from benchtool.core.units import unit_named

CHANNEL_NAMES: tuple[str, ...] = (
    *("time_s", "device_time_us", "elapsed_s", "point", "kind", "setting", "repeat", "phase"),
    *("thrust_N", "thrust_sd_N", "thrust_se_N", "thrust_raw", "n_samples", "torque_Nm"),
    *("thrust_ratio", "thrust_ratio_sd", "thrust_ratio_se"),
    *("pwm#_us", "rpm#", "rpm#_sd", "rpm#_se", "coverage#"),
    *("plate_z_m", "plate_x_m", "plate_tilt_deg", "voltage_V", "current_A", "temperature_degC"),
    "load_direction",
    *("theta_rad", "theta_ref_rad", "gyro_rad_s", "gyro_ref_rad_s", "distance_m"),
    *("roll_rad", "yaw_rad", "roll_ref_rad", "yaw_ref_rad", "roll_rate_rad_s", "yaw_rate_rad_s"),
    *("roll_rate_ref_rad_s", "yaw_rate_ref_rad_s"),
    *("pitch_command_share", "roll_command_share", "yaw_command_share", "throttle_command_share"),
    "airspeed_m_s",
    *("rpm#_optical", "pwm_raw", "battery_V", "power_W", "mechanical_power_W", "ct", "cp"),
    *("motor_efficiency", "propeller_efficiency_N_W", "efficiency_N_W"),
    *("acc_x_m_s2", "acc_y_m_s2", "acc_z_m_s2", "vibration_m_s2", "servo#_us", "motor#_share"),
)
"""Every channel that a table can be mapped to; # stands for a rotor's number."""


_SUFFIXES: dict[str, str] = {
    "s": "s",
    "us": "us",
    "m": "m",
    "N": "N",
    "Nm": "N m",
    "V": "V",
    "A": "A",
    "W": "W",
    "deg": "deg",
    "rad": "rad",
    "degC": "degC",
    "kg": "kg",
    "Pa": "Pa",
    "raw": "count",
}
_LONG_SUFFIXES: dict[str, str] = {
    "_rad_s": "rad/s",
    "_m_s": "m/s",
    "_m_s2": "m/s2",
    "_kg_m3": "kg/m3",
    "_N_W": "N/W",
    "_gf_W": "gf/W",
}
_RPM = re.compile(r"rpm\d*(_sd|_se|_optical)?")
_PWM = re.compile(r"pwm\d+_us")


def require_known_channel(name: str) -> None:
    """Refuse a channel name that nothing reads, with the known ones."""
    if re.sub(r"\d+", "#", name) not in CHANNEL_NAMES:
        raise UnknownChoice("channel", name, (item.replace("#", "1") for item in CHANNEL_NAMES))


def family_of(name: str) -> str:
    """Return the kind of a channel: its name without a rotor's number at the end."""
    return name.rstrip("0123456789")


def unit_in_name(name: str) -> str:
    """Return the unit that a column name of ours carries; "1" when it carries none."""
    if _RPM.fullmatch(name):
        return "rpm"
    if _PWM.fullmatch(name):
        return "pwm_us"
    for ending, unit in _LONG_SUFFIXES.items():
        if name.endswith(ending):
            return unit
    head, _, suffix = name.rpartition("_")
    return _SUFFIXES.get(suffix, "1") if head else "1"


def error_name(name: str) -> str:
    """Return the name of the column of a channel's standard error: "se" before its unit."""
    endings = (*_LONG_SUFFIXES, *(f"_{suffix}" for suffix in _SUFFIXES))
    ending = next((one for one in endings if name.endswith(one)), "")
    return f"{name.removesuffix(ending)}_se{ending}"


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
