"""settings.csv: means and standard deviations over repeats, T_IGE/T_OGE against references."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from math import nan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.core.recording import Recording
from benchtool.core.user_file import read_file
from benchtool.data.columns import KINDS, find_channel, speed_columns, word_to_code
from benchtool.data.derived import (
    QuantityValues,
    add_shared_errors,
    derive_quantities,
    run_circumstances,
    with_quantities,
)
from benchtool.data.mcap_file import write_mcap
from benchtool.data.parquet import write_parquet
from benchtool.data.run.points import write_table
from benchtool.data.run.ratios import ratios
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run_metadata import read_metadata
from benchtool.data.run.run_rig import run_rig

_MEANS: tuple[str, ...] = (
    "plate_z_m",
    "plate_x_m",
    "plate_tilt_deg",
    "voltage_V",
    "current_A",
    "torque_Nm",
)

SETTING_KINDS = ("measure", "reference")  # Kinds of points that make settings


def aggregate(points: Recording) -> Recording:
    """Return one row for every setting that was measured or served as a reference.

    Means are over repeats, `*_sd*` are standard deviations over repeats (nan for a single one),
    `thrust_se_N` is the standard error of the mean over repeats, or of the one visit. The ratio
    T_IGE/T_OGE is that of `ratios`, visit by visit: `ratio_equal_pwm` at equal pulse width,
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
        here = np.flatnonzero(settings == setting)
        part = measured.select(here)
        thrust = part.column("thrust_N")
        # A reference over itself is 1 by definition and does not scatter.
        near = part.column("kind")[0] == word_to_code("kind", "measure")
        sd = _sd(thrust)
        se = sd / np.sqrt(len(here)) if len(here) > 1 else float(part.column("thrust_se_N")[0])
        rows.append(
            [
                *(setting, part.column("kind")[0], float(len(here))),
                *(_mean(part.column(name)) for name in names),
                *(_mean(thrust), sd, se),
                *(_mean(by_pwm[here]), _sd(by_pwm[here]) if near else nan),
                *(_mean(by_rpm2[here]), _sd(by_rpm2[here]) if near else nan),
            ]
        )
    values = np.array(rows, float).reshape(len(rows), len(header))
    channels = tuple(find_channel(name) for name in header)
    return Recording(channels, values, points.provenance, points.simulated)


def load_settings(folder: Path, points: Recording | None = None) -> Recording:
    """Return the settings of a run with every quantity that it allows, and their errors.

    Args:
        points: of the run; read when left out.
    """
    points = read_points(folder) if points is None else points
    return with_quantities(aggregate(points), settings_quantities(folder, points))


def settings_quantities(folder: Path, points: Recording) -> tuple[QuantityValues, ...]:
    """Return the quantities of each setting of a run: means over its visits (s,)."""
    kinds = points.column("kind")
    measured = points.select(np.isin(kinds, [word_to_code("kind", name) for name in SETTING_KINDS]))
    settings = measured.column("setting")
    return tuple(
        one.averaged(settings) for one in derive_quantities(measured, run_circumstances(folder))
    )


def _ratios(points: Recording, basis: str) -> Array:
    """Return T_IGE/T_OGE of every visit (n,); nan throughout a run without references."""
    try:
        return ratios(points, basis).value
    except InputError:
        return np.full(len(points), np.nan)


def _mean(values: Array) -> float:
    present = values[~np.isnan(values)]
    return float(present.mean()) if len(present) else float("nan")


def _sd(values: Array) -> float:
    present = values[~np.isnan(values)]
    return float(present.std(ddof=1)) if len(present) > 1 else float("nan")


def ratios_by_distance(runs: Sequence[Path]) -> list[tuple[float, list[float | None]]]:
    """Return each z/R at which a run was measured, to 0.001, with each run's mean T_IGE/T_OGE.

    At equal squared speed, the mean over pulses; None where a run has none there.
    """
    found: dict[float, list[float | None]] = {}
    for index, path in enumerate(runs):
        if not (path / "points.csv").is_file():
            continue
        table = load_settings(path)
        near = table.column("kind") == word_to_code("kind", "measure")
        z = np.round(table.column("plate_z_m") / run_rig(path).propulsion.radius_m, 3)
        for one in np.unique(z[near & np.isfinite(z)]):
            row = found.setdefault(float(one), [None] * len(runs))
            mean = _mean(table.column("ratio_equal_rpm2")[near & (z == one)])
            row[index] = mean if np.isfinite(mean) else None
    return sorted(found.items())


Table = Literal["points", "settings", "samples"]
TABLES: tuple[Table, ...] = ("points", "settings", "samples")
SUFFIXES = (".csv", ".parquet", ".mcap")


def export_table(run: Path, table: str, suffix: str) -> bytes:
    """Return one table of a run as the bytes of a CSV, Parquet or MCAP file.

    Points and settings have every quantity that the bench allows; points.csv itself, which a run
    appends to, has only what was measured.
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
        made = Path(folder) / file.name
        if suffix == ".mcap":
            facts = read_metadata(run)
            started = datetime.fromisoformat(facts.get("started") or "1970-01-01T00:00:00+00:00")
            start_ns = round(started.timestamp() * 1e6) * 1000
            write_mcap(made, recording, start_ns=start_ns, calibration=facts.get("calibration"))
        else:
            (write_table if suffix == ".csv" else write_parquet)(made, recording)
        return made.read_bytes()


def _recording(run: Path, table: str) -> Recording:
    if table == "points":
        points = read_points(run, KINDS)
        return add_shared_errors(points, run_circumstances(run))
    if table == "settings":
        return load_settings(run)
    if not any((run / f"samples{suffix}").is_file() for suffix in SUFFIXES[:2]):
        raise FileFormatError(run.name, "there are no samples in it, only points made of them")
    return read_samples(run)
