"""Find single samples that leave their neighbours and come back at once."""

from __future__ import annotations

import re
from math import nan

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.core.counted import counted
from benchtool.data.repairs.imported import Finding, Imported

_CHECKED = re.compile(r"rpm\d*(_optical)?|thrust_N|torque_Nm|current_A|voltage_V|theta_rad")
_SPEED = re.compile(r"rpm\d*(_optical)?")

SPIKE_SHARE = 0.5
"""A jump there and back of more than this share of a channel's range (1st to 99th percentile) is a
spike, where the neighbours agree within a tenth of the jump: a guess on the careful side."""


def mend_spikes(read: Imported) -> Imported:
    """Blank spikes of speeds, which no rotor can follow; doubt those of other channels."""
    for name in read.recording.names:
        if not _CHECKED.fullmatch(name):
            continue
        values = read.recording.column(name)
        rows = spikes_in(values)
        rows = rows[~_throttled(read, rows)]
        if not rows.size:
            continue
        worst = values[rows[np.argmax(np.abs(values[rows]))]]
        at = read.lines_of(rows)
        if _SPEED.fullmatch(name):
            words = (
                f"{counted(rows.size, 'reading')} up to {worst:g} between steady ones, now blank"
            )
            blanked = values.copy()
            blanked[rows] = nan
            read = read.with_values(name, blanked)
            found = Finding("repaired", "spikes", words, name, rows.size, at)
        else:
            words = f"{counted(rows.size, 'reading')} up to {worst:g} between steady ones"
            found = Finding("doubt", "spikes", words, name, rows.size, at)
        read = read.with_findings([found])
    return read


def _throttled(read: Imported, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Tell in which of these rows the throttle jumps too, so that a rotor has reason to."""
    commanded = [name for name in read.recording.names if name.startswith("pwm")]
    moved = np.zeros(rows.size, bool)
    for name in commanded:
        pulse = read.recording.column(name)
        span = float(np.nanmax(pulse) - np.nanmin(pulse))
        # A spike has a row on either side.
        moved |= np.abs(pulse[rows] - pulse[rows - 1]) > 0.05 * span
        moved |= np.abs(pulse[rows] - pulse[rows + 1]) > 0.05 * span
    return moved


def spikes_in(values: Array) -> NDArray[np.intp]:
    """Return the rows (k,) that hold a spike; blank rows are passed over."""
    rows = np.flatnonzero(np.isfinite(values))
    if rows.size < 7:
        return rows[:0]
    known = values[rows]
    some = known[:: max(1, rows.size // 20_000)]
    low, high = np.percentile(some, [1.0, 99.0]) if some.size > 100 else _without_extremes(known)
    limit = SPIKE_SHARE * (high - low)
    before, here, after = known[:-2], known[1:-1], known[2:]
    up, down = here - before, here - after
    jump = np.minimum(np.abs(up), np.abs(down))
    found = (up * down > 0.0) & (jump > max(limit, 0.0)) & (np.abs(after - before) < 0.1 * jump)
    found &= jump > 0.2 * np.abs(before)
    return rows[1 + np.flatnonzero(found)]


def _without_extremes(values: Array) -> tuple[float, float]:
    ordered = np.sort(values)
    return float(ordered[1]), float(ordered[-2])
