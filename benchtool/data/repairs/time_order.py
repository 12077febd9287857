"""Put the rows of a stand's log in the order of time, and blank samples that leave it alone."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from math import nan

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.plural import pluralize
from benchtool.core.recording import Recording
from benchtool.data.quantities import dependent_quantities
from benchtool.data.repairs.import_result import Finding, ImportResult, Kind

Positions = NDArray[np.intp]

MAX_STEP_RATIO = 10.0  # steps back beyond are a new start; in the reference logs hundreds; assumed


def repair_time_order(read: ImportResult) -> ImportResult:
    """Return the import with times that never go backwards."""
    if "time_s" not in read.recording or len(read.recording) < 2:
        return read
    findings: list[Finding] = []

    def note(kind: Kind, what: str, words: str, at: Positions, count: int | None = None) -> None:
        many = at.size if count is None else count
        findings.append(Finding(kind, what, words, "time_s", many, read.lines_of(at)))

    time_s = read.recording.column("time_s").copy()
    known = np.isfinite(time_s)
    if not known.all():
        blank = np.flatnonzero(~known)
        words = f"{pluralize(blank.size, 'row')} without a time stay where they stand"
        note("doubt", "blank time", words, blank)
    rows = np.flatnonzero(known)
    ordered = time_s[rows]
    if not np.any(np.diff(ordered) < 0.0):
        return read.with_findings(findings)
    forward = np.diff(ordered)[np.diff(ordered) > 0.0]
    usual_s = float(np.median(forward)) if forward.size else 0.0
    _move_strays(ordered, rows, usual_s, note)
    _join_restarts(ordered, rows, usual_s, note)
    time_s[rows] = ordered
    mended = read.with_values("time_s", time_s)
    latest = np.maximum.accumulate(ordered)
    moved = np.flatnonzero(ordered < latest)
    if moved.size:
        words = (
            f"{pluralize(moved.size, 'row')} stamped up to {(latest - ordered).max():.3g} s before "
            f"an earlier row; all rows sorted by time"
        )
        note("repaired", "time goes backwards", words, rows[moved])
        order = np.arange(len(time_s))
        order[rows] = rows[np.argsort(ordered, kind="stable")]
        lines = None if read.lines is None else read.lines[order]
        mended = replace(mended, recording=mended.recording.select(order), lines=lines)
    return mended.with_findings(findings)


def _move_strays(time_s: Array, rows: Positions, usual_s: float, note: Callable[..., None]) -> None:
    """Mend single rows that are later than the row after them, with all else in order.

    The first row of a stand's log is often stamped with the time at which the log was started.
    """
    if time_s[0] > time_s[1] and time_s[0] - time_s[1] < MAX_STEP_RATIO * max(usual_s, 1e-9):
        words = (
            f"the first row is stamped {time_s[0]:.6g} s, the second {time_s[1]:.6g} s; the first "
            f"now carries the time of the second"
        )
        time_s[0] = time_s[1]
        note("repaired", "time goes backwards", words, rows[:1])
    before, here, after = time_s[:-2], time_s[1:-1], time_s[2:]
    far = MAX_STEP_RATIO * usual_s
    strays = 1 + np.flatnonzero(
        (after >= before) & (after - before < far) & ((here - after > far) | (before - here > far))
    )
    if strays.size:
        time_s[strays] = 0.5 * (time_s[strays - 1] + time_s[strays + 1])
        words = f"{pluralize(strays.size, 'row')} far off its neighbours; set between them"
        note("repaired", "stray time", words, rows[strays])


def _join_restarts(
    time_s: Array, rows: Positions, usual_s: float, note: Callable[..., None]
) -> None:
    """Shift what comes after a new start of the clock to the end of what was before it."""
    starts = 1 + np.flatnonzero(np.diff(time_s) < -MAX_STEP_RATIO * usual_s)
    original = time_s.copy()
    for start in starts.tolist():
        shift_s = float(time_s[start - 1] - time_s[start] + usual_s)
        time_s[start:] += shift_s
        words = (
            f"time starts anew ({original[start - 1]:.6g} s, then {original[start]:.6g} s): "
            f"another recording in the same file; from there {shift_s:.6g} s are added"
        )
        note("repaired", "time starts anew", words, rows[start : start + 1], len(time_s) - start)


_CHECKED = re.compile(r"rpm\d*(_optical)?|thrust_N|torque_Nm|current_A|voltage_V|theta_rad")

SPIKE_SHARE = 0.5  # of the range (1st to 99th percentile) there and back; assumed


def remove_spikes(read: ImportResult) -> ImportResult:
    """Blank spikes of speeds, which no rotor can follow; doubt those of other channels."""
    for name in read.recording.names:
        if not _CHECKED.fullmatch(name):
            continue
        values = read.recording.column(name)
        rows = find_spikes(values)
        rows = rows[~_with_throttle(read.recording, rows)]
        if not rows.size:
            continue
        worst = values[rows[np.argmax(np.abs(values[rows]))]]
        words = f"{pluralize(rows.size, 'reading')} up to {worst:g} between steady ones"
        kind: Kind = "doubt"
        if name.startswith("rpm"):
            kind, words = "repaired", f"{words}, now blank"
            blanked = values.copy()
            blanked[rows] = nan
            read = read.with_values(name, blanked)
            for other in dependent_quantities(name):
                if other in read.recording:
                    stale = read.recording.column(other).copy()
                    stale[rows] = nan
                    read = read.with_values(other, stale)
        found = Finding(kind, "spikes", words, name, rows.size, read.lines_of(rows))
        read = read.with_findings([found])
    return read


def _with_throttle(recording: Recording, rows: Positions) -> NDArray[np.bool_]:
    """Return in which of these rows the throttle jumps too, so that a rotor has reason to."""
    moved = np.zeros(rows.size, bool)
    for name in recording.names:
        if name.startswith("pwm"):
            pulse = recording.column(name)
            span = float(np.nanmax(pulse) - np.nanmin(pulse))
            for beside in (rows - 1, rows + 1):  # a spike has a row on either side
                moved |= np.abs(pulse[rows] - pulse[beside]) > 0.05 * span
    return moved


def find_spikes(values: Array) -> Positions:
    """Return the rows (k,) that hold a spike; blank rows are passed over."""
    rows = np.flatnonzero(np.isfinite(values))
    if rows.size < 7:
        return rows[:0]
    known = values[rows]
    some = known[:: max(1, rows.size // 20_000)]
    low, high = np.percentile(some, [1.0, 99.0]) if some.size > 100 else np.sort(known)[[1, -2]]
    before, here, after = known[:-2], known[1:-1], known[2:]
    up, down = here - before, here - after
    jump = np.minimum(np.abs(up), np.abs(down))
    found = (up * down > 0.0) & (jump > SPIKE_SHARE * max(high - low, 0.0))
    found &= (np.abs(after - before) < 0.1 * jump) & (jump > 0.2 * np.abs(before))
    return rows[1 + np.flatnonzero(found)]
