"""A channel: one named column of a recording or of a bench's stream."""

from __future__ import annotations

import re
from dataclasses import dataclass

from benchtool.core.errors import UnknownChoice
from benchtool.core.units import find_unit

CHANNELS: dict[str, str] = {  # every channel that a table can be mapped to; # is a rotor's number
    "time_s": "time since the recording began",
    "device_time_us": "the device's own counter",
    "elapsed_s": "time since the last tare",
    "point": "number of the visit",
    "kind": "measure, reference, anchor, tare or failed",
    "setting": "number of the setting that a visit repeats",
    "repeat": "number of the repeat",
    "phase": "tare, move, rest, ramp, settle, sample, end or interrupted",
    "thrust_N": "thrust of all rotors, up positive",
    "thrust_sd_N": "scatter of the samples behind a mean",
    "thrust_se_N": "standard error of a mean",
    "thrust_raw": "counts of the load cell's converter",
    "n_samples": "samples behind a mean",
    "torque_Nm": "torque about the rotor axis",
    "thrust_ratio": "thrust over that without a plate, where no thrust is given",
    "thrust_ratio_sd": "scatter of that ratio",
    "thrust_ratio_se": "standard error of that ratio",
    "pwm#_us": "pulse width of a rotor's ESC",
    "rpm#": "speed of a rotor",
    "rpm#_sd": "scatter of that speed",
    "rpm#_se": "standard error of that speed",
    "coverage#": "part of a rotor's disc that is over the plate",
    "plate_z_m": "rotor plane to the plate's centre, along the axis",
    "plate_x_m": "lateral position of the plate's centre",
    "plate_tilt_deg": "tilt of the plate about the y axis",
    "voltage_V": "supply voltage",
    "current_A": "supply current",
    "temperature_degC": "of motor, ESC or air, as the bench measures it",
    "load_direction": "1 where the load was approached from below, -1 from above",
    "theta_rad": "pitch angle, nose down positive",
    "theta_ref_rad": "commanded pitch angle",
    "gyro_rad_s": "pitch rate",
    "gyro_ref_rad_s": "commanded pitch rate",
    "distance_m": "reading of a distance sensor",
    "roll_rad": "roll angle",
    "yaw_rad": "yaw angle",
    "roll_ref_rad": "commanded roll angle",
    "yaw_ref_rad": "commanded yaw angle",
    "roll_rate_rad_s": "roll rate",
    "yaw_rate_rad_s": "yaw rate",
    "roll_rate_ref_rad_s": "commanded roll rate",
    "yaw_rate_ref_rad_s": "commanded yaw rate",
    "pitch_command_share": "what the rate controller commands, -1 to 1, nose down positive",
    "roll_command_share": "the same of roll",
    "yaw_command_share": "the same of yaw",
    "throttle_command_share": "commanded throttle, 0 to 1",
    "airspeed_m_s": "speed of the air along the plate",
    "rpm#_optical": "speed by an optical probe",
    "pwm_raw": "commanded throttle in the device's own numbers",
    "battery_V": "voltage at the pack",
    "power_W": "electrical power",
    "mechanical_power_W": "power of the shaft",
    "ct": "thrust coefficient C_T of a propeller",
    "cp": "power coefficient C_P of a propeller",
    "motor_efficiency": "mechanical over electrical power",
    "propeller_efficiency_N_W": "thrust over mechanical power",
    "efficiency_N_W": "thrust over electrical power",
    "acc_x_m_s2": "acceleration forward",
    "acc_y_m_s2": "acceleration to the left",
    "acc_z_m_s2": "acceleration up",
    "vibration_m_s2": "vibration as the bench states it",
    "servo#_us": "pulse width of a servo",
    "motor#_share": "commanded throttle of a motor, 0 to 1",
}

_PLAIN = ("s", "us", "m", "N", "V", "A", "W", "deg", "rad", "degC", "kg", "Pa")
_SUFFIXES = {unit: unit for unit in _PLAIN} | {"Nm": "N m", "raw": "count"}
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
    if re.sub(r"\d+", "#", name) not in CHANNELS:
        raise UnknownChoice("channel", name, (item.replace("#", "1") for item in CHANNELS))


def channel_family(name: str) -> str:
    """Return the kind of a channel: its name without a rotor's number at the end."""
    return name.rstrip("0123456789")


def unit_from_name(name: str) -> str:
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


def error_channel_name(name: str) -> str:
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
    """

    name: str
    unit: str
    description: str = ""

    def __post_init__(self) -> None:
        find_unit(self.unit)
