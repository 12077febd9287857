"""Points of a run and writing of points.csv, one row per measurement of a setting."""

from __future__ import annotations

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
    """One measurement of a setting: robust means over its samples.

    Attributes:
        point: number of the point, from 1; 0 for a tare.
        setting: number of the setting, from 1; 0 for a tare.
        repeat: number of the measurement of this setting, from 1.
        time_s: middle of the samples, since the start of the run.
        elapsed_s: the same since the last tare.
        pwm_us, rpm: (n_rotors,) mean command and mean speed; nan if unknown.
        rpm_se: (n_rotors,) standard error of the mean speed, as that of thrust.
        thrust_N, thrust_sd_N, thrust_se_N: mean over samples, their standard deviation, and the
            standard error of the mean, corrected for autocorrelation.
        n_samples: thrust samples in the mean.
        plate_z_m: plate distance read by a sensor; falls back to that of the stage.
        plate_stage_z_m, plate_read_z_m: both distances, nan if missing.
        voltage_se_V, current_se_A, torque_se_Nm: standard errors of those means, as that of thrust.
        rejected: number of outliers excluded from the mean, by channel; default 0.
        settled: whether the settling criterion was met before its timeout.
        suspect: a channel has too many outliers, so none was excluded.
    """

    point: int
    kind: str
    setting: int
    repeat: int
    time_s: float
    elapsed_s: float
    pwm_us: tuple[float, ...]
    rpm: tuple[float, ...]
    rpm_se: tuple[float, ...]
    thrust_N: float
    thrust_sd_N: float
    thrust_se_N: float
    n_samples: int
    plate_z_m: float
    plate_x_m: float = 0.0
    plate_tilt_deg: float = 0.0
    voltage_V: float = nan
    current_A: float = nan
    torque_Nm: float = nan
    temperature_degC: float = nan
    settled: bool = True
    plate_stage_z_m: float = nan
    plate_read_z_m: float = nan
    rejected: Mapping[str, int] = field(default_factory=dict)
    suspect: bool = False
    voltage_se_V: float = nan
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


def point_cells(point: Point) -> list[str]:
    """Return the cells of one row of points.csv."""
    values = (
        *point.pwm_us,
        *point.rpm,
        *point.rpm_se,
        *(point.thrust_N, point.thrust_sd_N, point.thrust_se_N, point.n_samples),
        *(point.plate_z_m, point.plate_stage_z_m, point.plate_read_z_m),
        *(point.plate_x_m, point.plate_tilt_deg),
        *(point.voltage_V, point.current_A, point.torque_Nm, point.temperature_degC),
    )
    return [
        *(str(point.point), point.kind, str(point.setting), str(point.repeat)),
        *(f"{point.time_s:.6f}", f"{point.elapsed_s:.6f}"),
        *map(format_cell, values),
        "1" if point.settled else "0",
        *(str(point.rejected.get(name, 0)) for name in averaged_channels(len(point.rpm))),
        "1" if point.suspect else "0",
        *map(format_cell, (point.voltage_se_V, point.current_se_A, point.torque_se_Nm)),
    ]


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
        self.write(",".join(point_cells(point)).encode("ascii") + b"\n")
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
