"""Points of a run and writing of points.csv, one row per measurement of a setting."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isnan, nan
from pathlib import Path

from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.data.atomic import replace_text
from benchtool.data.columns import REJECTED, WORDS, is_whole
from benchtool.data.run.append import AppendTable


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One measurement of a setting: robust means over its samples."""

    point: int  # number of the point, from 1; 0 for a tare
    kind: str
    setting: int  # number of the setting, from 1; 0 for a tare
    repeat: int  # number of the measurement of this setting, from 1
    time_s: float  # middle of the samples, since the start of the run
    elapsed_s: float  # the same since the last tare
    pwm_us: tuple[float, ...]  # (n_rotors,) mean command; nan if unknown
    rpm: tuple[float, ...]  # (n_rotors,) mean speed; nan if unknown
    rpm_se: tuple[float, ...]  # (n_rotors,) standard error of the mean speed, as that of thrust
    thrust_N: float  # mean over samples
    thrust_sd_N: float  # standard deviation of the samples
    thrust_se_N: float  # standard error of the mean, corrected for autocorrelation
    n_samples: int  # thrust samples in the mean
    plate_z_m: float  # plate distance read by a sensor; falls back to that of the stage
    plate_x_m: float = 0.0
    plate_tilt_deg: float = 0.0
    voltage_V: float = nan
    current_A: float = nan
    torque_Nm: float = nan
    temperature_degC: float = nan
    settled: bool = True  # whether the settling criterion was met before its timeout
    plate_stage_z_m: float = nan  # nan if missing
    plate_read_z_m: float = nan  # nan if missing
    rejected: Mapping[str, int] = field(default_factory=dict)  # outliers excluded, by channel
    suspect: bool = False  # a channel has too many outliers, so none was excluded
    voltage_se_V: float = nan  # standard errors of means, as that of thrust
    current_se_A: float = nan
    torque_se_Nm: float = nan

    @property
    def sum_rpm2(self) -> float:
        """Sum of the squared rotor speeds; nan if a speed is not measured."""
        return sum(speed**2 for speed in self.rpm)


def averaged_channels(n_rotors: int) -> tuple[str, ...]:
    """Return the channels whose means a point contains."""
    return (
        *(f"rpm{i + 1}" for i in range(n_rotors)),
        *("thrust_N", "plate_z_m", "plate_x_m", "plate_tilt_deg"),
        *("voltage_V", "current_A", "torque_Nm", "temperature_degC"),
    )


def point_columns(n_rotors: int) -> tuple[str, ...]:
    """Return the column names of points.csv."""
    return (
        *("point", "kind", "setting", "repeat", "time_s", "elapsed_s"),
        *(f"pwm{i + 1}_us" for i in range(n_rotors)),
        *(f"rpm{i + 1}" for i in range(n_rotors)),
        *(f"rpm{i + 1}_se" for i in range(n_rotors)),
        *("thrust_N", "thrust_sd_N", "thrust_se_N", "n_samples"),
        *("plate_z_m", "plate_stage_z_m", "plate_read_z_m", "plate_x_m", "plate_tilt_deg"),
        *("voltage_V", "current_A", "torque_Nm", "temperature_degC", "settled"),
        *(f"{name}{REJECTED}" for name in averaged_channels(n_rotors)),
        *("suspect", "voltage_se_V", "current_se_A", "torque_se_Nm"),
    )


def _format_field(point: Point, column: str) -> str:
    """Return the cell of a point in a column of points.csv."""
    if column.endswith(REJECTED):
        return str(point.rejected.get(column.removesuffix(REJECTED), 0))
    if match := re.fullmatch(r"(pwm|rpm)(\d+)(_us|_se)?", column):
        return format_cell(getattr(point, f"{match[1]}{match[3] or ''}")[int(match[2]) - 1])
    value = getattr(point, column)
    if column in ("time_s", "elapsed_s"):
        return f"{value:.6f}"
    if is_whole(column):
        return str(int(value))
    return value if isinstance(value, str) else format_cell(value)


def format_cell(value: float) -> str:
    """Return a number as text without loss of precision; nan is an empty cell."""
    return "" if isnan(value) else repr(value)


class PointWriter(AppendTable):
    """Writer of points.csv; a point is on the disk when `append` returns."""

    def __init__(self, path: Path, n_rotors: int) -> None:
        mismatch = (
            f"its columns differ from those of a run with {pluralize(n_rotors, 'rotor')} in this "
            f"version; resume with the rig and the version of benchtool that started the run"
        )
        super().__init__(path, point_columns(n_rotors), mismatch)

    def append(self, point: Point) -> None:
        """Append one point and flush it to the disk."""
        cells = (_format_field(point, column) for column in point_columns(len(point.rpm)))
        self.write(",".join(cells).encode("ascii") + b"\n")
        self.sync()


def write_table(path: Path, recording: Recording) -> None:
    """Write a CSV table: codes as words, integers without decimals, nan as an empty cell."""
    columns = [_format_column(name, recording.column(name).tolist()) for name in recording.names]
    lines = [",".join(recording.names), *(",".join(row) for row in zip(*columns, strict=True))]
    replace_text(path, "\n".join(lines) + "\n")


def _format_column(name: str, values: list[float]) -> list[str]:
    if name in WORDS:
        return [WORDS[name][int(value)] for value in values]
    if is_whole(name):
        return [f"{value:.0f}" for value in values]
    return [format_cell(value) for value in values]
