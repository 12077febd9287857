"""Sanity checks of pitch recordings: units, signs and order of rotors.

Such errors exceed any effect, so they are rejected with a remedy before effects are judged.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import butter, coherence, csd, savgol_filter, sosfiltfilt, welch

from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.physics.rotor import pitch_moment_Nm
from benchtool.simulate.pitch.filter_log import LoggedPitch

MAX_ANGLE_RAD = 1.6  # range of a hinge; angles in degrees exceed it
DERIVATIVE_WINDOW_S = 0.05  # of the quadratic for rates and accelerations; assumed
MIN_CORRELATION = 0.6  # or coherence, for a slope to be used; assumed
MAX_GYRO_RATIO = 3.0  # larger ratios mean another unit or sign; assumed
SLOW_HZ = 3.0  # below, gyro and encoder on one beam must agree; assumed
SEGMENT_S = 2.0  # of the spectra; assumed
MIN_BINS = 3  # consecutive bins of a band of the spectra; assumed
MAX_FREQUENCY_SHARE = 0.25  # of the rate; faster encoder motion is noise; assumed

# Correlation of beam and thrusts; noise over 1000 rows (shortest recording) is below 0.15; assumed.
MIN_BEAM_CORRELATION = 0.4

# Correlation of speed and pulses for swapping columns; wrong pairs are lower by at least
# `MIN_BEAM_CORRELATION`; assumed.
MIN_SPEED_CORRELATION = 0.8

# Cosine between estimated and geometric moment arms: 0.5 if a front and a side rotor are swapped,
# 0.9 with ground effect and unequal rotors; assumed.
MIN_ARM_COSINE = 0.75

MIN_SINGULAR_VALUE = 0.1  # of thrust patterns relative to the largest
MIN_MOTION = 5.0  # of the beam, in sd of the sensor noise; assumed


def check_consistency(logged: LoggedPitch, rig: Rig, name: str) -> None:
    """Check that the columns of a log are consistent.

    Raises:
        InputError: angle out of range; gyro and angle, or thrust and motion, contradict each other.
    """
    theta = logged.theta_rad
    max_rad = float(np.nanmax(np.abs(theta)))
    if max_rad > MAX_ANGLE_RAD:
        raise InputError(
            f"theta_rad of {name} reaches {max_rad:.3g} rad; allowed: {MAX_ANGLE_RAD:g} rad; "
            f"state the column's unit in the model's [columns], for example unit = \"deg\""
        )
    change, gyro = _differentiate(theta, logged.rate_Hz), logged.gyro_rad_s
    slow_change, slow_gyro = _slow(change, logged.rate_Hz), _slow(gyro, logged.rate_Hz)
    is_correlated = abs(_correlation(slow_change, slow_gyro)) >= MIN_CORRELATION
    slope = slow_change @ slow_gyro / (slow_change @ slow_change) if is_correlated else 1.0
    if not 1.0 / MAX_GYRO_RATIO < slope < MAX_GYRO_RATIO:
        raise InputError(
            f"gyro_rad_s of {name} is {slope:.2g} times the change of theta_rad below "
            f"{SLOW_HZ:g} Hz; expected: 1; correct the sign or the unit of one of them in the "
            f"model's [columns]"
        )
    rate = gyro if np.isfinite(gyro).any() else change
    acceleration = _differentiate(rate, logged.rate_Hz)
    moment = pitch_moment_Nm(_thrusts(logged, rig), rig.disc_positions_m[:, 0])
    agreement = _correlation(np.asarray(moment, float), acceleration)
    cosine, first, second = _compare_arms(logged, rig, acceleration)
    if abs(cosine) < MIN_ARM_COSINE:
        outer = np.argsort(-np.abs(_arms(rig)), kind="stable")[:2]
        expected = " and ".join(rig.rotors[rig.first_rotors[disc]].name for disc in outer)
        raise InputError(
            f"pwm columns of {name} do not match rig {rig.name!r}: the beam is turned by "
            f"pwm{first}_us and pwm{second}_us; expected: {expected}; record with the motor map "
            f"(map=FILE, see benchtool bench map), or swap the columns in the model's [columns]"
        )
    if agreement < -MIN_CORRELATION or cosine < 0.0:
        raise InputError(
            f"the beam of {name} turns against its thrust (correlation {agreement:.2f}): the order "
            f"of rotors or the sign of theta_rad differs from rig {rig.name!r}; swap the columns "
            f"of the rotors or change the sign in the model's [columns]"
        )


def _slow(values: Array, rate_Hz: float) -> Array:
    """Return values (n,) about their mean, low-passed at `SLOW_HZ`; gaps interpolated."""
    is_finite = np.isfinite(values)
    if not is_finite.any() or rate_Hz <= 2.0 * SLOW_HZ:
        return np.nan_to_num(values)
    low_pass = butter(2, SLOW_HZ, fs=rate_Hz, output="sos")
    filled = bridge_gaps(values)
    return np.asarray(sosfiltfilt(low_pass, filled - filled.mean()), float)


def gyro_disagreement(logged: LoggedPitch) -> str:
    """Return a warning if the gyro rate exceeds that of the encoder in a band, else ""."""
    is_finite = np.isfinite(logged.gyro_rad_s) & np.isfinite(logged.theta_rad)
    if is_finite.sum() < 2:
        return ""
    fs = logged.rate_Hz
    channels = logged.theta_rad, logged.gyro_rad_s
    theta, gyro = (bridge_gaps(np.where(is_finite, values, np.nan)) for values in channels)
    n = min(len(is_finite), round(SEGMENT_S * fs))
    frequency_Hz, cross = csd(theta, gyro, fs=fs, nperseg=n)
    spectrum = welch(theta, fs=fs, nperseg=n)[1]
    gain = np.abs(cross) / np.maximum(2.0 * np.pi * frequency_Hz * spectrum, 1e-300)
    high = (coherence(theta, gyro, fs=fs, nperseg=n)[1] > MIN_CORRELATION) & (gain > MAX_GYRO_RATIO)
    high &= (frequency_Hz > SLOW_HZ) & (frequency_Hz < MAX_FREQUENCY_SHARE * fs)
    bands = np.flatnonzero(np.convolve(high, np.ones(MIN_BINS), "valid") == MIN_BINS)
    if not len(bands):
        return ""
    first = int(bands[0])
    return (
        f"gyro_rad_s is {gain[first]:.2g} times the change of theta_rad at "
        f"{frequency_Hz[first]:.3g} Hz and agrees with it below {SLOW_HZ:g} Hz: gyro and encoder "
        f"are on parts with relative motion"
    )


def match_speeds(logged: LoggedPitch, rig: Rig) -> tuple[LoggedPitch, list[str]]:
    """Return the log with each speed assigned to its pulses, and warnings on swapped columns.

    Rotors with similar pulses, or without correlation, are not reassigned.
    """
    commanded, measured = np.sqrt(_thrusts(logged, rig)), logged.speed_rad_s
    if rig.n_discs < 2 or logged.from_speeds or np.isfinite(measured).mean(axis=1).min() < 0.5:
        return logged, []
    commanded, measured = commanded - commanded.mean(axis=0), measured - measured.mean(axis=0)
    similar = np.array([[_correlation(pulse, speed) for speed in measured] for pulse in commanded])
    order = np.argmax(similar, axis=1)
    if len(set(order.tolist())) < rig.n_discs:
        return logged, []
    current, best = np.diag(similar), similar[np.arange(rig.n_discs), order]
    swapped = np.flatnonzero(order != np.arange(rig.n_discs))
    max_current = MIN_SPEED_CORRELATION - MIN_BEAM_CORRELATION
    is_clear = (best >= MIN_SPEED_CORRELATION).all() and (current[swapped] <= max_current).all()
    if not len(swapped) or not is_clear:
        return logged, []
    pairs = ", ".join(
        f"rpm{1 + rig.first_rotors[order[disc]]} follows pwm{1 + rig.first_rotors[disc]}_us "
        f"(correlation {best[disc]:.2f}, with its own pulses {current[order[disc]]:.2f})"
        for disc in swapped
    )
    return replace(logged, speed_rad_s=logged.speed_rad_s[order]), [
        f"{pairs}: speed columns were swapped to match their pulses; repair the logger"
    ]


def _compare_arms(logged: LoggedPitch, rig: Rig, acceleration: Array) -> tuple[float, int, int]:
    """Return the cosine between estimated and geometric moment arms of the rotors.

    Also the numbers (from 1) of the two rotors with the largest positive and negative arm. The
    cosine is 1 for two rotors (only the sign can be wrong) and for a beam that follows no rotor.
    """
    if rig.n_discs < 3:
        return 1.0, 1, 1
    thrusts = _detrended(_thrusts(logged, rig), logged)
    response = _detrended(acceleration[None], logged)[0]
    estimated = np.linalg.pinv(thrusts.T, rcond=MIN_SINGULAR_VALUE) @ response
    arms = _arms(rig)
    estimated, arms = estimated - estimated.mean(), arms - arms.mean()
    if _correlation(estimated @ thrusts, response) < MIN_BEAM_CORRELATION:
        return 1.0, 1, 1
    cosine = float(estimated @ arms / np.sqrt((estimated @ estimated) * (arms @ arms)))
    first, second = (1 + rig.first_rotors[k] for k in (np.argmax(estimated), np.argmin(estimated)))
    return cosine, first, second


def _arms(rig: Rig) -> Array:
    """Return the pitch moment per newton of each disc's thrust (n_discs,): m."""
    x_m = rig.disc_positions_m[:, 0]
    return np.array([pitch_moment_Nm(unit, x_m) for unit in np.eye(rig.n_discs)], float)


