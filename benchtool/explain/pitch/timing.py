"""Find channels of a pitch log that come late against the others, and put them in time.

A beam's rate is the slope of its angle, its acceleration follows the rotors' thrust at once, and a
rotor never turns before its pulse. A millisecond in one of these reads as a millisecond of lag, and
in closed loop that is worth a tolerance of damping.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.explain.pitch.sanity_checks import bridge_gaps, gyro_disagreement
from benchtool.physics.mixer import pitch_moment_Nm
from benchtool.simulate.pitch import filter_ticks as t
from benchtool.simulate.pitch.filter_log import LoggedPitch

SHORTEST_S = 8.0  # a piece without a gap must be so long before offsets are looked for
SLOWEST_HZ = 90.0  # rate of rows; 1 ms is a tenth of a row there; assumed
FARTHEST_S = 0.08  # offsets beyond this are not looked for: no logger is later by itself
BLOCKS = 10  # parts that are left out in turn (jackknife) for the standard error
SURE = 5.0  # an offset above so many of its standard errors is one
RELATED = 0.95  # correlation of two channels from which their offset means anything
READ_S = 0.001  # gyro against angle; a sensor's filter takes 0.5 ms at 300 Hz

DRIVEN_S = 0.008
"""Beam against thrust, speed against pulses: damping of the air, friction and a lag that a chirp
alone does not separate from a delay shift these by up to 5 ms."""

ALIKE_S, DELAY_S = 0.004, 0.01  # largest difference of like offsets, and of a delay; assumed

FILTERED = 0.2
"""A low-pass must leave less than this share of the variance that a delay leaves: on filters of 6
to 12 Hz it left 0.02, on delays 0.5 and more."""

LAG_LEAST, LAG_MOST = 0.3, 2.5  # shares of the stated motor lag; assumed
LAG_ROUNDS = 3  # how often it is looked for more finely: to half a per cent in the end


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """Say by how much one channel comes after another."""

    late_s: float
    se_s: float
    scale: float  # of the later channel over the other
    related: float  # correlation once it is shifted

    def beyond(self, limit_s: float) -> bool:
        """Whether it is surely more than a limit, either way."""
        wide = abs(self.late_s) > limit_s + SURE * self.se_s
        return wide and self.related > RELATED and abs(self.late_s) < FARTHEST_S

    @property
    def text(self) -> str:
        """The offset as people read it."""
        return f"{1e3 * abs(self.late_s):.1f} ± {1e3 * self.se_s:.2g} ms"


def align_channels(logged: LoggedPitch, rig: Rig, name: str) -> tuple[LoggedPitch, list[str]]:
    """Return the log with channels that come late or early shifted, and what was done.

    Raises:
        InputError: angle and rate both come late, which nothing in the log can mend.
    """
    piece = _longest(logged)
    rate_Hz = logged.rate_Hz
    if len(piece) < SHORTEST_S * rate_Hz or rate_Hz < SLOWEST_HZ:
        return logged, []
    remarks: list[str] = []
    gyro = np.isfinite(piece.gyro_rad_s).any()
    thrust_late = _of_thrust(piece, rig)
    if apart := gyro_disagreement(piece):  # its phase says nothing of clocks
        remarks.append(apart)
        thrust_late = _of_thrust(replace(piece, gyro_rad_s=np.nan * piece.theta_rad), rig)
    elif gyro:
        read = estimate_offset(_angle_of(piece), bridge_gaps(piece.theta_rad), rate_Hz, (0.5, 8.0))
        if read.beyond(READ_S):  # of the angle against the rate
            if _filtered(piece, read):
                remarks.append(
                    f"one of gyro_rad_s and theta_rad follows the other {read.text} behind, as "
                    f"through a low-pass filter; no shift mends that"
                )
                thrust_late = _of_thrust(replace(piece, gyro_rad_s=np.nan * piece.theta_rad), rig)
            else:
                of_angle = abs(thrust_late.late_s + read.late_s) > abs(thrust_late.late_s) + 0.003
                channel = "theta_rad" if of_angle else "gyro_rad_s"
                late_s = read.late_s if of_angle else -read.late_s
                logged = _shifted(logged, channel, late_s)
                remarks.append(_words(channel, late_s, read, READ_S))
                piece = _longest(logged)
                thrust_late = _of_thrust(piece, rig)
    pulses = None if logged.from_speeds else _of_pulses(piece, rig)
    if pulses is not None and pulses.beyond(DRIVEN_S) and pulses.late_s < 0.0:
        logged = _shifted(logged, "pwm_us", -pulses.late_s)
        remarks.append(_words("pwm_us", -pulses.late_s, pulses, DRIVEN_S))
    elif thrust_late.beyond(DRIVEN_S):
        if thrust_late.late_s > 0.0:
            raise InputError(
                f"the beam of {name} answers {thrust_late.text} after the rotors' thrust, and a "
                f"beam answers at once (limit {1e3 * DRIVEN_S:g} ms): angle and rate were logged "
                f"late; log all channels on one clock"
            )
        # Speeds that come late do so against their pulses, too; a delay may stand in those besides.
        if pulses is not None and -ALIKE_S < pulses.late_s + thrust_late.late_s < DELAY_S:
            delayed = pulses.late_s + thrust_late.late_s > ALIKE_S
            late_s = -thrust_late.late_s if delayed else pulses.late_s
            logged = _shifted(logged, "speed_rad_s", late_s)
            remarks.append(_words("rpm", late_s, pulses, DRIVEN_S))
    return logged, remarks


def estimate_offset(x: Array, y: Array, rate_Hz: float, band_Hz: tuple[float, float]) -> TimeOffset:
    """Return by how much y (n,) comes after x (n,), both within a band of frequencies.

    The best whole row by cross-correlation, then least squares on x and its slope, so that parts of
    a row count; the standard error is that of a jackknife over parts of the recording.
    """
    sos = butter(2, (band_Hz[0], min(band_Hz[1], 0.4 * rate_Hz)), "band", fs=rate_Hz, output="sos")
    x, y = sosfiltfilt(sos, x), sosfiltfilt(sos, y)
    rows, most = np.arange(len(x)), round(FARTHEST_S * rate_Hz)
    inside = slice(most, len(x) - most)
    at = y[inside]
    shifts = range(-most, most + 1)
    found = [x[most - k : len(x) - most - k] @ at for k in shifts]
    rows_late = float(shifts[int(np.argmax(found))])
    for _ in range(4):
        moved = np.interp(rows - rows_late, rows, x)
        sides = np.stack([moved, np.gradient(moved)], axis=1)[inside]
        scale, slope = _solved(sides, at)[0]
        rows_late -= slope / scale
    moved = np.interp(rows - rows_late, rows, x)
    sides = np.stack([moved, np.gradient(moved)], axis=1)[inside]
    best, each = _solved(sides, at)
    shift = each[:, 1] / each[:, 0]
    se = np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((shift - shift.mean()) ** 2))
    related = float(np.corrcoef(sides[:, 0], at)[0, 1])
    return TimeOffset(rows_late / rate_Hz, float(se) / rate_Hz, float(best[0]), related)


def _solved(sides: Array, at: Array) -> tuple[Array, Array]:
    """Return least squares (k,) of `at` (n,) on columns (n, k), and with each part left out."""
    edges = np.linspace(0, len(at), BLOCKS + 1).astype(int)
    parts = [slice(first, last) for first, last in pairwise(edges)]
    normal = np.array([sides[part].T @ sides[part] for part in parts])
    right = np.array([sides[part].T @ at[part] for part in parts])
    whole, sums = normal.sum(axis=0), right.sum(axis=0)
    each = np.array(
        [np.linalg.solve(whole - a, sums - b) for a, b in zip(normal, right, strict=True)]
    )
    return np.linalg.solve(whole, sums), each


def _longest(logged: LoggedPitch) -> LoggedPitch:
    """Return the longest piece without a gap."""
    edges = [0, *np.flatnonzero(logged.mode == t.RESTART), len(logged)]
    first, last = max(pairwise(edges), key=lambda piece: piece[1] - piece[0])
    return logged.between(first, last)


def _sum(values: Array, rate_Hz: float) -> Array:
    """Return the integral over time (n,), by trapezoids."""
    return (np.cumsum(values) - 0.5 * values) / rate_Hz


def _angle_of(logged: LoggedPitch) -> Array:
    return _sum(bridge_gaps(logged.gyro_rad_s), logged.rate_Hz)


def _filtered(logged: LoggedPitch, read: TimeOffset) -> bool:
    """Whether a low-pass explains better than a delay how angle and rate differ."""
    rate_Hz = logged.rate_Hz
    first, second = bridge_gaps(logged.theta_rad), _angle_of(logged)
    if read.late_s > 0.0:  # the angle comes after the rate
        first, second = second, first
    smooth = _lagged(first, abs(read.late_s), rate_Hz)
    left = 1.0 - estimate_offset(smooth, second, rate_Hz, (0.5, 8.0)).related ** 2
    return left < FILTERED * (1.0 - read.related**2)


def _lagged(values: Array, lag_s: float, rate_Hz: float) -> Array:
    """Return values (n,) through a lag of first order; each acts from its row to the next."""
    stays = np.exp(-1.0 / (rate_Hz * lag_s))
    answer = lfilter([1.0 - stays], [1.0, -stays], values - values[0]) + values[0]
    return np.append(answer[:1], answer[:-1])


def _of_thrust(logged: LoggedPitch, rig: Rig) -> TimeOffset:
    """Return by how much the beam's rate comes after the sum of the rotors' moments."""
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
    return estimate_offset(_sum(moment, rate_Hz), bridge_gaps(rate), rate_Hz, (2.0, 12.0))


def bench_numbers(logged: LoggedPitch, rig: Rig) -> dict[str, float]:
    """Return what is a bench's own in its log: how rotors turn at pulses and a beam at thrust."""
    piece, p, out = _longest(logged), rig.propulsion, dict[str, float]()
    sent, seen = p.speed_per_us_rad_s * (logged.pwm_us - p.pwm_start_us), logged.speed_rad_s
    known = np.isfinite(seen) & (sent > 0.0)
    if known.any():
        out["speed over pulse"] = float(np.median(seen[known] / sent[known]))
    if len(piece) >= SHORTEST_S * logged.rate_Hz and logged.rate_Hz > SLOWEST_HZ:
        found = _of_thrust(piece, rig)
        if found.related > RELATED:
            out["acceleration over thrust"] = found.scale
    return out


