"""Doubt a thrust that is not zero at rest, that points the wrong way, or that never moves."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from math import isfinite

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.data.columns import speed_columns
from benchtool.data.quantities import dependent_quantities
from benchtool.data.repairs.import_result import Finding, ImportOptions, ImportResult
from benchtool.data.repairs.pole_count import check_speed_scale

UNTARED_SHARE = 0.015  # of the range; tared cells stay within 1 %, untared read 2 %; assumed
UNTARED_EXTRAPOLATED = 0.1  # propellers leave the law of rpm^2 by some per cent; assumed

_LIVING = re.compile(r"thrust_N|torque_Nm|rpm\d*(_optical)?|voltage_V|current_A|power_W|distance_m")


def check_readings_at_rest(recording: Recording) -> list[Finding]:
    """Return the doubts about the thrust's zero and sign."""
    if "thrust_N" not in recording:
        return []
    thrust = recording.column("thrust_N")
    known = np.isfinite(thrust)
    if np.count_nonzero(known) < 2:
        return []
    span = float(np.nanmax(thrust) - np.nanmin(thrust))
    found = []
    rest = estimate_zero(recording, "thrust_N")
    if span > 0.0 and rest is not None and abs(rest.value) > rest.limit * span:
        words = (
            f"{rest.where} it reads {rest.value:.4g} N, {abs(rest.value) / span:.0%} of its range: "
            f"never tared, or the zero drifted; --tare thrust_N takes it off"
        )
        found.append(Finding("doubt", "untared", words, "thrust_N"))
    zero = 0.0 if rest is None else rest.value
    loaded = thrust[known & (np.abs(thrust - zero) > 0.1 * span)] - zero
    if loaded.size and np.count_nonzero(loaded < 0.0) > 0.9 * loaded.size:
        words = (
            f"{np.count_nonzero(loaded < 0.0)} of {loaded.size} loaded rows are negative: a pusher "
            f"mount or a cell the other way round; --flip thrust_N turns it"
        )
        found.append(Finding("doubt", "wrong sign", words, "thrust_N", int(loaded.size)))
    return found


@dataclass(frozen=True, slots=True)
class ZeroOffset:
    """What a channel reads without load, how that is known, and from what share it is doubted."""

    value: float
    where: str
    limit: float = UNTARED_SHARE


def estimate_zero(recording: Recording, name: str) -> ZeroOffset | None:
    """Return what a channel reads at rest, or where no row is at rest, extrapolated to it.

    Without speeds rest is the lowest throttle. Extrapolated along rpm^2, which thrust and torque
    follow closely enough to show an untared cell.
    """
    values = recording.column(name)
    known = np.isfinite(values)
    speeds = [recording.column(item) for item in speed_columns(recording.names, "rpm")]
    throttle = next((item for item in ("pwm1_us", "pwm_raw") if item in recording), None)
    if not speeds or not np.any(np.nan_to_num(np.array(speeds)) > 0.0):
        if throttle is None:
            return None
        lowest = recording.column(throttle)
        rows = known & (lowest == _least(lowest))
        if not rows.any() or _least(lowest) == -_least(-lowest):
            return None
        return ZeroOffset(float(np.median(values[rows])), "at the lowest throttle")
    still = known & np.all(np.nan_to_num(np.array(speeds), nan=np.inf) == 0.0, axis=0)
    if throttle is not None and still.any():
        # A tachometer that has not caught on yet reads 0 under load.
        still &= recording.column(throttle) == _least(recording.column(throttle)[still])
    if still.any():
        return ZeroOffset(float(np.median(values[still])), "with rotors standing still")
    squared = np.sum(np.square(np.array(speeds)), axis=0)
    rows = known & np.isfinite(squared) & np.all(np.array(speeds) > 0.0, axis=0)
    if np.count_nonzero(rows) < 5 or np.ptp(squared[rows]) < 0.5 * np.max(squared[rows]):
        return None
    _, at_zero = np.polyfit(squared[rows] / np.max(squared[rows]), values[rows], 1)
    return ZeroOffset(float(at_zero), "extrapolated along rpm^2 to rest", UNTARED_EXTRAPOLATED)


