"""Put the rows of a stand's log in the order of time, and say what was moved."""

from __future__ import annotations

import re
from dataclasses import replace
from math import nan

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.core.counted import counted
from benchtool.data.repairs.imported import Finding, Imported

FAR_STEPS = 10.0
"""A step back of more than this many usual steps is a new start, a smaller one a disorder: a guess
that holds in the reference logs, where disorder is below one step and restarts are hundreds."""


def mend_time(read: Imported) -> Imported:
    """Return the import with times that never go backwards."""
    if "time_s" not in read.recording or len(read.recording) < 2:
        return read
    time_s = read.recording.column("time_s").copy()
    findings: list[Finding] = []
    known = np.isfinite(time_s)
    if not known.all():
        rows = np.flatnonzero(~known)
        words = f"{counted(rows.size, 'row')} without a time stay where they stand"
        findings.append(
            Finding("doubt", "blank time", words, "time_s", rows.size, read.lines_of(rows))
        )
    rows = np.flatnonzero(known)
    ordered = time_s[rows]
    if not np.any(np.diff(ordered) < 0.0):
        return read.with_findings(findings)
    usual_s = _usual_step(ordered)
    _move_strays(ordered, rows, usual_s, read, findings)
    _follow_on(ordered, rows, usual_s, read, findings)
    time_s[rows] = ordered
    if not np.any(np.diff(ordered) < 0.0):
        return read.with_values("time_s", time_s).with_findings(findings)
    return _sorted(read.with_values("time_s", time_s), ordered, rows, findings)


def _usual_step(time_s: Array) -> float:
    steps = np.diff(time_s)
    forward = steps[steps > 0.0]
    return float(np.median(forward)) if forward.size else 0.0


def _move_strays(
    time_s: Array, rows: NDArray[np.intp], usual_s: float, read: Imported, findings: list[Finding]
) -> None:
    """Mend single rows that are later than the row after them, with all else in order.

    The first row of a stand's log is often stamped with the time at which the log was asked for.
    """
    if time_s[0] > time_s[1] and time_s[0] - time_s[1] < FAR_STEPS * max(usual_s, 1e-9):
        words = (
            f"the first row is stamped {time_s[0]:.6g} s, the second {time_s[1]:.6g} s; the first "
            f"now carries the time of the second"
        )
        time_s[0] = time_s[1]
        at = read.lines_of(rows[:1])
        findings.append(Finding("repaired", "time goes backwards", words, "time_s", 1, at))
    before, here, after = time_s[:-2], time_s[1:-1], time_s[2:]
    far = FAR_STEPS * usual_s
    strays = 1 + np.flatnonzero(
        (after >= before) & (after - before < far) & ((here - after > far) | (before - here > far))
    )
    if strays.size:
        time_s[strays] = 0.5 * (time_s[strays - 1] + time_s[strays + 1])
        words = f"{counted(strays.size, 'row')} far off its neighbours; set between them"
        findings.append(
            Finding(
                "repaired", "stray time", words, "time_s", strays.size, read.lines_of(rows[strays])
            )
        )


def _follow_on(
    time_s: Array, rows: NDArray[np.intp], usual_s: float, read: Imported, findings: list[Finding]
) -> None:
    """Shift what comes after a new start of the clock, so that it follows on."""
    starts = 1 + np.flatnonzero(np.diff(time_s) < -FAR_STEPS * usual_s)
    original = time_s.copy()
    for start in starts.tolist():
        shift_s = float(time_s[start - 1] - time_s[start] + usual_s)
        time_s[start:] += shift_s
        words = (
            f"time starts anew ({original[start - 1]:.6g} s, then {original[start]:.6g} s): "
            f"another recording in the same file; from there {shift_s:.6g} s are added"
        )
        at = read.lines_of(rows[start : start + 1])
        count = len(time_s) - start
        findings.append(Finding("repaired", "time starts anew", words, "time_s", count, at))


def _sorted(
    read: Imported, time_s: Array, rows: NDArray[np.intp], findings: list[Finding]
) -> Imported:
    moved = np.flatnonzero(time_s < np.maximum.accumulate(time_s))
    worst_s = float((np.maximum.accumulate(time_s) - time_s).max())
    order = np.arange(len(read.recording))
    order[rows] = rows[np.argsort(time_s, kind="stable")]
    words = (
        f"{counted(moved.size, 'row')} stamped up to {worst_s:.3g} s before an earlier row; all "
        f"rows sorted by time"
    )
    at = read.lines_of(rows[moved])
    findings.append(Finding("repaired", "time goes backwards", words, "time_s", moved.size, at))
    lines = None if read.lines is None else read.lines[order]
    return replace(read, recording=read.recording.select(order), lines=lines).with_findings(
        findings
    )


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
