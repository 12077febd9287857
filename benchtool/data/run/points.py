"""Points of a run (points.csv), settings (settings.csv) as means over repeats, and table export."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from math import isnan, nan
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.core.user_file import read_file
from benchtool.data.atomic import replace_text
from benchtool.data.columns import (
    KINDS,
    REJECTED,
    WORDS,
    find_channel,
    is_whole,
    speed_columns,
    word_to_code,
)
from benchtool.data.derived import (
    QuantityValues,
    add_quantities,
    derive_quantities,
    load_run_context,
    with_quantities,
)
from benchtool.data.parquet import write_parquet
from benchtool.data.run.append import AppendTable
from benchtool.data.run.ratios import ratios
from benchtool.data.run.read import read_points, read_samples, run_rig
from benchtool.data.run.recording_file import write_mcap
from benchtool.data.run.run_metadata import read_metadata


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


_MEANS = ("plate_z_m", "plate_x_m", "plate_tilt_deg", "voltage_V", "current_A", "torque_Nm")

SETTING_KINDS = ("measure", "reference")  # kinds of points averaged to settings


def average_settings(points: Recording) -> Recording:
    """Return one row for each setting that was measured or is a reference.

    Means are over repeats, `*_sd*` are standard deviations over repeats (nan for a single one),
    `thrust_se_N` is the standard error of the mean over repeats, or of a single point. Ratios
    T_IGE/T_OGE are means of those of points (`ratios`): `ratio_equal_pwm` at equal pulse width,
    `ratio_equal_rpm2` at equal squared speed.
    """
    kinds = points.column("kind")
    measured = points.select(np.isin(kinds, [word_to_code("kind", name) for name in SETTING_KINDS]))
    names = [*speed_columns(points.names), *(name for name in _MEANS if name in points)]
    header = (
        *("setting", "kind", "n_repeats"),
        *names,
        *("thrust_N", "thrust_sd_N", "thrust_se_N"),
        *("ratio_equal_pwm", "ratio_equal_pwm_sd", "ratio_equal_rpm2", "ratio_equal_rpm2_sd"),
    )
    by_pwm = _ratios(measured, "equal_pwm")
    by_rpm2 = _ratios(measured, "equal_rpm2")
    settings = measured.column("setting")
    rows = []
    for setting in np.unique(settings):
        index = np.flatnonzero(settings == setting)
        repeats = measured.select(index)
        thrust = repeats.column("thrust_N")
        # The ratio of a reference is 1 by definition, without a standard deviation.
        is_measured = repeats.column("kind")[0] == word_to_code("kind", "measure")
        sd = _sd(thrust)
        se = sd / np.sqrt(len(index)) if len(index) > 1 else float(repeats.column("thrust_se_N")[0])
        rows.append(
            [
                *(setting, repeats.column("kind")[0], float(len(index))),
                *(_mean(repeats.column(name)) for name in names),
                *(_mean(thrust), sd, se),
                *(_mean(by_pwm[index]), _sd(by_pwm[index]) if is_measured else nan),
                *(_mean(by_rpm2[index]), _sd(by_rpm2[index]) if is_measured else nan),
            ]
        )
    values = np.array(rows, float).reshape(len(rows), len(header))
    channels = tuple(find_channel(name) for name in header)
    return Recording(channels, values, points.provenance, points.simulated)


def load_settings(folder: Path, points: Recording | None = None) -> Recording:
    """Return the settings of a run with all derived quantities and their errors."""
    points = read_points(folder) if points is None else points
    return with_quantities(average_settings(points), settings_quantities(folder, points))


def settings_quantities(folder: Path, points: Recording) -> tuple[QuantityValues, ...]:
    """Return the quantities of each setting of a run: means over its points (s,)."""
    kinds = points.column("kind")
    measured = points.select(np.isin(kinds, [word_to_code("kind", name) for name in SETTING_KINDS]))
    settings = measured.column("setting")
    quantities = derive_quantities(measured, load_run_context(folder))
    return tuple(quantity.averaged(settings) for quantity in quantities)


def _ratios(points: Recording, basis: str) -> Array:
    """Return T_IGE/T_OGE of each point (n,); all nan for a run without references."""
    try:
        return ratios(points, basis).value
    except InputError:
        return np.full(len(points), np.nan)


def _mean(values: Array) -> float:
    valid = values[~np.isnan(values)]
    return float(valid.mean()) if len(valid) else float("nan")


def _sd(values: Array) -> float:
    valid = values[~np.isnan(values)]
    return float(valid.std(ddof=1)) if len(valid) > 1 else float("nan")


def ratios_by_distance(runs: Sequence[Path]) -> list[tuple[float, list[float | None]]]:
    """Return each measured z/R, rounded to 0.001, with the mean T_IGE/T_OGE of each run.

    Ratios are at equal squared speed, means over pulse widths; None if a run has none.
    """
    rows: dict[float, list[float | None]] = {}
    for index, path in enumerate(runs):
        if not (path / "points.csv").is_file():
            continue
        table = load_settings(path)
        is_measured = table.column("kind") == word_to_code("kind", "measure")
        z_over_R = np.round(table.column("plate_z_m") / run_rig(path).propulsion.radius_m, 3)
        for distance in np.unique(z_over_R[is_measured & np.isfinite(z_over_R)]):
            row = rows.setdefault(float(distance), [None] * len(runs))
            mean = _mean(table.column("ratio_equal_rpm2")[is_measured & (z_over_R == distance)])
            row[index] = mean if np.isfinite(mean) else None
    return sorted(rows.items())


TABLES = ("points", "settings", "samples")
SUFFIXES = (".csv", ".parquet", ".mcap")


def export_table(run: Path, table: str, suffix: str) -> bytes:
    """Return a table of a run as the bytes of a CSV, Parquet or MCAP file.

    Points and settings contain all derived quantities; points.csv of the run has only measured
    values.
    """
    if table not in TABLES:
        raise UnknownChoice("table of a run", table, TABLES)
    if suffix not in SUFFIXES:
        raise UnknownChoice("format of a table", suffix, SUFFIXES)
    file = run / f"{table}{suffix}"
    if file.is_file() and table != "points":
        return read_file(file, follow=False)
    recording = _recording(run, table)
    with TemporaryDirectory() as folder:
        path = Path(folder) / file.name
        if suffix == ".mcap":
            facts = read_metadata(run)
            started = datetime.fromisoformat(facts.get("started") or "1970-01-01T00:00:00+00:00")
            start_ns = round(started.timestamp() * 1e6) * 1000
            write_mcap(path, recording, start_ns=start_ns, calibration=facts.get("calibration"))
        else:
            (write_table if suffix == ".csv" else write_parquet)(path, recording)
        return path.read_bytes()


def _recording(run: Path, table: str) -> Recording:
    if table == "points":
        points = read_points(run, KINDS)
        return add_quantities(points, load_run_context(run))
    if table == "settings":
        return load_settings(run)
    if not any((run / f"samples{suffix}").is_file() for suffix in SUFFIXES[:2]):
        raise FileFormatError(run.name, "the run has points but no samples; export another table")
    return read_samples(run)
