"""Checks of stand logs (zero, sign, dead channels, pole count); repairs of time and spikes."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations
from math import nan, pi

import numpy as np
from numpy.typing import NDArray

from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.data.columns import speed_columns
from benchtool.data.quantities import dependent_quantities
from benchtool.data.repairs.import_result import Finding, ImportResult, Kind

Positions = NDArray[np.intp]

MAX_POLE_PAIRS = 14  # motors with more than 28 magnets are rare
LIKELY_EFFICIENCY = 0.9  # upper limit; small brushless motors reach about 85 %


def small_ratio(ratio: float) -> Fraction | None:
    """Return the nearest ratio of small whole numbers, None if it is 1 or not within 3 %."""
    if not np.isfinite(ratio) or not 1.0 / MAX_POLE_PAIRS <= ratio <= MAX_POLE_PAIRS:
        return None
    best = min(
        (Fraction(p, q) for p in range(1, MAX_POLE_PAIRS + 1) for q in range(1, 8)),
        key=lambda fraction: abs(float(fraction) / ratio - 1.0) + 0.002 * fraction.denominator,
    )
    return best if best != 1 and abs(float(best) / ratio - 1.0) < 0.03 else None


def check_speed_scale(recording: Recording) -> list[Finding]:
    """Return warnings about the speeds of one recording."""
    findings = []
    if "rpm1" in recording and "rpm1_optical" in recording:
        ratio = _ratio(recording.column("rpm1"), recording.column("rpm1_optical"))
        findings += _report_ratio(ratio, "the optical probe", "rpm1")
    rotors = speed_columns(recording.names, "rpm")
    if len(rotors) > 1 and not any(name.startswith("pwm2") for name in recording.names):
        for name in rotors:
            others = np.median(
                [recording.column(other) for other in rotors if other != name], axis=0
            )
            ratio = _ratio(recording.column(name), others)
            if abs(ratio - 1.0) > 0.25:
                findings += _report_ratio(ratio, "the other rotors at the same throttle", name)
    return findings + _check_efficiency(recording)


def _ratio(speed: Array, other_speed: Array) -> float:
    rows = np.isfinite(speed) & np.isfinite(other_speed) & (speed > 0.0) & (other_speed > 0.0)
    return float(np.median(speed[rows] / other_speed[rows])) if np.count_nonzero(rows) >= 3 else 1.0


def _report_ratio(ratio: float, against: str, name: str) -> list[Finding]:
    nearest = small_ratio(ratio)
    if nearest is None:
        return []
    text = (
        f"{ratio:.3g} times {against}, near {nearest}: possibly a wrong pole count; correct with "
        f"--scale {name}={1 / nearest}"
    )
    return [Finding("doubt", "rpm ratio", text, name)]


def _check_efficiency(recording: Recording) -> list[Finding]:
    """Return a doubt if shaft power is implausibly high for the electrical power."""
    needed = ("rpm1", "torque_Nm", "voltage_V", "current_A")
    if any(name not in recording for name in needed):
        return []
    rpm, torque, volts, amperes = (recording.column(name) for name in needed)
    electrical = volts * amperes
    rows = np.isfinite(rpm * torque * electrical) & (rpm > 0.0)
    if rows.any():
        rows &= electrical > max(0.2 * float(np.max(electrical[rows])), 1e-3)
    if not rows.any():
        return []
    shaft = np.abs(torque[rows]) * rpm[rows] * 2.0 * pi / 60.0
    efficiency = float(np.median(shaft / electrical[rows]))
    if efficiency < LIKELY_EFFICIENCY:
        return []
    text = (
        f"shaft power is {efficiency:.0%} of the electrical power: rpm too high (wrong pole "
        f"count), or zero offset of torque or current"
    )
    return [Finding("doubt", "impossible efficiency", text, "rpm1", int(np.count_nonzero(rows)))]


def compare_speeds(recordings: Sequence[tuple[str, Recording]]) -> dict[str, list[Finding]]:
    """Return warnings about files with different speeds at the same pulse width and thrust."""
    findings: dict[str, list[Finding]] = {name: [] for name, _ in recordings}
    curves = [(name, curve) for name, data in recordings if (curve := _curve(data)) is not None]
    for (name, first), (other_name, second) in combinations(curves, 2):
        low, high = max(first[0][0], second[0][0]), min(first[0][-1], second[0][-1])
        pulses = first[0][(first[0] >= low) & (first[0] <= high)]
        if pulses.size < 2:
            continue
        thrusts = [np.interp(pulses, curve[0], curve[1]) for curve in (first, second)]
        speeds = [np.interp(pulses, curve[0], curve[2]) for curve in (first, second)]
        is_alike = np.median(np.abs(thrusts[0] - thrusts[1])) < 0.15 * np.median(np.abs(thrusts[0]))
        ratio = float(np.median(speeds[0] / speeds[1]))
        nearest = small_ratio(ratio)
        if is_alike and nearest is not None and abs(ratio - 1.0) > 0.2:
            for path, against, factor in ((name, other_name, ratio), (other_name, name, 1 / ratio)):
                text = (
                    f"{factor:.3g} times the speed of {against} at equal pulse and thrust, near "
                    f"{small_ratio(factor) or nearest}: one of the two has a wrong pole count"
                )
                findings[path].append(Finding("doubt", "rpm ratio", text, "rpm1"))
    return findings


def _curve(recording: Recording) -> tuple[Array, Array, Array] | None:
    """Return pulse width, thrust and speed of complete rows, sorted by pulse width, or None."""
    if any(name not in recording for name in ("pwm1_us", "thrust_N", "rpm1")):
        return None
    pulse, thrust, rpm = (recording.column(name) for name in ("pwm1_us", "thrust_N", "rpm1"))
    rows = np.isfinite(pulse * thrust * rpm) & (rpm > 0.0)
    if np.count_nonzero(rows) < 2:
        return None
    order = np.flatnonzero(rows)[np.argsort(pulse[rows], kind="stable")]
    return pulse[order], thrust[order], rpm[order]


UNTARED_SHARE = 0.015  # of the range; tared load cells are within 1 %, untared at 2 %; assumed
UNTARED_EXTRAPOLATED = 0.1  # propellers deviate from rpm^2 by some per cent; assumed

_VARIES = re.compile(r"thrust_N|torque_Nm|rpm\d*(_optical)?|voltage_V|current_A|power_W|distance_m")


def check_readings_at_rest(recording: Recording, name: str) -> list[Finding]:
    """Return warnings about the sign of thrust or torque, and the zero offset of thrust."""
    values = recording.column(name) if name in recording else np.empty(0)
    finite = np.isfinite(values)
    if np.count_nonzero(finite) < 2:
        return []
    span = float(np.nanmax(values) - np.nanmin(values))
    findings = []
    offset = estimate_zero(recording, name)
    if name == "thrust_N" and offset and abs(offset.value) > offset.limit * span > 0.0:
        text = (
            f"{offset.where} it reads {offset.value:.4g} N, {abs(offset.value) / span:.0%} of its "
            f"range: not tared, or zero drift; --tare thrust_N subtracts it"
        )
        findings.append(Finding("doubt", "untared", text, "thrust_N"))
    zero = 0.0 if offset is None else offset.value
    loaded = values[finite & (np.abs(values - zero) > 0.1 * span)] - zero
    if loaded.size and np.count_nonzero(loaded < 0.0) > 0.9 * loaded.size:
        text = (
            f"{np.count_nonzero(loaded < 0.0)} of {loaded.size} loaded rows are negative: a pusher "
            f"mount, sense of rotation or a reversed load cell; --flip {name} reverses the sign"
        )
        findings.append(Finding("doubt", "wrong sign", text, name, int(loaded.size)))
    return findings


@dataclass(frozen=True, slots=True)
class ZeroOffset:
    """Reading of an unloaded channel."""

    value: float
    where: str  # rows it is from, for messages
    limit: float = UNTARED_SHARE  # largest share of the channel's range without a warning


def estimate_zero(recording: Recording, name: str) -> ZeroOffset | None:
    """Return the zero offset of a channel from rows at rest, or else extrapolated along rpm^2.

    Without speeds, rest is the lowest throttle. Thrust and torque follow rpm^2 closely enough to
    detect an untared load cell.
    """
    values = recording.column(name)
    finite = np.isfinite(values)
    speeds = [recording.column(column) for column in speed_columns(recording.names, "rpm")]
    throttle = next((column for column in ("pwm1_us", "pwm_raw") if column in recording), None)
    if not speeds or not np.any(np.nan_to_num(np.array(speeds)) > 0.0):
        if throttle is None:
            return None
        lowest = recording.column(throttle)
        rows = finite & (lowest == _min_finite(lowest))
        if not rows.any() or _min_finite(lowest) == -_min_finite(-lowest):
            return None
        return ZeroOffset(float(np.median(values[rows])), "at the lowest throttle")
    at_rest = finite & np.all(np.nan_to_num(np.array(speeds), nan=np.inf) == 0.0, axis=0)
    if throttle is not None and at_rest.any():
        # A tachometer that does not detect the rotor yet reads 0 under load.
        at_rest &= recording.column(throttle) == _min_finite(recording.column(throttle)[at_rest])
    if at_rest.any():
        return ZeroOffset(float(np.median(values[at_rest])), "with rotors standing still")
    squared = np.sum(np.square(np.array(speeds)), axis=0)
    rows = finite & np.isfinite(squared) & np.all(np.array(speeds) > 0.0, axis=0)
    if np.count_nonzero(rows) < 5 or np.ptp(squared[rows]) < 0.5 * np.max(squared[rows]):
        return None
    _, at_zero = np.polyfit(squared[rows] / np.max(squared[rows]), values[rows], 1)
    return ZeroOffset(float(at_zero), "extrapolated along rpm^2 to rest", UNTARED_EXTRAPOLATED)


def _min_finite(values: Array) -> float:
    """Return the smallest finite number, or nan, which is not equal to anything."""
    finite = values[np.isfinite(values)]
    return float(finite.min()) if finite.size else float("nan")


def constant_channels(recording: Recording) -> list[Finding]:
    """Return warnings about constant channels."""
    if len(recording) < 10:
        return []
    findings = []
    for name in recording.names:
        if not _VARIES.fullmatch(name):
            continue
        values = recording.column(name)[np.isfinite(recording.column(name))]
        if values.size >= 10 and np.ptp(values) == 0.0:
            text = f"it reads {values[0]:g} in every row"
            findings.append(Finding("doubt", "dead channel", text, name, int(values.size)))
    return findings


def inspect_stand(result: ImportResult) -> ImportResult:
    """Return the import of a test stand log with warnings about its channels."""
    recording = result.recording
    constant = {name for name, source in result.sources.items() if source.startswith("constant ")}
    dead = [finding for finding in constant_channels(recording) if finding.channel not in constant]
    thrust, torque = (check_readings_at_rest(recording, key) for key in ("thrust_N", "torque_Nm"))
    findings = [*thrust, *torque, *dead, *check_speed_scale(recording)]
    if len(recording) == 1:
        text = "one row is not a measurement series; no comparison is possible"
        findings.append(Finding("doubt", "single row", text, count=1))
    if "rpm1" not in recording and not any(finding.what == "rpm" for finding in result.findings):
        findings.append(Finding("lacks", "rpm", "no speed in the file"))
    return result.with_findings(findings)


def inspect_log(result: ImportResult) -> ImportResult:
    """Return the import of a flight log with warnings about its channels."""
    recording = result.recording
    speeds = speed_columns(recording.names, "rpm")
    negative = [name for name in speeds if np.any(recording.column(name) < 0.0)]
    findings = constant_channels(recording)
    if negative:
        text = "negative speeds, as ESCs report the sense of rotation, are unchanged"
        findings.insert(0, Finding("doubt", "sign", text, ", ".join(negative)))
    return result.with_findings(findings)


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
            for stale in (name, *dependent_quantities(name)):
                if stale in result.recording:
                    blanked = result.recording.column(stale).copy()
                    blanked[rows] = nan
                    result = result.with_values(stale, blanked)
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
    is_large = np.abs(np.diff(valid)) > SPIKE_SHARE * max(high - low, 0.0)
    spikes = 1 + np.flatnonzero(is_large[:-1] & is_large[1:])  # steps to and from a row
    before, here, after = valid[spikes - 1], valid[spikes], valid[spikes + 1]
    up, down = here - before, here - after
    jump = np.minimum(np.abs(up), np.abs(down))
    is_spike = (up * down > 0.0) & (np.abs(after - before) < 0.1 * jump)
    return rows[spikes[is_spike & (jump > 0.2 * np.abs(before))]]