def check_motion(logged: LoggedPitch, rig: Rig) -> str:
    """Return a warning if the beam hardly moves, else ""."""
    angles = logged.theta_rad[np.isfinite(logged.theta_rad)]
    sensor = rig.sensors.get("theta_rad")
    noise = max(sensor.noise, sensor.quantum) if sensor is not None else 1e-4
    sd_rad = float(np.std(angles))
    if sd_rad > MIN_MOTION * noise:
        return ""
    return (
        f"the beam hardly moves (sd {np.degrees(sd_rad):.2g} deg), so few effects can be judged; "
        f"record steps and slow reversals of the attitude, as in the schedule identify"
    )


def bridge_gaps(values: Array) -> Array:
    """Return values (n,) with gaps interpolated."""
    rows, is_finite = np.arange(len(values)), np.isfinite(values)
    return np.asarray(np.interp(rows, rows[is_finite], values[is_finite]), float)


def _differentiate(values: Array, rate_Hz: float) -> Array:
    """Return the smoothed derivative of values (n,) per second; gaps interpolated."""
    filled = bridge_gaps(values)
    width = max(5, 2 * round(0.5 * DERIVATIVE_WINDOW_S * rate_Hz) + 1)
    slope: Array = savgol_filter(filled, width, 2, deriv=1, delta=1.0 / rate_Hz)
    return slope


