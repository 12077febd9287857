"""Time order and spike repair of stand logs."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from math import nan

import numpy as np
from numpy.typing import NDArray

from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.data.quantities import dependent_quantities
from benchtool.data.repairs.import_result import Finding, ImportResult, Kind

Positions = NDArray[np.intp]

MAX_STEP_RATIO = 10.0  # larger steps back are a clock restart; hundreds in reference logs; assumed


def repair_time_order(result: ImportResult) -> ImportResult:
    """Return the import with times that never decrease."""
    if "time_s" not in result.recording or len(result.recording) < 2:
        return result
    findings: list[Finding] = []

    def note(kind: Kind, what: str, text: str, at: Positions, count: int | None = None) -> None:
        size = at.size if count is None else count
        findings.append(Finding(kind, what, text, "time_s", size, result.format_lines(at)))

    time_s = result.recording.column("time_s").copy()
    finite = np.isfinite(time_s)
    if not finite.all():
        blank = np.flatnonzero(~finite)
        text = f"{pluralize(blank.size, 'row')} without a time keep their position"
        note("doubt", "blank time", text, blank)
    rows = np.flatnonzero(finite)
    ordered = time_s[rows]
    if not np.any(np.diff(ordered) < 0.0):
        return result.with_findings(findings)
    forward = np.diff(ordered)[np.diff(ordered) > 0.0]
    usual_s = float(np.median(forward)) if forward.size else 0.0
    _move_strays(ordered, rows, usual_s, note)
    _join_restarts(ordered, rows, usual_s, note)
    time_s[rows] = ordered
    repaired = result.with_values("time_s", time_s)
    latest = np.maximum.accumulate(ordered)
    moved = np.flatnonzero(ordered < latest)
    if moved.size:
        text = (
            f"{pluralize(moved.size, 'row')} stamped up to {(latest - ordered).max():.3g} s before "
            f"an earlier row; sorted by time"
        )
        note("repaired", "time goes backwards", text, rows[moved])
        order = np.arange(len(time_s))
        order[rows] = rows[np.argsort(ordered, kind="stable")]
        lines = None if result.lines is None else result.lines[order]
        repaired = replace(repaired, recording=repaired.recording.select(order), lines=lines)
    return repaired.with_findings(findings)


def _move_strays(time_s: Array, rows: Positions, usual_s: float, note: Callable[..., None]) -> None:
    """Correct single rows whose time is far from that of both neighbours.

    The first row of a stand's log is often stamped with the time at which the log was started.
    """
    if time_s[0] > time_s[1] and time_s[0] - time_s[1] < MAX_STEP_RATIO * max(usual_s, 1e-9):
        text = (
            f"the first row is stamped {time_s[0]:.6g} s, the second {time_s[1]:.6g} s; the first "
            f"now has the time of the second"
        )
        time_s[0] = time_s[1]
        note("repaired", "time goes backwards", text, rows[:1])
    before, here, after = time_s[:-2], time_s[1:-1], time_s[2:]
    far = MAX_STEP_RATIO * usual_s
    strays = 1 + np.flatnonzero(
        (after >= before) & (after - before < far) & ((here - after > far) | (before - here > far))
    )
    if strays.size:
        time_s[strays] = 0.5 * (time_s[strays - 1] + time_s[strays + 1])
        text = f"{pluralize(strays.size, 'row')} far from its neighbours; set to their mean"
        note("repaired", "stray time", text, rows[strays])


def _join_restarts(
    time_s: Array, rows: Positions, usual_s: float, note: Callable[..., None]
) -> None:
    """Shift the times after a clock restart to continue those before it."""
    starts = 1 + np.flatnonzero(np.diff(time_s) < -MAX_STEP_RATIO * usual_s)
    original = time_s.copy()
    for start in starts.tolist():
        shift_s = float(time_s[start - 1] - time_s[start] + usual_s)
        time_s[start:] += shift_s
        text = (
            f"time restarts ({original[start - 1]:.6g} s, then {original[start]:.6g} s): another "
            f"recording in the same file; {shift_s:.6g} s added from there on"
        )
        note("repaired", "time starts anew", text, rows[start : start + 1], len(time_s) - start)


_CHECKED = re.compile(r"rpm\d*(_optical)?|thrust_N|torque_Nm|current_A|voltage_V|theta_rad")

SPIKE_SHARE = 0.5  # smallest jump over the range (1st to 99th percentile); assumed


def remove_spikes(result: ImportResult) -> ImportResult:
    """Blank spikes of speeds, which no rotor can follow; report those of other channels."""
    for name in result.recording.names:
        if not _CHECKED.fullmatch(name):
            continue
        values = result.recording.column(name)
        rows = find_spikes(values)
        rows = rows[~_follows_throttle(result.recording, rows)]
        if not rows.size:
            continue
        worst = values[rows[np.argmax(np.abs(values[rows]))]]
        text = f"{pluralize(rows.size, 'reading')} up to {worst:g} between steady ones"
        kind: Kind = "doubt"
        if name.startswith("rpm"):
            kind, text = "repaired", f"{text}, now blank"
            blanked = values.copy()
            blanked[rows] = nan
            result = result.with_values(name, blanked)
            for other in dependent_quantities(name):
                if other in result.recording:
                    stale = result.recording.column(other).copy()
                    stale[rows] = nan
                    result = result.with_values(other, stale)
        finding = Finding(kind, "spikes", text, name, rows.size, result.format_lines(rows))
        result = result.with_findings([finding])
    return result


def _follows_throttle(recording: Recording, rows: Positions) -> NDArray[np.bool_]:
    """Return for each of these rows whether the throttle changes too, which explains a spike."""
    moved = np.zeros(rows.size, bool)
    for name in recording.names:
        if name.startswith("pwm"):
            pulse = recording.column(name)
            span = float(np.nanmax(pulse) - np.nanmin(pulse))
            for neighbours in (rows - 1, rows + 1):  # a spike has a row on either side
                moved |= np.abs(pulse[rows] - pulse[neighbours]) > 0.05 * span
    return moved


def find_spikes(values: Array) -> Positions:
    """Return the rows (k,) with a spike; blank rows are ignored."""
    rows = np.flatnonzero(np.isfinite(values))
    if rows.size < 7:
        return rows[:0]
    valid = values[rows]
    part = valid[:: max(1, rows.size // 20_000)]
    low, high = np.percentile(part, [1.0, 99.0]) if part.size > 100 else np.sort(valid)[[1, -2]]
    before, here, after = valid[:-2], valid[1:-1], valid[2:]
    up, down = here - before, here - after
    jump = np.minimum(np.abs(up), np.abs(down))
    is_spike = (up * down > 0.0) & (jump > SPIKE_SHARE * max(high - low, 0.0))
    is_spike &= (np.abs(after - before) < 0.1 * jump) & (jump > 0.2 * np.abs(before))
    return rows[1 + np.flatnonzero(is_spike)]
