"""Checks per kind of channel, and the limit check of every sample; it commands and raises nothing.

Two checks apply to every channel of a point: outliers are excluded from its mean, and a channel
with a noise in the rig is checked for a frozen value. `CHECKS` contains the differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, isnan, nan, pi, sqrt
from typing import NamedTuple

import numpy as np

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
        "lower the pulse or raise limits.thrust_N within the load cell's rating",
        silence_factor=1.0,
        is_required=True,
        follows_pulse_width=True,
    ),
    "thrust_raw": ChannelChecks(is_required=True, follows_pulse_width=True),
    "rpm": ChannelChecks(
        lambda limits: (-inf, limits.rpm),
        "lower the pulse or raise limits.rpm",
        silence_factor=1.0,
        is_required=True,
        follows_pulse_width=True,
    ),
    "torque_Nm": ChannelChecks(follows_pulse_width=True),
    "voltage_V": ChannelChecks(lambda limits: (limits.voltage_min_V, inf), "charge the battery"),
    "current_A": ChannelChecks(
        lambda limits: (-inf, limits.current_A),
        "lower the pulse or raise limits.current_A",
        follows_pulse_width=True,
    ),
    "temperature_degC": ChannelChecks(
        lambda limits: (-inf, limits.temperature_degC),
        "let the ESC cool down or lower the pulse",
    ),
    "plate_z_m": ChannelChecks(),
}


class _WatchedChannel(NamedTuple):
    column: int
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
        self._rpm = [names.index(name) for name in rpm_names if name in names]
        self._thrust = names.index("thrust_N") if "thrust_N" in names else -1
        self._plate = names.index(PLATE_CHANNEL) if PLATE_CHANNEL in names else -1
        self._min_plate_m = rig.plate.z_min_m - plate_tolerance_m(rig)
        self._n_rotors = rig.n_rotors
        self._rig = rig
        self._host = HostPulseTracking(rig.propulsion, rig.n_rotors, start_s)
        self._loop: LoopPulseTracking | None = None
        self._rc_arming = False
        pwm_names = [f"pwm{i + 1}_us" for i in range(rig.n_rotors)]
        self._pwm = [names.index(name) for name in pwm_names if name in names]
        self._last_us, self._last_rpm = [nan] * len(self._pwm), [nan] * len(self._rpm)
        self._thrust_per_rpm2 = rig.propulsion.thrust_coefficient_N_s2 * (pi / 30.0) ** 2
        self._margin_N = PLAUSIBLE_MARGIN * limits.load_cell_rating_N
        self._plausible_s = self._last_s = start_s
        self._repeated_N, self._repeated_since_s = nan, start_s
        self._last_square, self._rpm_moved_s = 0.0, -inf

    def _set_watched(self, watched: list[_WatchedChannel], now_s: float) -> None:
        self._watched, self._last_value_s = watched, [now_s] * len(watched)
        self._columns = [channel.column for channel in watched]

    def tighten_limits(self, limits: Limits) -> None:
        """Replace the limits; the set of checked channels does not change."""
        channels = _find_watched(self._names, limits, self._rotor_stale_s)
        new = {channel.column: channel for channel in channels}
        self._watched = [new.get(channel.column, channel) for channel in self._watched]

    def record_command(self, pwm_us: Array, now_s: float) -> None:
        """Set the commanded pulse width of every motor (n_rotors,): us, for comparison with rpm."""
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
        pulses = [_WatchedChannel(i, self._names[i], "", -inf, inf, stale_s) for i in self._pwm]
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
        # Plain Python: a read returns few rows, for which each call of NumPy costs more than a row.
        times_s, rows = time_s.tolist(), values.tolist()
        for row in rows:
            for column, name, advice, low, high, _ in self._watched:
                if not low <= (value := row[column]) <= high and value == value:  # not nan
                    return LimitExceeded(name, value, high if value > high else low, advice)
        if self._plate >= 0 and not self._host.at_zero:
            for row in rows:
                if row[self._plate] < self._min_plate_m:
                    return LimitExceeded(
                        PLATE_CHANNEL,
                        row[self._plate],
                        self._rig.plate.z_min_m,
                        "the plate is inside the rig's minimum gap while motors turn; move it away "
                        "by hand, then check stage and sensor",
                    )
        if (gap_s := times_s[0] - self._last_s) > GAP_S:
            self._last_value_s = [value_s + gap_s for value_s in self._last_value_s]
            self._plausible_s += gap_s
            self._repeated_since_s += gap_s
        self._last_s = times_s[-1]
        for row_s, row in zip(times_s, rows, strict=True):
            for number, column in enumerate(self._columns):
                if row[column] == row[column]:  # not nan
                    self._last_value_s[number] = row_s
        for channel, value_s in zip(self._watched, self._last_value_s, strict=True):
            if (silent_s := self._last_s - value_s) > channel.stale_s:
                return LimitExceeded(
                    f"silence of {channel.name} in s",
                    silent_s,
                    channel.stale_s,
                    "the channel has no new values; check its wiring and its sensor",
                )
        if len(self._rpm) < self._n_rotors:
            return None
        rpm = _forward_fill(rows, self._rpm, self._last_rpm)
        self._last_rpm = rpm[-1]
        error: LimitExceeded | None = None
        if self._thrust >= 0:
            thrust_N = [row[self._thrust] for row in rows]
            squares = [sum([speed * speed for speed in speeds]) for speeds in rpm]
            error = self._check_thrust(times_s, squares, thrust_N)
            error = error or self._check_frozen(squares, thrust_N)
        if error is None and (error := self._check_speeds(rows, rpm)) is not None:
            return late or error
        return error

    def _check_speeds(
        self, rows: list[list[float]], rpm: list[list[float]]
    ) -> LimitExceeded | None:
        """Return an error if a motor's rpm has not followed its pulse width by now.

        The pulse widths that a loop on the bench reports count, and in addition the host's zero: no
        loop may turn motors after it. If the bench reports none, the host's commands are used,
        which is stricter than no check.
        """
        if self._loop is None:
            return self._host.find_mismatch(rpm[-1], self._last_s)
        pwm_us = _forward_fill(rows, self._pwm, self._last_us)
        self._last_us = pwm_us[-1]
        error = self._loop.find_mismatch(np.array(pwm_us), np.array(rpm), self._last_s)
        if error is None and self._host.at_zero and (self._host.has_driven or not self._rc_arming):
            error = self._host.find_mismatch(rpm[-1], self._last_s)
        return error

    def _check_frozen(self, squares: list[float], thrust_N: list[float]) -> LimitExceeded | None:
        """Return an error if thrust repeats one number while rpm readings change."""
        present_N = [value_N for value_N in thrust_N if value_N == value_N]  # not nan
        if present_N.count(self._repeated_N) < len(present_N):
            self._repeated_N = present_N[-1]
            self._repeated_since_s = self._last_s
        turning_squares = [square for square in squares if square > 0.0]
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

    def _check_thrust(
        self, times_s: list[float], squares: list[float], thrust_N: list[float]
    ) -> LimitExceeded | None:
        """Return an error if thrust has disagreed with rpm for too long."""
        for time_s, square, value_N in zip(times_s, squares, thrust_N, strict=True):
            expected_N = self._thrust_per_rpm2 * square
            high_N = PLAUSIBLE_HIGH * expected_N + self._margin_N
            low_N = PLAUSIBLE_LOW * expected_N - self._margin_N
            if low_N <= value_N <= high_N:
                self._plausible_s = time_s
                continue
            is_implausible = value_N > high_N or value_N < low_N  # not if one of them is nan
            if is_implausible and time_s - self._plausible_s > IMPLAUSIBLE_TIMEOUT_S:
                return LimitExceeded(
                    "thrust_N",
                    value_N,
                    high_N if value_N > high_N else low_N,
                    f"that is not plausible for {sqrt(square / len(self._rpm)):.0f} rpm, where "
                    f"k w^2 gives {expected_N:.3g} N; check the load cell's sign and scale, the "
                    f"rpm channels and the rig's thrust coefficient",
                )
        return None


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


def _forward_fill(
    rows: list[list[float]], columns: list[int], last_values: list[float]
) -> list[list[float]]:
    """Return the columns of rows with gaps filled by the channel's last reading.

    A device may send thrust and speeds in different rows. A reading that is too old to compare
    belongs to a silent channel, which has its own check. `last_values` precede the rows.
    """
    filled = []
    for row in rows:
        readings = [row[column] for column in columns]
        if isnan(sum(readings)):
            pairs = zip(readings, last_values, strict=True)
            readings = [old if isnan(new) else new for new, old in pairs]
        filled.append(last_values := readings)
    return filled