def _thrusts(logged: LoggedPitch, rig: Rig) -> Array:
    """Return the thrust of each disc (n_discs, n) out of ground effect with the rig's lag: N."""
    propulsion = rig.propulsion
    speed = propulsion.speed_per_us_rad_s * np.maximum(logged.pwm_us - propulsion.pwm_start_us, 0.0)
    lag = round(propulsion.lag_s * logged.rate_Hz) if not logged.from_speeds else 0
    if lag:
        speed = np.concatenate([np.repeat(speed[:, :1], lag, axis=1), speed[:, :-lag]], axis=1)
    thrust: Array = propulsion.thrust_coefficient_N_s2 * speed**2
    return thrust


def _detrended(rows: Array, logged: LoggedPitch) -> Array:
    """Return rows (m, n) without their mean and their linear dependence on the beam's angle."""
    angle = bridge_gaps(logged.theta_rad)
    basis, _ = np.linalg.qr(np.column_stack([np.ones(len(angle)), angle]))
    residuals: Array = rows - (rows @ basis) @ basis.T
    return residuals


def _correlation(x: Array, y: Array) -> float:
    is_finite = np.isfinite(x) & np.isfinite(y)
    if is_finite.sum() < 3 or np.ptp(x[is_finite]) == 0.0 or np.ptp(y[is_finite]) == 0.0:
        return 0.0
    return float(np.corrcoef(x[is_finite], y[is_finite])[0, 1])