def _least(values: Array) -> float:
    """Return the least number; nan, which equals nothing, where all are blank."""
    finite = values[np.isfinite(values)]
    return float(finite.min()) if finite.size else float("nan")


def constant_channels(recording: Recording) -> list[Finding]:
    """Return the doubts about channels that never change."""
    if len(recording) < 10:
        return []
    found = []
    for name in recording.names:
        if not _LIVING.fullmatch(name):
            continue
        values = recording.column(name)
        if _least(values) != -_least(-values):
            continue
        values = values[np.isfinite(values)]
        if values.size >= 10:
            words = f"it reads {values[0]:g} in every row: a dead channel"
            found.append(Finding("doubt", "dead channel", words, name, int(values.size)))
    return found


def apply_options(read: ImportResult, options: ImportOptions) -> ImportResult:
    """Return the import with the user's repairs of its channels."""

    def repaired(name: str, values: Array, what: str, words: str) -> ImportResult:
        finding = Finding("repaired", what, words, name)
        return read.with_values(name, values).with_findings([finding])

    for name in options.flip:
        read = repaired(name, -read.recording.column(name), "wrong sign", "sign reversed by --flip")
    for name in options.tare:
        zero = estimate_zero(read.recording, name)
        if zero is None:
            raise InputError(
                f"--tare {name}: no row is at rest and too few speeds to extrapolate; map the "
                f"channel with a column map"
            )
        words = f"{zero.value:.6g} taken off, what it reads {zero.where} by --tare"
        read = repaired(name, read.recording.column(name) - zero.value, "untared", words)
    for text in options.scale:
        name, sign, ratio = (part.strip() for part in text.partition("="))
        try:
            factor = float(Fraction(ratio))
        except (ValueError, ZeroDivisionError, OverflowError):
            factor = 0.0
        if not sign or not isfinite(factor) or factor == 0.0:
            raise InputError(f"--scale {text!r}: write it as CHANNEL=FACTOR, for example rpm1=1/6")
        values = factor * read.recording.column(name)
        read = repaired(name, values, "scale", f"multiplied by {ratio} by --scale")
    changed = (*options.flip, *options.tare, *(text.partition("=")[0] for text in options.scale))
    return _without_stale(read, dict.fromkeys(name.strip() for name in changed))


def _without_stale(read: ImportResult, changed: Iterable[str]) -> ImportResult:
    """Return the import without what the stand worked out from channels as they were before."""
    follow = [other for name in changed for other in dependent_quantities(name)]
    stale = [name for name in dict.fromkeys(follow) if name in read.recording]
    if not stale:
        return read
    words = f"worked out by the stand before the repair of {', '.join(changed)}: {', '.join(stale)}"
    finding = Finding("left out", "stale columns", words, count=len(stale))
    left = replace(read, recording=read.recording.drop(stale))
    return left.with_findings([finding])


def inspect_stand(read: ImportResult) -> ImportResult:
    """Return the import of a stand's log with what could not be mended doubted."""
    recording = read.recording
    constant = {name for name, source in read.sources.items() if source.startswith("constant ")}
    dead = [item for item in constant_channels(recording) if item.channel not in constant]
    found = [*check_readings_at_rest(recording), *dead, *check_speed_scale(recording)]
    if len(recording) == 1:
        words = "one row is no measurement series; nothing can be held against it"
        found.append(Finding("doubt", "single row", words, count=1))
    if "rpm1" not in recording and not any(item.what == "rpm" for item in read.findings):
        found.append(Finding("lacks", "rpm", "no speed stands in the file"))
    return read.with_findings(found)


def inspect_log(read: ImportResult) -> ImportResult:
    """Return the import of a flight log with its channels doubted."""
    recording = read.recording
    speeds = speed_columns(recording.names, "rpm")
    negative = [name for name in speeds if np.any(recording.column(name) < 0.0)]
    found = constant_channels(recording)
    if negative:
        words = "negative speeds, as ESCs report the sense of rotation, are left as they are"
        found.insert(0, Finding("doubt", "sign", words, ", ".join(negative)))
    return read.with_findings(found)
