"""Checks of stand channels: zero offset, sign, dead channels, pole count; repairs by the user."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations
from math import isfinite, pi

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.units import Array
from benchtool.data.columns import speed_columns
from benchtool.data.quantities import dependent_quantities
from benchtool.data.repairs.import_result import Finding, ImportOptions, ImportResult

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


def check_readings_at_rest(recording: Recording) -> list[Finding]:
    """Return warnings about zero offset and sign of the thrust."""
    if "thrust_N" not in recording:
        return []
    thrust = recording.column("thrust_N")
    finite = np.isfinite(thrust)
    if np.count_nonzero(finite) < 2:
        return []
    span = float(np.nanmax(thrust) - np.nanmin(thrust))
    findings = []
    offset = estimate_zero(recording, "thrust_N")
    if span > 0.0 and offset is not None and abs(offset.value) > offset.limit * span:
        text = (
            f"{offset.where} it reads {offset.value:.4g} N, {abs(offset.value) / span:.0%} of its "
            f"range: not tared, or zero drift; --tare thrust_N subtracts it"
        )
        findings.append(Finding("doubt", "untared", text, "thrust_N"))
    zero = 0.0 if offset is None else offset.value
    loaded = thrust[finite & (np.abs(thrust - zero) > 0.1 * span)] - zero
    if loaded.size and np.count_nonzero(loaded < 0.0) > 0.9 * loaded.size:
        text = (
            f"{np.count_nonzero(loaded < 0.0)} of {loaded.size} loaded rows are negative: a pusher "
            f"mount or a reversed load cell; --flip thrust_N reverses the sign"
        )
        findings.append(Finding("doubt", "wrong sign", text, "thrust_N", int(loaded.size)))
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
        values = recording.column(name)
        if _min_finite(values) != -_min_finite(-values):
            continue
        values = values[np.isfinite(values)]
        if values.size >= 10:
            text = f"it reads {values[0]:g} in every row"
            findings.append(Finding("doubt", "dead channel", text, name, int(values.size)))
    return findings


def apply_options(result: ImportResult, options: ImportOptions) -> ImportResult:
    """Return the import with the user's repairs of its channels."""

    def repaired(name: str, values: Array, what: str, message: str) -> ImportResult:
        finding = Finding("repaired", what, message, name)
        return result.with_values(name, values).with_findings([finding])

    for name in options.flip:
        values = -result.recording.column(name)
        result = repaired(name, values, "wrong sign", "sign reversed by --flip")
    for name in options.tare:
        zero = estimate_zero(result.recording, name)
        if zero is None:
            raise InputError(
                f"--tare {name}: no row at rest and too few speeds to extrapolate; map the channel "
                f"with a column map"
            )
        message = f"{zero.value:.6g} subtracted by --tare, its reading {zero.where}"
        result = repaired(name, result.recording.column(name) - zero.value, "untared", message)
    for text in options.scale:
        name, sign, ratio = (part.strip() for part in text.partition("="))
        try:
            factor = float(Fraction(ratio))
        except (ValueError, ZeroDivisionError, OverflowError):
            factor = 0.0
        if not sign or not isfinite(factor) or factor == 0.0:
            raise InputError(f"--scale {text!r}: write it as CHANNEL=FACTOR, for example rpm1=1/6")
        values = factor * result.recording.column(name)
        result = repaired(name, values, "scale", f"multiplied by {ratio} by --scale")
    changed = (*options.flip, *options.tare, *(text.partition("=")[0] for text in options.scale))
    return _drop_stale(result, dict.fromkeys(name.strip() for name in changed))


def _drop_stale(result: ImportResult, changed: Iterable[str]) -> ImportResult:
    """Return the import without quantities that the stand derived from unrepaired channels."""
    dependent = [other for name in changed for other in dependent_quantities(name)]
    stale = [name for name in dict.fromkeys(dependent) if name in result.recording]
    if not stale:
        return result
    text = f"derived by the stand before the repair of {', '.join(changed)}: {', '.join(stale)}"
    finding = Finding("left out", "stale columns", text, count=len(stale))
    remaining = replace(result, recording=result.recording.drop(stale))
    return remaining.with_findings([finding])


def inspect_stand(result: ImportResult) -> ImportResult:
    """Return the import of a test stand log with warnings about its channels."""
    recording = result.recording
    constant = {name for name, source in result.sources.items() if source.startswith("constant ")}
    dead = [finding for finding in constant_channels(recording) if finding.channel not in constant]
    findings = [*check_readings_at_rest(recording), *dead, *check_speed_scale(recording)]
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
