"""Channel names and units of recordings and of bench streams.

Plate distance has three names, in m along the axis: `target_z_m` is commanded,
`plate_stage_z_m` reported by the stage, `plate_read_z_m` read by a distance sensor. Models use
`plate_z_m`, corrected for offset and tilt.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.core.toml_text import FiniteTable
from benchtool.core.units import find_unit

CHANNELS: dict[str, str] = {  # channels that a table can be mapped to; # is a rotor's number
    "time_s": "time since the start of the recording",
    "device_time_us": "device time",
    "elapsed_s": "time since the last tare",
    "point": "number of the point",
    "kind": "measure, reference, anchor, tare or failed",
    "setting": "number of the setting that a point repeats",
    "repeat": "number of the repeat",
    "phase": "tare, move, rest, ramp, settle, sample, end or interrupted",
    "thrust_N": "thrust of all rotors, up positive",
    "thrust_sd_N": "standard deviation of the samples of a mean",
    "thrust_se_N": "standard error of a mean",
    "thrust_raw": "counts of the load cell's converter",
    "n_samples": "number of samples of a mean",
    "torque_Nm": "torque about the rotor axis",
    "thrust_ratio": "thrust over that without a plate, where no thrust is given",
    "thrust_ratio_sd": "standard deviation of that ratio",
    "thrust_ratio_se": "standard error of that ratio",
    "pwm#_us": "pulse width of a rotor's ESC",
    "rpm#": "speed of a rotor",
    "rpm#_sd": "standard deviation of that speed",
    "rpm#_se": "standard error of that speed",
    "coverage#": "fraction of a rotor disc over the plate",
    "plate_z_m": "plate distance: rotor plane to plate centre, along the axis",
    "plate_x_m": "lateral position of the plate's centre",
    "plate_tilt_deg": "tilt of the plate about the y axis",
    "voltage_V": "supply voltage",
    "current_A": "supply current",
    "temperature_degC": "temperature of motor, ESC or air",
    "load_direction": "1: load approached from below, -1: from above",
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
    "pitch_command_share": "rate controller output, -1 to 1, nose down positive",
    "roll_command_share": "rate controller output for roll",
    "yaw_command_share": "rate controller output for yaw",
    "throttle_command_share": "commanded throttle, 0 to 1",
    "airspeed_m_s": "speed of the air along the plate",
    "rpm#_optical": "speed from an optical probe",
    "pwm_raw": "commanded throttle in device units",
    "battery_V": "battery voltage",
    "power_W": "electrical power",
    "mechanical_power_W": "shaft power",
    "ct": "thrust coefficient C_T of a propeller",
    "cp": "power coefficient C_P of a propeller",
    "motor_efficiency": "mechanical over electrical power",
    "propeller_efficiency_N_W": "thrust over mechanical power",
    "efficiency_N_W": "thrust over electrical power",
    "acc_x_m_s2": "acceleration forward",
    "acc_y_m_s2": "acceleration to the left",
    "acc_z_m_s2": "acceleration up",
    "vibration_m_s2": "vibration, as reported by the bench",
    "servo#_us": "pulse width of a servo",
    "motor#_share": "commanded throttle of a motor, 0 to 1",
}

_PLAIN = ("s", "us", "m", "N", "V", "A", "W", "deg", "rad", "degC", "kg", "Pa")
_UNIT_OF_ENDING = {f"_{unit}": unit for unit in _PLAIN} | {
    "_Nm": "N m", "_raw": "count", "_rad_s": "rad/s", "_m_s": "m/s", "_m_s2": "m/s2",
    "_kg_m3": "kg/m3", "_N_W": "N/W", "_gf_W": "gf/W",
}  # fmt: skip
_RPM = re.compile(r"rpm\d*(_sd|_se|_optical)?")
_PWM = re.compile(r"pwm\d+_us")


def is_known_channel(name: str) -> bool:
    """Return True for a channel name of `CHANNELS`."""
    return re.sub(r"\d+", "#", name) in CHANNELS


def check_channels(names: Iterable[str], where: str) -> None:
    """Raise FileFormatError for a map with an unknown channel."""
    for name in names:
        if not is_known_channel(name):
            known = (item.replace("#", "1") for item in CHANNELS)
            raise FileFormatError(
                f"[columns] of {where}", str(UnknownChoice("channel", name, known))
            )


def channel_family(name: str) -> str:
    """Return a channel name without the rotor number at the end."""
    return name.rstrip("0123456789")


def unit_from_name(name: str) -> str:
    """Return the unit suffix of a column name; "1" without one."""
    if _RPM.fullmatch(name):
        return "rpm"
    if _PWM.fullmatch(name):
        return "pwm_us"
    has_name = name.rfind("_") > 0
    return _UNIT_OF_ENDING.get(_find_ending(name), "1") if has_name else "1"


def _find_ending(name: str) -> str:
    """Return the longest ending of a name that is a unit; "" without one."""
    endings = (ending for ending in _UNIT_OF_ENDING if name.endswith(ending))
    return max(endings, key=len, default="")


def error_channel_name(name: str) -> str:
    """Return the column name of a channel's standard error: "se" before the unit."""
    ending = _find_ending(name)
    return f"{name.removesuffix(ending)}_se{ending}"


@dataclass(frozen=True, slots=True)
class Channel:
    """Measured or commanded quantity.

    Attributes:
        name: identifier whose suffix is the unit in files (`thrust_N`, `pwm1_us`). Exception: rotor
            speed in revolutions per minute, `rpm1`, unit "rpm".
        unit: unit of the stored numbers, one of `core.units.UNITS`.
    """

    name: str
    unit: str
    description: str = ""

    def __post_init__(self) -> None:
        find_unit(self.unit)


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnSource(FiniteTable):
    """Source of one channel: a column or a constant.

    Attributes:
        column: the file's column; None for a constant.
        constant: one number for all rows, in `unit`.
        unit: unit of the file's numbers; default: that in the column name, else the channel's.
        sign: -1 if the file uses the opposite sign.
        factor: factor on the file's numbers (0.1651 converts z/R to metres for that R; 1/6 corrects
            a wrong pole count).
        reference: for `kind` only: cell text of reference rows, far from any plate.
    """

    column: str | None = None
    constant: float | None = None
    unit: str | None = None
    sign: Literal[-1, 1] = 1
    factor: float = 1.0
    reference: str | None = None

    def __post_init__(self) -> None:
        if (self.column is None) == (self.constant is None):
            raise InputError(
                "an entry of [columns] needs either column = 'NAME' or constant = NUMBER; give "
                "exactly one of them"
            )
