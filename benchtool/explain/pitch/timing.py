"""Estimation and correction of time offsets between channels of a pitch log.

The rate is the derivative of the angle, acceleration follows thrust without delay, and speed never
leads its pulse. An offset of 1 ms looks like 1 ms of lag, in closed loop one tolerance of damping.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt

from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.explain.pitch.resampling import find_segments
from benchtool.explain.pitch.sanity_checks import bridge_gaps, gyro_disagreement
from benchtool.physics.rotor import pitch_moment_Nm
from benchtool.simulate.pitch.filter_log import LoggedPitch

MIN_DURATION_S = 8.0  # of the longest segment, to estimate offsets
MIN_RATE_HZ = 90.0  # 1 ms is a tenth of a row; assumed
MAX_OFFSET_S = 0.08  # search range; larger offsets of a logger are unlikely
BLOCKS = 10  # of the jackknife for the standard error
MIN_SIGNIFICANCE = 5.0  # of an offset, in standard errors
MIN_CORRELATION = 0.95  # of two channels, for their offset to be meaningful
SENSOR_LIMIT_S = 0.001  # gyro against angle; a sensor's filter delays 0.5 ms at 300 Hz

# Beam against thrust, speed against pulses: air damping, friction, and a lag that a chirp does not
# separate from a delay cause offsets up to 5 ms.
DRIVE_LIMIT_S = 0.008

MAX_DIFFERENCE_S, MAX_DELAY_S = 0.004, 0.01  # of equal offsets, and of a delay; assumed

# Ratio of residual variances of low-pass and delay, below which a low-pass is assumed: 0.02 for
# filters of 6 to 12 Hz, at least 0.5 for delays.
MAX_VARIANCE_RATIO = 0.2

MIN_LAG_SHARE, MAX_LAG_SHARE = 0.3, 2.5  # of the stated motor lag; assumed
LAG_ROUNDS = 3  # refinements of the lag, to 0.5 %


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """Time offset of one channel after another."""

    offset_s: float
    se_s: float
    scale: float  # ratio of the later channel to the other
    correlation: float  # correlation after the shift

    def exceeds(self, limit_s: float) -> bool:
        """Return True if its absolute value exceeds the limit significantly."""
        size_s, min_s = abs(self.offset_s), limit_s + MIN_SIGNIFICANCE * self.se_s
        return min_s < size_s < MAX_OFFSET_S and self.correlation > MIN_CORRELATION

    @property
    def text(self) -> str:
        """Absolute offset ± its standard error in ms, as text."""
        return f"{1e3 * abs(self.offset_s):.1f} ± {1e3 * self.se_s:.2g} ms"

    def shift(
        self, logged: LoggedPitch, channel: str, late_s: float, limit_s: float, remarks: list[str]
    ) -> LoggedPitch:
        """Return the log with one channel shifted to earlier times; add a remark.

        Ends of pulses are held, those of other channels blank.
        """
        values = np.atleast_2d(getattr(logged, channel))
        rows = np.arange(values.shape[1])
        ends = {"left": np.nan, "right": np.nan} if channel != "pwm_us" else {}
        later = rows + late_s * logged.rate_Hz
        moved = np.array([np.interp(later, rows, row, **ends) for row in values])
        changed: dict[str, Any] = {channel: moved.reshape(getattr(logged, channel).shape)}
        error, shift = ("late", "earlier") if late_s > 0.0 else ("early", "later")
        remarks.append(
            f"{'rpm' if channel == 'speed_rad_s' else channel} is {1e3 * abs(late_s):.1f} ± "
            f"{1e3 * self.se_s:.2g} ms {error} (allowed: {1e3 * limit_s:g} ms), shifted to {shift} "
            f"times; log all channels on one clock"
        )
        return replace(logged, **changed)


def align_channels(logged: LoggedPitch, rig: Rig, name: str) -> tuple[LoggedPitch, list[str]]:
    """Return the log with time offsets corrected, and warnings on them.

    Raises:
        InputError: angle and rate are both late, which cannot be corrected.
    """
    segment, rate_Hz = _longest_segment(logged), logged.rate_Hz
    if len(segment) < MIN_DURATION_S * rate_Hz or rate_Hz < MIN_RATE_HZ:
        return logged, []
    remarks: list[str] = []
    has_gyro = np.isfinite(segment.gyro_rad_s).any()
    thrust = _thrust_offset(segment, rig)
    if warning := gyro_disagreement(segment):  # its phase gives no time offset
        remarks.append(warning)
        thrust = _thrust_offset(_without_gyro(segment), rig)
    elif has_gyro:
        angle = bridge_gaps(segment.theta_rad)
        sensors = estimate_offset(_integrate_gyro(segment), angle, rate_Hz, (0.5, 8.0))
        if sensors.exceeds(SENSOR_LIMIT_S):  # of the angle against the rate
            if _is_filtered(segment, sensors):
                remarks.append(
                    f"gyro_rad_s and theta_rad differ by {sensors.text}, as through a low-pass "
                    f"filter, which a shift cannot correct"
                )
                thrust = _thrust_offset(_without_gyro(segment), rig)
            else:
                is_angle = abs(thrust.offset_s + sensors.offset_s) > abs(thrust.offset_s) + 0.003
                channel = "theta_rad" if is_angle else "gyro_rad_s"
                shift_s = sensors.offset_s if is_angle else -sensors.offset_s
                logged = sensors.shift(logged, channel, shift_s, SENSOR_LIMIT_S, remarks)
                segment = _longest_segment(logged)
                thrust = _thrust_offset(segment, rig)
    pulses = None if logged.from_speeds else _pulse_offset(segment, rig)
    if pulses is not None and pulses.exceeds(DRIVE_LIMIT_S) and pulses.offset_s < 0.0:
        logged = pulses.shift(logged, "pwm_us", -pulses.offset_s, DRIVE_LIMIT_S, remarks)
    elif thrust.exceeds(DRIVE_LIMIT_S):
        if thrust.offset_s > 0.0:
            raise InputError(
                f"the beam of {name} responds {thrust.text} after the rotors' thrust; allowed: "
                f"{1e3 * DRIVE_LIMIT_S:g} ms; angle and rate were logged late; log all channels "
                f"on one clock"
            )
        # Late speeds are late against their pulses, too, where a delay may add to the offset.
        sum_s = pulses.offset_s + thrust.offset_s if pulses is not None else -np.inf
        if pulses is not None and -MAX_DIFFERENCE_S < sum_s < MAX_DELAY_S:
            has_delay = sum_s > MAX_DIFFERENCE_S
            shift_s = -thrust.offset_s if has_delay else pulses.offset_s
            logged = pulses.shift(logged, "speed_rad_s", shift_s, DRIVE_LIMIT_S, remarks)
    return logged, remarks


def estimate_offset(x: Array, y: Array, rate_Hz: float, band_Hz: tuple[float, float]) -> TimeOffset:
    """Return the time offset of y (n,) after x (n,) in a frequency band.

    Whole rows by cross-correlation, then fractions of a row by least squares on x and its slope;
    the standard error is a jackknife over blocks of the recording.
    """
    sos = butter(2, (band_Hz[0], min(band_Hz[1], 0.4 * rate_Hz)), "band", fs=rate_Hz, output="sos")
    x, y = sosfiltfilt(sos, x), sosfiltfilt(sos, y)
    rows, max_rows = np.arange(len(x)), round(MAX_OFFSET_S * rate_Hz)
    inner = slice(max_rows, len(x) - max_rows)
    target = y[inner]
    shifts = range(-max_rows, max_rows + 1)
    products = [x[max_rows - k : len(x) - max_rows - k] @ target for k in shifts]
    rows_late, coefficients = float(shifts[int(np.argmax(products))]), np.array([1.0, 0.0])
    for _ in range(5):
        rows_late -= coefficients[1] / coefficients[0]
        shifted = np.interp(rows - rows_late, rows, x)
        columns = np.stack([shifted, np.gradient(shifted)], axis=1)[inner]
        coefficients, blocks = _solve_jackknife(columns, target)
    shift = blocks[:, 1] / blocks[:, 0]
    se = np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((shift - shift.mean()) ** 2))
    correlation = float(np.corrcoef(columns[:, 0], target)[0, 1])
    return TimeOffset(rows_late / rate_Hz, float(se) / rate_Hz, float(coefficients[0]), correlation)


def _solve_jackknife(columns: Array, y: Array) -> tuple[Array, Array]:
    """Return least squares (k,) of y (n,) on columns (n, k), and without each block."""
    edges = np.linspace(0, len(y), BLOCKS + 1).astype(int)
    parts = [slice(first, last) for first, last in pairwise(edges)]
    grams = np.array([columns[part].T @ columns[part] for part in parts])
    right = np.array([columns[part].T @ y[part] for part in parts])
    total, sums = grams.sum(axis=0), right.sum(axis=0)
    pairs = zip(grams, right, strict=True)
    jackknife = np.array([np.linalg.solve(total - a, sums - b) for a, b in pairs])
    return np.linalg.solve(total, sums), jackknife


def _longest_segment(logged: LoggedPitch) -> LoggedPitch:
    """Return the longest segment without dropouts."""
    longest = max(find_segments(logged.mode), key=lambda part: part.stop - part.start)
    return logged.between(longest.start, longest.stop)


def _integrate(values: Array, rate_Hz: float) -> Array:
    """Return the integral over time (n,), by trapezoids."""
    return (np.cumsum(values) - 0.5 * values) / rate_Hz


def _without_gyro(logged: LoggedPitch) -> LoggedPitch:
    return replace(logged, gyro_rad_s=np.nan * logged.theta_rad)


def _integrate_gyro(logged: LoggedPitch) -> Array:
    return _integrate(bridge_gaps(logged.gyro_rad_s), logged.rate_Hz)


def _is_filtered(logged: LoggedPitch, offset: TimeOffset) -> bool:
    """Return True if a low-pass explains the offset of angle and rate better than a delay."""
    rate_Hz = logged.rate_Hz
    first, second = bridge_gaps(logged.theta_rad), _integrate_gyro(logged)
    if offset.offset_s > 0.0:  # the angle comes after the rate
        first, second = second, first
    lagged = _apply_lag(first, abs(offset.offset_s), rate_Hz)
    variance = 1.0 - estimate_offset(lagged, second, rate_Hz, (0.5, 8.0)).correlation ** 2
    return variance < MAX_VARIANCE_RATIO * (1.0 - offset.correlation**2)


def _apply_lag(values: Array, lag_s: float, rate_Hz: float) -> Array:
    """Return values (n,) after a first-order lag; each is held from its row to the next."""
    decay = np.exp(-1.0 / (rate_Hz * lag_s))
    lagged = lfilter([1.0 - decay], [1.0, -decay], values - values[0]) + values[0]
    return np.append(lagged[:1], lagged[:-1])


def _thrust_offset(logged: LoggedPitch, rig: Rig) -> TimeOffset:
    """Return the time offset of the beam's rate after the sum of the rotors' moments."""
    p, rate_Hz = rig.propulsion, logged.rate_Hz
    speeds = logged.speed_rad_s
    if logged.from_speeds:
        speeds = p.speed_per_us_rad_s * (logged.pwm_us - p.pwm_start_us)
    if np.isfinite(speeds).mean(axis=1).min() < 0.5:
        return TimeOffset(0.0, np.inf, 1.0, 0.0)
    thrusts = p.thrust_coefficient_N_s2 * np.array([bridge_gaps(row) for row in speeds]) ** 2
    moment = np.asarray(pitch_moment_Nm(thrusts, rig.disc_positions_m[:, 0]), float)
    rate = logged.gyro_rad_s
    if not np.isfinite(rate).any():
        rate = np.gradient(bridge_gaps(logged.theta_rad)) * rate_Hz
    return estimate_offset(_integrate(moment, rate_Hz), bridge_gaps(rate), rate_Hz, (2.0, 12.0))


def bench_numbers(logged: LoggedPitch, rig: Rig) -> dict[str, float]:
    """Return numbers that identify a bench: speed over pulse, acceleration over thrust."""
    segment, p, numbers = _longest_segment(logged), rig.propulsion, dict[str, float]()
    commanded = p.speed_per_us_rad_s * (logged.pwm_us - p.pwm_start_us)
    measured = logged.speed_rad_s
    is_valid = np.isfinite(measured) & (commanded > 0.0)
    if is_valid.any():
        numbers["speed over pulse"] = float(np.median(measured[is_valid] / commanded[is_valid]))
    if len(segment) >= MIN_DURATION_S * logged.rate_Hz and logged.rate_Hz > MIN_RATE_HZ:
        offset = _thrust_offset(segment, rig)
        if offset.correlation > MIN_CORRELATION:
            numbers["acceleration over thrust"] = offset.scale
    return numbers


def _pulse_offset(logged: LoggedPitch, rig: Rig) -> TimeOffset | None:
    """Return the time offset of speeds after their pulses, in addition to a first-order lag.

    Lag and offset are both fitted; None if speeds or changes of the pulses are missing.
    """
    p, rate_Hz = rig.propulsion, logged.rate_Hz
    if np.isfinite(logged.speed_rad_s).mean(axis=1).min() < 0.5:
        return None
    arms = rig.disc_positions_m[:, 0] - rig.disc_positions_m[:, 0].mean()
    commanded = arms @ (p.speed_per_us_rad_s * (logged.pwm_us - p.pwm_start_us))
    measured = arms @ np.array([bridge_gaps(row) for row in logged.speed_rad_s])
    if np.ptp(commanded) == 0.0:
        return None

    def fit(lag_s: float) -> TimeOffset:
        lagged = _apply_lag(commanded, lag_s, rate_Hz)
        return estimate_offset(lagged, measured, rate_Hz, (0.5, 20.0))

    nominal_s = max(p.lag_s, 2.0 / rate_Hz)
    lags = np.geomspace(MIN_LAG_SHARE * nominal_s, MAX_LAG_SHARE * nominal_s, 9)
    for _ in range(LAG_ROUNDS):  # four times finer each, around the best
        best_s = max(lags, key=lambda lag_s: fit(float(lag_s)).correlation)
        step = (lags[1] / lags[0]) ** 0.25
        lags = best_s * step ** np.arange(-4, 5)
    return fit(float(best_s))
