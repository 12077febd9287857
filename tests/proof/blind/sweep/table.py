"""The table of a sweep: readings with noise, in the columns of a run's points.csv."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tests.proof.blind.sweep.bench import Bench
from tests.proof.blind.sweep.programme import Programme
from tests.proof.blind.sweep.readings import Columns, Drive, cell_N, driven, thrust_N

Array = NDArray[np.float64]

RPM = 30.0 / np.pi
RPM_SE = 1.4
"""Standard error of a visit's mean speed, as an optical counter leaves after two seconds."""

SAMPLES = 160
DEGREES_OF_SE = 40  # a standard error from so many independent samples is itself uncertain


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Part:
    """Hold one part of a record: its table, and what is true of it, for scoring only."""

    table: pd.DataFrame  # as `points.csv`
    bench: Bench  # as it was on that day
    plan: Programme  # what was visited
    rows: Columns  # the plan's columns, tares among them (m,)
    drive: Drive  # what the motors truly did
    scatter_m: Array  # true departures of the plate from visit to visit (m,)
    force_N: Array  # on the load cell, true (m,)
    se_N: Array  # true standard errors (m,)
    kept: NDArray[np.bool_]  # rows of the table among those of the plan (m,)


def swept(bench: Bench, plan: Programme, rng: np.random.Generator) -> Part:
    """Run a programme on a bench."""
    rows = Columns.of(plan)
    drive = driven(bench, rows)
    m = len(rows.z_m)
    scatter = bench.plate_scatter_m * rng.standard_normal(m)
    force = thrust_N(bench, rows, drive.speed_rad_s, scatter)
    reading = cell_N(bench, rows, force, drive.speed_rad_s)
    se = bench.noise_ratio * bench.layout.se_N * (0.5 + 0.5 * force / bench.layout.hover_N)
    shown = reading + se * rng.standard_normal(m)
    told = se * np.sqrt(rng.chisquare(DEGREES_OF_SE, m) / DEGREES_OF_SE)
    n = bench.layout.rotors
    rpm_se = np.where(rows.turning, RPM_SE, 0.0)
    rpm = RPM * drive.speed_rad_s + rpm_se * rng.standard_normal((n, m))
    rpm_told = rpm_se * np.sqrt(rng.chisquare(DEGREES_OF_SE, (n, m)) / DEGREES_OF_SE)
    setting, repeat = _settings(plan)
    number = np.cumsum(rows.turning)
    blank = np.where(rows.turning, 0.0, np.nan)
    tared = np.where(rows.turning, rows.tared_s, rows.middle_s)
    pulses = np.where(rows.turning, rows.level_us, np.nan)
    voltage = drive.voltage_V + 0.002 * rng.standard_normal(m)
    current = drive.current_A + 0.01 * rng.standard_normal(m)
    columns: dict[str, object] = {
        "point": np.where(rows.turning, number, 0),
        "kind": [visit.kind for visit in plan.visits],
        "setting": setting,
        "repeat": repeat,
        "time_s": rows.middle_s,
        "elapsed_s": rows.middle_s - tared,
        **{f"pwm{i + 1}_us": pulses for i in range(n)},
        **{f"rpm{i + 1}": rpm[i] for i in range(n)},
        **{f"rpm{i + 1}_se": rpm_told[i] for i in range(n)},
        "thrust_N": shown,
        "thrust_sd_N": told * np.sqrt(SAMPLES),
        "thrust_se_N": told,
        "n_samples": SAMPLES,
        "plate_z_m": rows.z_m + blank,
        "plate_x_m": rows.x_m + blank,
        "plate_tilt_deg": blank,
        "voltage_V": voltage + blank,
        "current_A": current + blank,
        "torque_Nm": np.nan,
        "temperature_degC": np.nan,
        "settled": 1,
    }
    kept = rows.turning | (plan.excitation == "rich")
    table = pd.DataFrame(columns)[kept].reset_index(drop=True)
    return Part(
        table=table,
        bench=bench,
        plan=plan,
        rows=rows,
        drive=drive,
        scatter_m=scatter,
        force_N=force,
        se_N=se,
        kept=kept,
    )


def _settings(plan: Programme) -> tuple[list[int], list[int]]:
    """Return the number of each visit's setting, and how often it had been visited; 0 for tares."""
    numbers: dict[tuple[float, float, float], int] = {}
    seen: dict[int, int] = {}
    settings, repeats = [], []
    for visit in plan.visits:
        if visit.kind == "tare":
            settings.append(0)
            repeats.append(0)
            continue
        key = (visit.z_m, visit.x_m, visit.level_us)
        number = numbers.setdefault(key, len(numbers) + 1)
        seen[number] = seen.get(number, 0) + 1
        settings.append(number)
        repeats.append(seen[number])
    return settings, repeats
