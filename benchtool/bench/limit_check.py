"""Checks per kind of channel, and the limit check of every sample; it commands and raises nothing.

Two checks apply to every channel of a point: outliers are excluded from its mean, and a channel
with a noise in the rig is checked for a frozen value. `CHECKS` contains the differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, pi

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.plate_check import PLATE_CHANNEL, plate_tolerance_m
from benchtool.bench.standstill import GAP_S, HostPulseTracking, LoopPulseTracking
from benchtool.core.channel import Channel, channel_family
from benchtool.core.errors import BenchError, LimitExceeded, ReadingsLate
from benchtool.core.rig import Limits, Rig
from benchtool.core.units import Array

# Band of thrust over k sum w^2. Ground effect in its range of validity stays below 2.5 (paper,
# eq. 4, z/R from 0.5 on); the rest is a margin for a roughly known k; assumed.
PLAUSIBLE_LOW, PLAUSIBLE_HIGH = 0.2, 3.5

PLAUSIBLE_MARGIN = 0.05  # share of the cell's rating on top: no tare, noise; assumed
IMPLAUSIBLE_TIMEOUT_S = 0.6  # of thrust that disagrees with rpm; slow amplifiers lag by 0.4 s
FROZEN_TIMEOUT_S = 3.0  # of one value while rpm changes: 240 readings at 80 Hz; assumed


SLOW_CHANNEL_RATE_HZ = 10.0  # factor on the silence limit of voltage, current and temperature


@dataclass(frozen=True, slots=True)
class ChannelChecks:
    """Checks of one kind of channel."""

    # Returns the lowest and highest allowed reading; without it the guard checks nothing
    limits: Callable[[Limits], tuple[float, float]] | None = None
    advice: str = ""  # remedy for a reading outside the limits
    # Multiple of the guard's `stale_s` allowed without a new value
    silence_factor: float = SLOW_CHANNEL_RATE_HZ
    # A point whose channel is short, late or frozen is repeated; other channels only cause an event
    is_required: bool = False
    # It changes with the pulse widths and with the other such channels
    follows_pulse_width: bool = False


def _thrust(limits: Limits) -> tuple[float, float]:
    max_N = min(limits.thrust_N, limits.load_cell_rating_N)
    return -max_N, max_N


CHECKS: dict[str, ChannelChecks] = {  # by channel family: the name without the rotor number
    "thrust_N": ChannelChecks(
        _thrust,
        "lower the plan's pwm or raise limits.thrust_N within the load cell's rating",
        silence_factor=1.0,
        is_required=True,
        follows_pulse_width=True,
    ),
    "thrust_raw": ChannelChecks(is_required=True, follows_pulse_width=True),
    "rpm": ChannelChecks(
        lambda limits: (-inf, limits.rpm),
        "lower the plan's pwm or raise limits.rpm",
        silence_factor=1.0,
        is_required=True,
        follows_pulse_width=True,
    ),
    "torque_Nm": ChannelChecks(follows_pulse_width=True),
    "voltage_V": ChannelChecks(lambda limits: (limits.voltage_min_V, inf), "charge the battery"),
    "current_A": ChannelChecks(
        lambda limits: (-inf, limits.current_A),
        "lower the plan's pwm or raise limits.current_A",
        follows_pulse_width=True,
    ),
    "temperature_degC": ChannelChecks(
        lambda limits: (-inf, limits.temperature_degC),
        "let the ESC cool down or lower the plan's pwm",
    ),
    "plate_z_m": ChannelChecks(),
}


@dataclass(frozen=True, slots=True)
class _WatchedChannel:
    index: int
    name: str
    advice: str
    low: float
    high: float
    stale_s: float


class LimitCheck:
    """Check of sample blocks against the limits of a rig; silence counts from `start_s`."""

    def __init__(
        self, channels: Sequence[Channel], rig: Rig, limits: Limits, stale_s: float, start_s: float
    ) -> None:
        names = [channel.name for channel in channels]
        # Longest time without a new value of thrust and rpm; other channels get longer
        self._names, self._rotor_stale_s = names, stale_s
        self._set_watched(_find_watched(names, limits, stale_s), start_s)
        rpm_names = [f"rpm{i + 1}" for i in range(rig.n_rotors)]
        self._rpm = np.array([names.index(name) for name in rpm_names if name in names], np.intp)
        self._thrust = names.index("thrust_N") if "thrust_N" in names else -1
        self._plate = names.index(PLATE_CHANNEL) if PLATE_CHANNEL in names else -1
        self._min_plate_m = rig.plate.z_min_m - plate_tolerance_m(rig)
        self._turning = False
        self._stop_us = rig.propulsion.pwm_stop_us
        self._n_rotors = rig.n_rotors
        self._rig = rig
        self._host = HostPulseTracking(rig.propulsion, rig.n_rotors, start_s)
        self._loop: LoopPulseTracking | None = None
        self._rc_arming = False
        pwm_names = [f"pwm{i + 1}_us" for i in range(rig.n_rotors)]
        self._pwm = np.array([names.index(name) for name in pwm_names if name in names], np.intp)
        self._last_us: Array = np.full(len(self._pwm), np.nan)
        self._last_rpm: Array = np.full(len(self._rpm), np.nan)
        self._thrust_per_rpm2 = rig.propulsion.thrust_coefficient_N_s2 * (pi / 30.0) ** 2
        self._margin_N = PLAUSIBLE_MARGIN * limits.load_cell_rating_N
        self._plausible_s = self._last_s = start_s
        self._repeated_N, self._repeated_since_s = np.nan, start_s
        self._last_square, self._rpm_moved_s = 0.0, -inf

    def _set_watched(self, watched: list[_WatchedChannel], now_s: float) -> None:
        self._watched = watched
        self._columns = np.array([item.index for item in watched], np.intp)
        self._low = np.array([item.low for item in watched], float)
        self._high = np.array([item.high for item in watched], float)
        self._stale_s = np.array([item.stale_s for item in watched], float)
        self._last_value_s: Array = np.full(len(watched), now_s)

    def tighten_limits(self, limits: Limits) -> None:
        """Replace the limits; the set of checked channels does not change."""
        channels = _find_watched(self._names, limits, self._rotor_stale_s)
        new = {channel.index: channel for channel in channels}
        self._watched = [new.get(channel.index, channel) for channel in self._watched]
        self._low = np.array([channel.low for channel in self._watched], float)
        self._high = np.array([channel.high for channel in self._watched], float)

    def record_command(self, pwm_us: Array, now_s: float) -> None:
        """Set the commanded pulse width of every motor (n_rotors,): us, for comparison with rpm."""
        self._turning = bool((pwm_us > self._stop_us).any())
        self._host.record_command(pwm_us, now_s)

    def expect_loop(self, now_s: float, *, rc_arming: bool) -> None:
        """Compare speeds with the pulse widths that the bench reports, set by its control loop.

        The host's commands are used if the stream lacks the pulse width of a rotor. Missing values
        of these channels end the run as missing speeds do, because speeds are compared with them.

        Args:
            rc_arming: the motors may be started without the host, for example by a transmitter,
                so they may turn before the host's first command.
        """
        if self._loop is not None or len(self._pwm) < self._n_rotors:
            return
        stale_s = self._rotor_stale_s
        pulses = [
            _WatchedChannel(i, self._names[i], "", -inf, inf, stale_s) for i in self._pwm.tolist()
        ]
        self._set_watched([*self._watched, *pulses], now_s)
        self._loop = LoopPulseTracking(self._rig.propulsion, self._n_rotors, now_s)
        self._rc_arming = rc_arming

    def find_violation(
        self, time_s: Array, values: Array, late: ReadingsLate | None = None
    ) -> BenchError | None:
        """Return the first violation in samples (m,), (m, c), nan without a value, or None.

        Args:
            late: error of the times of these samples; returned instead of an error that a rotor
                does not follow its pulse width.
        """
        if not len(time_s):
            return None
        readings = values.take(self._columns, axis=1)
        is_exceeded = (readings > self._high) | (readings < self._low)
        if np.count_nonzero(is_exceeded):
            return self._limit_error(readings, is_exceeded)
        if self._turning and self._plate >= 0:
            plate_m = values[:, self._plate]
            too_near_m = plate_m[plate_m < self._min_plate_m]
            if len(too_near_m):
                return LimitExceeded(
                    PLATE_CHANNEL,
                    float(too_near_m[0]),
                    self._rig.plate.z_min_m,
                    "the plate is inside the rig's minimum gap while motors turn; move it away by "
                    "hand, then check stage and sensor",
                )
        if (gap_s := float(time_s[0]) - self._last_s) > GAP_S:
            self._last_value_s += gap_s
            self._plausible_s += gap_s
            self._repeated_since_s += gap_s
        self._last_s = float(time_s[-1])
        value_s = np.where(np.isnan(readings), -inf, time_s[:, None])
        newest_s = np.maximum.reduce(value_s)
        np.maximum(self._last_value_s, newest_s, out=self._last_value_s)
        silent_s = self._last_s - self._last_value_s
        if np.count_nonzero(silent_s > self._stale_s):
            column = int(np.argmax(silent_s > self._stale_s))
            watched = self._watched[column]
            return LimitExceeded(
                f"silence of {watched.name} in s",
                float(silent_s[column]),
                watched.stale_s,
                "the channel has no new values; check its wiring and its sensor",
            )
        if len(self._rpm) < self._n_rotors:
            return None
        rpm, self._last_rpm = _forward_fill(values.take(self._rpm, axis=1), self._last_rpm)
        error: LimitExceeded | None = None
        if self._thrust >= 0:
            thrust_N, squares = values[:, self._thrust], np.einsum("ij,ij->i", rpm, rpm)
            error = self._check_thrust(time_s, squares, thrust_N)
            error = error or self._check_frozen(squares, thrust_N)
        if error is None and (error := self._check_speeds(values, rpm)) is not None:
            return late or error
        return error

    def _check_speeds(self, values: Array, rpm: Array) -> LimitExceeded | None:
        """Return an error if a motor's rpm has not followed its pulse width by now.

        The pulse widths that a loop on the bench reports count, and in addition the host's zero: no
        loop may turn motors after it. If the bench reports none, the host's commands are used,
        which is stricter than no check.
        """
        if self._loop is None:
            return self._host.find_mismatch(rpm[-1], self._last_s)
        pwm_us, self._last_us = _forward_fill(values.take(self._pwm, axis=1), self._last_us)
        error = self._loop.find_mismatch(pwm_us, rpm, self._last_s)
        if error is None and self._host.at_zero and (self._host.has_driven or not self._rc_arming):
            error = self._host.find_mismatch(rpm[-1], self._last_s)
        return error

    def _check_frozen(self, squares: Array, thrust_N: Array) -> LimitExceeded | None:
        """Return an error if thrust repeats one number while rpm readings change."""
        present_N = [value_N for value_N in thrust_N.tolist() if value_N == value_N]  # not nan
        if present_N.count(self._repeated_N) < len(present_N):
            self._repeated_N = present_N[-1]
            self._repeated_since_s = self._last_s
        turning_squares = [square for square in squares.tolist() if square > 0.0]
        if turning_squares:
            if turning_squares.count(self._last_square) < len(turning_squares):
                self._rpm_moved_s = self._last_s
            self._last_square = turning_squares[-1]
        repeated_s = self._last_s - self._repeated_since_s
        if repeated_s <= FROZEN_TIMEOUT_S or self._rpm_moved_s <= self._repeated_since_s:
            return None
        return LimitExceeded(
            "repetition of one thrust_N reading in s",
            repeated_s,
            FROZEN_TIMEOUT_S,
            f"the load cell shows {self._repeated_N:.6g} N all the time; check its amplifier "
            f"and cable",
        )

    def _check_thrust(self, time_s: Array, squares: Array, thrust_N: Array) -> LimitExceeded | None:
        """Return an error if thrust has disagreed with rpm for too long."""
        expected_N = self._thrust_per_rpm2 * squares
        high_N = PLAUSIBLE_HIGH * expected_N + self._margin_N
        low_N = PLAUSIBLE_LOW * expected_N - self._margin_N
        plausible = (thrust_N <= high_N) & (thrust_N >= low_N)
        if np.count_nonzero(plausible) == len(plausible):
            self._plausible_s = float(time_s[-1])
            return None
        implausible = (thrust_N > high_N) | (thrust_N < low_N)
        if not np.count_nonzero(implausible):
            if np.count_nonzero(plausible):
                self._plausible_s = float(time_s[plausible][-1])
            return None
        since_s = np.maximum.accumulate(
            np.maximum(np.where(plausible, time_s, -inf), self._plausible_s)
        )
        self._plausible_s = float(since_s[-1])
        is_error = implausible & (time_s - since_s > IMPLAUSIBLE_TIMEOUT_S)
        if not is_error.any():
            return None
        row = int(np.argmax(is_error))
        limit_N = high_N[row] if thrust_N[row] > high_N[row] else low_N[row]
        return LimitExceeded(
            "thrust_N",
            float(thrust_N[row]),
            float(limit_N),
            f"that is not plausible for {float(np.sqrt(squares[row] / len(self._rpm))):.0f} rpm, "
            f"where k w^2 gives {float(expected_N[row]):.3g} N; check the load cell's sign and "
            f"scale, the rpm channels and the rig's thrust coefficient",
        )

    def _limit_error(self, readings: Array, is_exceeded: NDArray[np.bool_]) -> LimitExceeded:
        row = int(np.argmax(is_exceeded.any(axis=1)))
        column = int(np.argmax(is_exceeded[row]))
        watched, value = self._watched[column], float(readings[row, column])
        limit = watched.high if value > watched.high else watched.low
        return LimitExceeded(watched.name, value, limit, watched.advice)


def format_unmonitored_limits(channels: Sequence[Channel], n_rotors: int) -> str:
    """Return in a sentence which limits of a rig no channel of the bench monitors, or ""."""
    names = {channel.name for channel in channels}
    limited = [kind for kind, checks in CHECKS.items() if checks.limits]
    speeds = [f"rpm{rotor + 1}" for rotor in range(n_rotors)]
    required = (name for kind in limited for name in (speeds if kind == "rpm" else [kind]))
    missing = [name for name in required if name not in names]
    if not missing:
        return ""
    return f"no channel {', '.join(missing)}: the rig's limits on them are not monitored"


def _find_watched(names: Sequence[str], limits: Limits, stale_s: float) -> list[_WatchedChannel]:
    channels = []
    for index, name in enumerate(names):
        checks = CHECKS.get(channel_family(name))
        if checks and checks.limits:
            low, high = checks.limits(limits)
            timeout_s = checks.silence_factor * stale_s
            channels.append(_WatchedChannel(index, name, checks.advice, low, high, timeout_s))
    return channels


def _forward_fill(rows: Array, last_values: Array) -> tuple[Array, Array]:
    """Return rows (m, n) with gaps filled by the channel's last reading, and the last row.

    A device may send thrust and speeds in different rows. A reading that is too old to compare
    belongs to a silent channel, which has its own check. `last_values` (n,) precede the rows.
    """
    is_missing = np.isnan(rows)
    if np.count_nonzero(is_missing):
        rows[0, is_missing[0]] = last_values[is_missing[0]]
        source_rows = np.where(is_missing, 0, np.arange(len(rows))[:, None])
        np.maximum.accumulate(source_rows, axis=0, out=source_rows)
        rows = np.take_along_axis(rows, source_rows, axis=0)
    return rows, rows[-1].copy()
