"""Data of a sweep's run folder for reports, each file read once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.data.atomic import data_hash, file_hash
from benchtool.data.columns import code_to_word, speed_columns, word_to_code
from benchtool.data.derived import QuantityValues
from benchtool.data.run.append import Event, read_events
from benchtool.data.run.ratios import ratios
from benchtool.data.run.read import read_points, read_samples, sample_names
from benchtool.data.run.run import Run
from benchtool.data.run.run_rig import run_rig
from benchtool.data.run.settings import average_settings, settings_quantities
from benchtool.fit.nominal import NominalModel
from benchtool.fit.uncertainty.budget import Budget
from benchtool.fit.uncertainty.run_budget import run_budget

FILES = (  # files of a run folder in the order of their hashes in a report
    *("plan.toml", "metadata.json", "points.csv", "samples.csv", "samples.parquet"),
    *("settings.csv", "events.jsonl"),
)


_HEALTH = ("voltage_V", "current_A", "temperature_degC")  # channels with limits


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SweepRun:
    """Run of `benchtool sweep`."""

    path: Path
    metadata: Mapping[str, Any]
    plan_text: str
    rig: Rig
    points: Recording
    tares: Recording | None  # residuals after each tare
    samples: Recording | None  # None in `recalibrated-...` folders
    settings: Recording
    thrust_error_N: Array  # (s,) larger of sd over repeats and standard error of a point
    quantities: tuple[QuantityValues, ...]  # of each setting
    ratio: Array  # (s,) T_IGE/T_OGE; nan without reference
    ratio_error: Array  # (s,)
    basis: str
    events: tuple[Event, ...]
    sha256: str
    files: Mapping[str, str]
    model: NominalModel | None = None  # drawn with the run
    budget: Budget | None = None  # of its thrusts

    @property
    def name(self) -> str:
        return self.path.resolve().name

    @property
    def simulated(self) -> bool:
        return bool(self.metadata.get("simulated", False))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kind of each point."""
        return tuple(code_to_word("kind", code) for code in self.points.column("kind"))

    @property
    def uses_plate(self) -> bool:
        """True for a run over a plate, False for throttle only."""
        return self.metadata.get("plate", {}).get("used", True) is not False

    def z_over_R(self, recording: Recording) -> Array:
        """Return the plate distance of rows over the rotor radius; nan without a plate."""
        if "plate_z_m" not in recording:
            return np.full(len(recording), np.nan)
        return recording.column("plate_z_m") / self.rig.propulsion.radius_m

    def quantity(self, name: str) -> QuantityValues | None:
        """Return a quantity by name; None if the bench does not measure it."""
        return next((item for item in self.quantities if item.name == name), None)

    def measured(self) -> NDArray[np.bool_]:
        """Return a mask (s,) of settings near the plate, False for references."""
        near: NDArray[np.bool_] = self.settings.column("kind") == word_to_code("kind", "measure")
        return near

    def column(self, name: str) -> Array:
        """Return a column of the settings (s,), nan if the run has no such column."""
        if name in self.settings:
            return self.settings.column(name)
        return np.full(len(self.settings), np.nan)

    def level_us(self) -> Array:
        """Return the maximum pulse width of each setting (s,), which is its throttle level."""
        names = speed_columns(self.settings.names, "pwm")
        if not names:
            return np.full(len(self.settings), np.nan)
        pulses = np.nan_to_num([self.settings.column(name) for name in names])
        return np.asarray(pulses.max(axis=0), float)


def read_sweep_run(path: Path, model: NominalModel | None = None) -> SweepRun:
    """Return a sweep's run folder; FileFormatError without rig or points."""
    run = Run.open(path)
    metadata = run.metadata
    points = read_points(path)
    settings = average_settings(points)
    basis, ratio, error = _ratio(points, settings)
    return SweepRun(
        path=path,
        metadata=metadata,
        plan_text=run.plan_text,
        rig=run_rig(path, metadata),
        points=points,
        tares=_tares(path),
        samples=_samples(path) if (path / "samples.csv").is_file() else None,
        settings=settings,
        thrust_error_N=_combine_errors(
            settings, "thrust_sd_N", points, points.column("thrust_se_N")
        ),
        quantities=settings_quantities(path, points),
        ratio=ratio,
        ratio_error=error,
        basis=basis,
        events=read_events(path / "events.jsonl"),
        sha256=data_hash(path),
        files={name: file_hash(path / name) for name in FILES if (path / name).is_file()},
        model=model,
        budget=run_budget(path),
    )


def _samples(path: Path) -> Recording:
    """Return the samples of the columns shown on pages; others are skipped to save memory."""
    names = ("time_s", "point", "phase", "thrust_N", "thrust_raw", "plate_z_m", *_HEALTH)
    return read_samples(path, [*names, *speed_columns(sample_names(path))])


def _tares(path: Path) -> Recording | None:
    try:
        return read_points(path, ["tare"])
    except FileFormatError:
        return None


def _ratio(points: Recording, settings: Recording) -> tuple[str, Array, Array]:
    """Return T_IGE/T_OGE of each setting at equal squared speed, else at equal pulse width."""
    has_rpm2 = np.isfinite(settings.column("ratio_equal_rpm2")).any()
    basis = "equal_rpm2" if has_rpm2 else "equal_pwm"
    ratio, sd = settings.column(f"ratio_{basis}"), f"ratio_{basis}_sd"
    try:
        return (
            basis,
            ratio,
            _combine_errors(settings, sd, points, ratios(points, basis).total_error),
        )
    except InputError:  # no references
        return basis, ratio, settings.column(sd)


def _combine_errors(settings: Recording, sd: str, points: Recording, point_error: Array) -> Array:
    """Return the larger of sd over repeats and mean standard error of a point (s,)."""
    numbers = points.column("setting")
    single = np.full(len(settings), np.nan)
    for row, number in enumerate(settings.column("setting")):
        errors = point_error[(numbers == number) & np.isfinite(point_error)]
        if errors.size:
            single[row] = errors.mean()
    larger: Array = np.fmax(settings.column(sd), single)
    return larger
