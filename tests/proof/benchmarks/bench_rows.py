"""A sample from parsed frame to the disk's buffer, limits included, and a point.

A reader at 1 kHz gets one to five rows of 12 channels at once.
"""

from __future__ import annotations

import csv
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

from benchtool.bench.limit_check import LimitCheck
from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.columns import find_channel
from benchtool.data.run.append import SampleWriter
from benchtool.data.run.points import PointWriter
from tests.proof.benchmarks.rows import Row
from tests.unit.data.run_of import point

RIG = load_rig_by_name("pquad_single")
NAMES = (
    *("pwm1_us", "rpm1", "thrust_N", "thrust_raw", "torque_Nm", "plate_z_m", "plate_x_m"),
    *("plate_tilt_deg", "voltage_V", "current_A", "temperature_degC", "vibration"),
)


def sample_rows(count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    typical = np.array([1500, 4500, 2.2, 8123, 0.05, 0.12, 0.001, 0.5, 11.1, 3.4, 40, 0.2], float)
    values = np.round(typical * (1.0 + 0.01 * rng.normal(size=(count, 12))), 4)
    values[rng.random(values.shape) < 0.2] = np.nan
    return np.arange(count) / 1000.0, values


def ours(folder: Path, count: int, at_once: int, *, limits: bool) -> float:
    """Return the cost of one row: us."""
    channels = tuple(find_channel(name) for name in NAMES)
    writer = SampleWriter(folder / f"samples-{at_once}-{limits}.csv", channels)
    check = LimitCheck(channels, RIG, RIG.limits, 1.0, 0.0)
    time_s, values = sample_rows(count)
    begun = process_time()
    for i in range(0, count, at_once):
        block, at = values[i : i + at_once], time_s[i : i + at_once]
        if limits and (breach := check.find_violation(at, block)) is not None:
            raise breach
        writer.append(1, "sample", at, 1e6 * at, block)
    spent = process_time() - begun
    writer.close()
    return 1e6 * spent / count


def plain_csv(folder: Path, count: int) -> float:
    """Return the cost of one row through the csv module with a flush: us."""
    time_s, values = sample_rows(count)
    with open(folder / "plain.csv", "w", newline="") as file:
        writer = csv.writer(file)
        begun = process_time()
        for at, row in zip(time_s.tolist(), values.tolist(), strict=True):
            writer.writerow([at, 1e6 * at, 1, "sample", *row])
            file.flush()
        return 1e6 * (process_time() - begun) / count


def one_point(folder: Path) -> tuple[float, float]:
    """Return the time of a point with its fsync, and of a bare fsync of as many bytes: us."""
    a_point = point(1, "measure", 1, 1, 2.2)
    writer = PointWriter(folder / "points.csv", 1)
    begun = perf_counter()
    for _ in range(300):
        writer.append(a_point)
    cost = perf_counter() - begun
    writer.close()
    with open(folder / "bare", "wb", buffering=0) as file:
        begun = perf_counter()
        for _ in range(300):
            file.write(b"x" * 120)
            os.fsync(file.fileno())
        bare = perf_counter() - begun
    return 1e6 * cost / 300, 1e6 * bare / 300


def rows(quick: bool) -> Iterator[Row]:
    """Yield rows written alone and with limits, one and five at once, and a point."""
    count = 500 if quick else 40_000
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plain_us = plain_csv(folder, count)
        for at_once in (1, 5):
            for limits in (False, True):
                row_us = ours(folder, count, at_once, limits=limits)
                work = f"rows, {at_once} at once, {'limits and ' * limits}file"
                wanted = 15.0 if limits and at_once == 1 else None
                yield Row(work, row_us, "us", plain_us, "csv module with flush", wanted)
        point_us, bare_us = one_point(folder)
        yield Row("a point with its fsync", point_us, "us", bare_us, "fsync alone")
