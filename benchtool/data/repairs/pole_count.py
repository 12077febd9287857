"""Check for wrong pole counts: speeds wrong by a ratio of small whole numbers."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import combinations
from math import pi

import numpy as np

from benchtool.core.recording import Recording
from benchtool.core.units import Array
from benchtool.data.columns import speed_columns
from benchtool.data.repairs.import_result import Finding

MAX_POLE_PAIRS = 14  # motors with more than 28 magnets are rare
LIKELY_EFFICIENCY = 0.9  # upper limit; small brushless motors reach about 85 %


def small_ratio(ratio: float, within: float = 0.03) -> Fraction | None:
    """Return the nearest ratio of small whole numbers, None if it is 1 or not within `within`."""
    if not np.isfinite(ratio) or not 1.0 / MAX_POLE_PAIRS <= ratio <= MAX_POLE_PAIRS:
        return None
    best = min(
        (Fraction(p, q) for p in range(1, MAX_POLE_PAIRS + 1) for q in range(1, 8)),
        key=lambda fraction: abs(float(fraction) / ratio - 1.0) + 0.002 * fraction.denominator,
    )
    return best if best != 1 and abs(float(best) / ratio - 1.0) < within else None


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
