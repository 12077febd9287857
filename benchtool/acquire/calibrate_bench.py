"""Read raw counts of an unpowered bench for a calibration."""

from __future__ import annotations

import numpy as np

from benchtool.acquire.average import Average, average
from benchtool.bench.bench import Bench
from benchtool.core.array import Array
from benchtool.core.errors import CalibrationError

STEP_S = 0.1

WAITED_S = 0.5
"""Samples older than the mass: thrown away after the operator's answer; a choice."""


def require_raw_counts(bench: Bench) -> int:
    """Return the column of the raw counts, or refuse a device that gives none."""
    names = [channel.name for channel in bench.identity.channels]
    if "thrust_raw" not in names:
        raise CalibrationError(
            f"{bench.identity.address} streams no raw counts (thrust_raw), so its newtons can only "
            f"be calibrated in its own firmware"
        )
    return names.index("thrust_raw")


def mean_counts(bench: Bench, seconds: float) -> Average:
    """Return the raw counts averaged over so long; motors are not touched.

    Raises:
        CalibrationError: the load cell gave no value.
    """
    column = require_raw_counts(bench)
    _read(bench, WAITED_S, column)
    found = average(_read(bench, seconds, column))
    if found.n == 0:
        raise CalibrationError(
            f"the load cell gave no raw counts for {seconds:g} s; check its wiring"
        )
    return found


def _read(bench: Bench, seconds: float, column: int) -> Array:
    parts = []
    end_s = bench.now_s() + seconds
    while (left_s := end_s - bench.now_s()) > 1e-9:
        parts.append(bench.read(min(STEP_S, left_s)).values[:, column])
    return np.concatenate(parts) if parts else np.empty(0)
