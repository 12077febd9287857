"""Sanity checks of a pitch recording: units, signs, rotors in another order, as no effect has.

A wrong unit or a wrong sign makes every effect look small beside it. It is refused, with what to
mend, before anything is named.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import butter, coherence, csd, savgol_filter, sosfiltfilt, welch

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.physics.mixer import pitch_moment_Nm
from benchtool.simulate.pitch.filter_log import LoggedPitch

STEEPEST_RAD = 1.6  # no beam on a hinge turns farther; an angle in degrees does at once
SMOOTHED_S = 0.05  # width of the quadratic whose slope is a rate or an acceleration; assumed
SURE = 0.6  # correlation or coherence from which a slope is used
FACTOR = 3.0  # a gyro off by more has another unit or sign; assumed
SLOW_HZ = 3.0  # below, a gyro and an encoder on one beam must agree; assumed
SEGMENT_S = 2.0  # length of a segment of the spectra; assumed
BINS = 3  # of the spectra, one after the other, that make a band; assumed
QUICKEST = 0.25  # of the rate: faster motion of an encoder is its noise; assumed

FOLLOWS = 0.4
"""Correlation from which the beam is taken to follow the rotors' thrusts: noise alone, over the
thousand rows of the shortest recording, stays below 0.15. A choice."""

EXCHANGED = 0.8
"""Correlation of a speed with its pulses from which columns may be exchanged; each with the wrong
ones must be lower by `FOLLOWS`. A choice."""

ALIKE = 0.75
"""Cosine between the turning effects that rotors show and those that their places give. One rotor
exchanged with one at the side leaves 0.5; ground effect and unlike rotors leave 0.9. A choice."""

WEAK = 0.1  # ways of pushing that vary less than this share of the strongest say nothing
STILL = 5.0  # sd of the sensor's noise below which a beam stands still; assumed


def refuse_inconsistent(logged: LoggedPitch, rig: Rig, name: str) -> None:
    """Refuse a log whose columns contradict each other.

    Raises:
        InputError: an angle no beam can have, rates against the angle, thrust against the motion.
    """
    theta = logged.theta_rad
    steepest = float(np.nanmax(np.abs(theta)))
    if steepest > STEEPEST_RAD:
        raise InputError(
            f"theta_rad of {name} reaches {steepest:.3g} rad and a hinge ends at "
            f"{STEEPEST_RAD:g}; state the column's unit in the model's [columns], unit = \"deg\" "
            f"perhaps"
        )
    change, gyro = _change(theta, logged.rate_Hz), logged.gyro_rad_s
    slow_change, slow_gyro = _slow(change, logged.rate_Hz), _slow(gyro, logged.rate_Hz)
    related = abs(_correlation(slow_change, slow_gyro)) >= SURE
    slope = slow_change @ slow_gyro / (slow_change @ slow_change) if related else 1.0
    if not 1.0 / FACTOR < slope < FACTOR:
        raise InputError(
            f"gyro_rad_s of {name} is {slope:.2g} times the change of theta_rad below "
            f"{SLOW_HZ:g} Hz and should be once; mend the sign or the unit of one of them in the "
            f"model's [columns]"
        )
    rate = gyro if np.isfinite(gyro).any() else change
    acceleration = _change(rate, logged.rate_Hz)
    moment = pitch_moment_Nm(_thrusts(logged, rig), rig.disc_positions_m[:, 0])
    agreement = _correlation(np.asarray(moment, float), acceleration)
    alike, first, second = _followed(logged, rig, acceleration)
    if abs(alike) < ALIKE:
        outer = np.argsort(-np.abs(_arms(rig)), kind="stable")[:2]
        wanted = " and ".join(rig.rotors[rig.first_rotors[disc]].name for disc in outer)
        raise InputError(
            f"the beam of {name} follows pwm{first}_us against pwm{second}_us, but rig "
            f"{rig.name!r} turns it by {wanted}: pulses stand under other rotors than theirs; "
            f"record with the map of motors (map=FILE, see benchtool bench map), or exchange the "
            f"columns in the model's [columns]"
        )
    if agreement < -SURE or alike < 0.0:
        raise InputError(
            f"the beam of {name} turns against its thrust (correlation {agreement:.2f}): rotors or "
            f"the sign of theta_rad are not as rig {rig.name!r} has them; exchange the columns of "
            f"the rotors or change the sign in the model's [columns]"
        )


def _slow(values: Array, rate_Hz: float) -> Array:
    """Return values (n,) about their mean, low-passed at `SLOW_HZ`; blank ones bridged."""
    known = np.isfinite(values)
    if not known.any() or rate_Hz <= 2.0 * SLOW_HZ:
        return np.nan_to_num(values)
    low_pass = butter(2, SLOW_HZ, fs=rate_Hz, output="sos")
    whole = bridge_gaps(values)
    return np.asarray(sosfiltfilt(low_pass, whole - whole.mean()), float)


def gyro_disagreement(logged: LoggedPitch) -> str:
    """Return where a gyro turns faster than its encoder, as a sentence; "" where it does not."""
    known = np.isfinite(logged.gyro_rad_s) & np.isfinite(logged.theta_rad)
    if known.sum() < 2:
        return ""
    fs = logged.rate_Hz
    theta, gyro = (
        bridge_gaps(np.where(known, values, np.nan))
        for values in (logged.theta_rad, logged.gyro_rad_s)
    )
    nperseg = min(len(known), round(SEGMENT_S * fs))
    frequency_Hz, cross = csd(theta, gyro, fs=fs, nperseg=nperseg)
    power = welch(theta, fs=fs, nperseg=nperseg)[1]
    ratio = np.abs(cross) / np.maximum(2.0 * np.pi * frequency_Hz * power, 1e-300)
    apart = (coherence(theta, gyro, fs=fs, nperseg=nperseg)[1] > SURE) & (ratio > FACTOR)
    apart &= (frequency_Hz > SLOW_HZ) & (frequency_Hz < QUICKEST * fs)
    wide = np.flatnonzero(np.convolve(apart, np.ones(BINS), "valid") == BINS)
    if not len(wide):
        return ""
    first = int(wide[0])
    return (
        f"gyro_rad_s is {ratio[first]:.2g} times the change of theta_rad at "
        f"{frequency_Hz[first]:.3g} Hz and agrees with it below {SLOW_HZ:g} Hz: gyro and encoder "
        f"sit on parts that move against each other"
    )


def rotors_in_order(logged: LoggedPitch, rig: Rig) -> tuple[LoggedPitch, list[str]]:
    """Return the log with each speed under the pulses that it follows, and what was exchanged.

    Rotors whose pulses go alike, or that follow none, say nothing.
    """
    sent, seen = np.sqrt(_thrusts(logged, rig)), logged.speed_rad_s
    if rig.n_discs < 2 or logged.from_speeds or np.isfinite(seen).mean(axis=1).min() < 0.5:
        return logged, []
    sent, seen = sent - sent.mean(axis=0), seen - seen.mean(axis=0)
    alike = np.array([[_correlation(pulse, speed) for speed in seen] for pulse in sent])
    order = np.argmax(alike, axis=1)
    if len(set(order.tolist())) < rig.n_discs:
        return logged, []
    own, best = np.diag(alike), alike[np.arange(rig.n_discs), order]
    moved = np.flatnonzero(order != np.arange(rig.n_discs))
    if not len(moved) or (best < EXCHANGED).any() or (own[moved] > EXCHANGED - FOLLOWS).any():
        return logged, []
    words = ", ".join(
        f"rpm{1 + rig.first_rotors[order[disc]]} follows pwm{1 + rig.first_rotors[disc]}_us "
        f"(correlation {best[disc]:.2f}, with its own {alike[order[disc], order[disc]]:.2f})"
        for disc in moved
    )
    return replace(logged, speed_rad_s=logged.speed_rad_s[order]), [
        f"{words}: columns of speed were exchanged, each put to its pulses; mend the logger"
    ]


def _followed(logged: LoggedPitch, rig: Rig, acceleration: Array) -> tuple[float, int, int]:
    """Return how alike the turning effects of the rotors are to those that their places give.

    With it the numbers (from 1) of the two rotors that turn the beam most, one each way. Two
    rotors have only a sign to be wrong, and a beam that follows none says nothing: 1 for both.
    """
    if rig.n_discs < 3:
        return 1.0, 1, 1
    pushes = _detrended(_thrusts(logged, rig), logged)
    follows = _detrended(acceleration[None], logged)[0]
    shown = np.linalg.pinv(pushes.T, rcond=WEAK) @ follows
    arms = _arms(rig)
    shown, arms = shown - shown.mean(), arms - arms.mean()
    if _correlation(shown @ pushes, follows) < FOLLOWS:
        return 1.0, 1, 1
    alike = float(shown @ arms / np.sqrt((shown @ shown) * (arms @ arms)))
    first, second = (1 + rig.first_rotors[k] for k in (np.argmax(shown), np.argmin(shown)))
    return alike, first, second


def _arms(rig: Rig) -> Array:
    """Return the pitch moment of one newton of each disc (n_discs,): m."""
    x_m = rig.disc_positions_m[:, 0]
    return np.array([pitch_moment_Nm(one, x_m) for one in np.eye(rig.n_discs)], float)


def standing_still(logged: LoggedPitch, rig: Rig) -> str:
    """Return what to say of a beam that hardly moves; empty of one that does."""
    known = logged.theta_rad[np.isfinite(logged.theta_rad)]
    sensor = rig.sensors.get("theta_rad")
    noise = max(sensor.noise, sensor.quantum) if sensor is not None else 1e-4
    moved = float(np.std(known))
    if moved > STILL * noise:
        return ""
    return (
        f"the beam hardly moves ({np.degrees(moved):.2g} deg, root mean square), so little can be "
        f"judged; record steps and slow reversals of the attitude, as the schedule identify has"
    )


def bridge_gaps(values: Array) -> Array:
    """Return values (n,) with blank ones interpolated."""
    rows, known = np.arange(len(values)), np.isfinite(values)
    return np.asarray(np.interp(rows, rows[known], values[known]), float)


def _change(values: Array, rate_Hz: float) -> Array:
    """Return the slope of values (n,) per second, smoothed; blank ones bridged."""
    whole = bridge_gaps(values)
    width = max(5, 2 * round(0.5 * SMOOTHED_S * rate_Hz) + 1)
    out: Array = savgol_filter(whole, width, 2, deriv=1, delta=1.0 / rate_Hz)
    return out


def _thrusts(logged: LoggedPitch, rig: Rig) -> Array:
    """Return the thrust of each disc (n_discs, n), out of ground effect, lag as the rig's: N."""
    p = rig.propulsion
    speed = p.speed_per_us_rad_s * np.maximum(logged.pwm_us - p.pwm_start_us, 0.0)
    late = round(p.lag_s * logged.rate_Hz) if not logged.from_speeds else 0
    if late:
        speed = np.concatenate([np.repeat(speed[:, :1], late, axis=1), speed[:, :-late]], axis=1)
    thrust: Array = p.thrust_coefficient_N_s2 * speed**2
    return thrust


def _detrended(rows: Array, logged: LoggedPitch) -> Array:
    """Return rows (m, n) without what is constant and what goes with the beam's angle."""
    angle = bridge_gaps(logged.theta_rad)
    held, _ = np.linalg.qr(np.column_stack([np.ones(len(angle)), angle]))
    out: Array = rows - (rows @ held) @ held.T
    return out


def _correlation(x: Array, y: Array) -> float:
    both = np.isfinite(x) & np.isfinite(y)
    if both.sum() < 3 or np.ptp(x[both]) == 0.0 or np.ptp(y[both]) == 0.0:
        return 0.0
    return float(np.corrcoef(x[both], y[both])[0, 1])
