"""Checks of zero offset, sign and constant channels, and the user's repairs of channels."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from math import isfinite

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.units import Array
from benchtool.data.columns import speed_columns
from benchtool.data.quantities import dependent_quantities
from benchtool.data.repairs.import_result import Finding, ImportOptions, ImportResult
from benchtool.data.repairs.pole_count import check_speed_scale

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
