"""Data of a sweep's run folder for reports, each file read once, and their tables."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.data.atomic import data_hash, file_hash
from benchtool.data.columns import REJECTED, code_to_word, speed_columns, word_to_code
from benchtool.data.derived import QuantityValues
from benchtool.data.run.append import Event, read_events
from benchtool.data.run.points import average_settings, settings_quantities
from benchtool.data.run.ratios import ratios
from benchtool.data.run.read import read_points, read_samples, run_rig, sample_names
from benchtool.data.run.run import Run
from benchtool.fit.nominal import NominalModel
from benchtool.fit.uncertainty.budget import Budget
from benchtool.fit.uncertainty.run_budget import run_budget
from benchtool.report.numbers import format_number, value_with_sd
from benchtool.report.page import Block, Table
from benchtool.report.panels import origins_table, values_table
from benchtool.report.ratio import BASES

FILES = (  # files of a run folder in the order of their hashes in a report
    *("plan.toml", "metadata.json", "points.csv", "samples.csv", "samples.parquet"),
    *("settings.csv", "events.jsonl"),
)


ERRORS = "the larger of standard deviation over repeats and standard error of a point"
_SAMPLED = (  # columns of samples on pages, besides speeds and pulse widths
    *("time_s", "point", "phase", "thrust_N", "thrust_raw", "plate_z_m"),
    *("voltage_V", "current_A", "temperature_degC"),
)


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

    def __repr__(self) -> str:
        return f"SweepRun {self.path}: {len(self.points)} points, {len(self.settings)} settings"

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
        return np.asarray(self.settings.column("kind") == word_to_code("kind", "measure"), bool)

    def column(self, name: str) -> Array:
        """Return a column of the settings (s,), nan if the run has no such column."""
        if name in self.settings:
            return self.settings.column(name)
        return np.full(len(self.settings), np.nan)

    def of_rotors(self, name: str) -> Array:
        """Return a column of each rotor (n_rotors, s), nan if the run has no such column."""
        numbers = range(1, self.rig.n_rotors + 1)
        return np.array([self.column(name.format(number)) for number in numbers])

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
    settings, thrust_se_N = average_settings(points), points.column("thrust_se_N")
    basis, ratio, error = _ratio(points, settings)
    samples = tares = None
    with suppress(FileFormatError):  # no tare
        tares = read_points(path, ["tare"])
    if (path / "samples.csv").is_file():  # other columns are skipped to save memory
        samples = read_samples(path, [*_SAMPLED, *speed_columns(sample_names(path))])
    return SweepRun(
        path=path,
        metadata=metadata,
        plan_text=run.plan_text,
        rig=run_rig(path, metadata),
        points=points,
        tares=tares,
        samples=samples,
        settings=settings,
        thrust_error_N=_combine_errors(settings, "thrust_sd_N", points, thrust_se_N),
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


def _ratio(points: Recording, settings: Recording) -> tuple[str, Array, Array]:
    """Return T_IGE/T_OGE of each setting at equal squared speed, else at equal pulse width."""
    has_rpm2 = np.isfinite(settings.column("ratio_equal_rpm2")).any()
    basis = "equal_rpm2" if has_rpm2 else "equal_pwm"
    ratio, sd = settings.column(f"ratio_{basis}"), f"ratio_{basis}_sd"
    try:
        point_error = ratios(points, basis).total_error
    except InputError:  # no references
        return basis, ratio, settings.column(sd)
    return basis, ratio, _combine_errors(settings, sd, points, point_error)


def _combine_errors(settings: Recording, sd: str, points: Recording, point_error: Array) -> Array:
    """Return the larger of sd over repeats and mean standard error of a point (s,)."""
    numbers = points.column("setting")
    single = np.full(len(settings), np.nan)
    for row, number in enumerate(settings.column("setting")):
        errors = point_error[(numbers == number) & np.isfinite(point_error)]
        if errors.size:
            single[row] = errors.mean()
    return np.asarray(np.fmax(settings.column(sd), single), float)


SHOWN_EVENTS = 60  # maximum number of events in the table; events.jsonl contains all
_LIMITS = {  # limits of a rig: label, unit, begin of channel names
    "thrust_N": ("thrust", "N", "thrust_N"),
    "rpm": ("rotor speed", "rpm", "rpm"),
    "current_A": ("current", "A", "current_A"),
    "temperature_degC": ("temperature", "°C", "temperature_degC"),
    "pwm_us": ("pulse", "µs", "pwm"),
}


def settings_table(run: SweepRun) -> Table:
    """Return a table of settings: distance, pulse width, speed, thrust, ratio."""
    rpms = np.nan_to_num(run.of_rotors("rpm{}"))
    n_driven = (rpms > 0.0).sum(axis=0)
    mean_rpm = np.where(n_driven > 0, rpms.sum(axis=0) / np.maximum(n_driven, 1), np.nan)
    columns = (
        *(run.measured(), run.z_over_R(run.settings), run.level_us(), run.column("n_repeats")),
        *(mean_rpm, run.column("thrust_N"), run.thrust_error_N, run.ratio, run.ratio_error),
        *(run.column("plate_x_m"), run.column("plate_tilt_deg")),
    )
    rows = []
    for near, z, level, repeats, rpm, thrust, error, ratio, ratio_error, *offsets in zip(
        *(column.tolist() for column in columns), strict=True
    ):
        shifted = [
            f"{value:g} {unit}"
            for value, unit in zip(offsets, ("m shifted", "° tilted"), strict=True)
            if abs(value) > 1e-6  # False for nan
        ]
        rows.append(
            (
                " ".join([f"{z:.3g}" if near else "parked", *shifted]),
                f"{level:g}",
                f"{repeats:.0f}",
                format_number(rpm, ".0f"),
                value_with_sd(thrust, error),
                value_with_sd(ratio, ratio_error) if near and isfinite(ratio) else "–",
            )
        )
    if not run.uses_plate:
        head = ("pulse [µs]", "points", "mean rpm", "thrust [N]")
        caption = f"Throttle levels: means over repeats ± {ERRORS}."
        return Table(caption, head, [row[1:-1] for row in rows])
    return Table(
        f"Settings: means over repeats ± {ERRORS}. Ratios at {BASES[run.basis]}.",
        ("plate z/R", "pulse [µs]", "points", "mean rpm", "thrust [N]", "T_IGE/T_OGE"),
        rows,
    )


def quantity_tables(run: SweepRun) -> list[Block]:
    """Return tables of the quantities of each setting, and of their origin."""
    if not run.quantities:
        return []
    settings = settings_table(run)
    count = 2 if run.uses_plate else 1
    names = [[str(cell) for cell in row[:count]] for row in settings.rows]
    caption = "Quantities of each setting ± standard errors, including shared errors."
    return [
        values_table(caption, names, settings.header[:count], run.quantities),
        origins_table(run.quantities),
    ]


def tares_table(tares: Recording) -> Table:
    """Return a table of the load cell readings after each tare."""
    names = ("time_s", "thrust_N", "thrust_se_N", "n_samples")
    return Table(
        "Tares: load cell reading after the tare, motors at standstill.",
        ("time [min]", "offset [mN]", "samples"),
        [
            (f"{time / 60.0:.1f}", value_with_sd(1e3 * offset, 1e3 * se), f"{count:.0f}")
            for time, offset, se, count in zip(*map(tares.column, names), strict=True)
        ],
    )


def limits_table(run: SweepRun) -> Table:
    """Return a table of extreme readings and the limits of the rig."""
    limits, source = run.metadata["rig"]["limits"], run.samples or run.points
    rows = []
    for key, (label, unit, prefix) in _LIMITS.items():
        columns = [
            source.column(name)
            for name in source.names
            if name.startswith(prefix) and not name.endswith(("_se", "_sd_N", "_se_N", REJECTED))
        ]
        if key not in limits or not columns or not np.isfinite(columns).any():
            continue
        maximum = float(np.nanmax(columns))
        margin = f"{100.0 * (1.0 - maximum / limits[key]):.0f} %"
        rows.append((label, unit, f"{maximum:.4g}", f"{limits[key]:g}", margin))
    min_V = limits.get("voltage_min_V", 0.0)
    if "voltage_V" in source and np.isfinite(source.column("voltage_V")).any() and min_V:
        lowest_V = float(np.nanmin(source.column("voltage_V")))
        margin = f"{100.0 * (lowest_V / min_V - 1.0):.0f} %"
        rows.append(("battery, minimum", "V", f"{lowest_V:.4g}", f"{min_V:g}", margin))
    return Table(
        "Extreme readings and rig limits.",
        ("quantity", "unit", "reading", "limit", "margin"),
        rows,
        text_columns=2,
    )


def events_block(run: SweepRun) -> Block:
    """Return the events of a run, without device messages."""
    events = [event for event in run.events if event.event != "device"]
    device = len(run.events) - len(events)
    more = f" In events.jsonl: {pluralize(device, 'message')} of the device." if device else ""
    if len(events) > SHOWN_EVENTS:
        more += f" The first {SHOWN_EVENTS} of {len(events)} are shown."
    if not events:
        return "No events." + more
    return Table(
        "Events." + more,
        ("event", "text", "point", "time [s]"),
        [
            (event.event, event.text, str(event.point or "–"), f"{event.time_s:.1f}")
            for event in events[:SHOWN_EVENTS]
        ],
        text_columns=2,
    )