def _of_pulses(logged: LoggedPitch, rig: Rig) -> TimeOffset | None:
    """Return by how much speeds come after their pulses, beyond a lag of first order.

    Lag and offset are both fitted; None where speeds or changes of the pulses are missing.
    """
    p, rate_Hz = rig.propulsion, logged.rate_Hz
    if np.isfinite(logged.speed_rad_s).mean(axis=1).min() < 0.5:
        return None
    arms = rig.disc_positions_m[:, 0] - rig.disc_positions_m[:, 0].mean()
    sent = arms @ (p.speed_per_us_rad_s * (logged.pwm_us - p.pwm_start_us))
    seen = arms @ np.array([bridge_gaps(row) for row in logged.speed_rad_s])
    if np.ptp(sent) == 0.0:
        return None

    def followed(lag_s: float) -> TimeOffset:
        return estimate_offset(_lagged(sent, lag_s, rate_Hz), seen, rate_Hz, (0.5, 20.0))

    usual = max(p.lag_s, 2.0 / rate_Hz)
    lags = np.geomspace(LAG_LEAST * usual, LAG_MOST * usual, 9)
    for _ in range(LAG_ROUNDS):  # each time four times finer, about the best
        best = max(lags, key=lambda lag_s: followed(float(lag_s)).related)
        step = (lags[1] / lags[0]) ** 0.25
        lags = best * step ** np.arange(-4, 5)
    return followed(float(best))


def _shifted(logged: LoggedPitch, channel: str, late_s: float) -> LoggedPitch:
    """Return the log with one channel (..., n) earlier by so much; its end is blank, or held."""
    values = np.atleast_2d(getattr(logged, channel))
    rows = np.arange(values.shape[1])
    held = {"left": np.nan, "right": np.nan} if channel != "pwm_us" else {}
    moved = np.array(
        [np.interp(rows + late_s * logged.rate_Hz, rows, row, **held) for row in values]
    )
    changed: dict[str, Any] = {channel: moved.reshape(getattr(logged, channel).shape)}
    return replace(logged, **changed)


def _words(channel: str, late_s: float, found: TimeOffset, limit_s: float) -> str:
    way, mend = ("late", "earlier") if late_s > 0.0 else ("early", "later")
    return (
        f"{channel} comes {1e3 * abs(late_s):.1f} ± {1e3 * found.se_s:.2g} ms {way} (limit "
        f"{1e3 * limit_s:g} ms): shifted {mend} by that; log all channels on one clock"
    )
