"""Every limit on every sample, a block at a time: pure, nothing commanded, nothing raised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, pi

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import Channel
from benchtool.core.rig import Limits, Rig
from benchtool.errors import LimitExceeded

Array = NDArray[np.float64]

PLAUSIBLE_LOW, PLAUSIBLE_HIGH = 0.2, 3.5
"""Band of thrust over k sum w^2. Ground effect in its range of validity stays below 2.5 (paper,
eq. 4, z/R from 0.5 on); the rest is room for a k that is only roughly known. A choice."""

PLAUSIBLE_MARGIN = 0.05
"""Share of the load cell's rating that is allowed on top: untared offsets, noise. A choice."""

IMPLAUSIBLE_S = 0.6
"""Thrust may disagree with rpm for so long: amplifiers with 10 readings per second lag by 0.4 s."""

TOO_SLOW, TOO_SLOW_S = 0.25, 2.0
"""A motor slower than this share of what its pulse gives, so long after the command, is dead, or
its rpm channel is. The share leaves room for a pulse map that is only roughly known. A choice."""

TOO_FAST, TOO_FAST_S = 4.0, 5.0
"""The same for a motor that turns faster, or that turns without a command."""

SLACK_RPM = 300.0
"""Room on both for pulses near the start of the map, where motors stutter. A choice."""

STUCK_S = 3.0
"""A load cell that repeats one number for so long, while rpm readings change, is stuck. A choice:
240 readings of an 80 Hz cell."""

GAP_S = 0.5
"""Nobody read the stream for longer than this: the silence was ours, not that of a channel."""

SLOW = 10.0
"""Voltage, current and temperature may be silent this much longer than thrust and rpm."""

_ADVICE = {
    "thrust_N": "lower the plan's pwm or raise limits.thrust_N within the load cell's rating",
    "rpm": "lower the plan's pwm or raise limits.rpm",
    "current_A": "lower the plan's pwm or raise limits.current_A",
    "voltage_V": "charge the battery",
    "temperature_degC": "let the ESC cool down or lower the plan's pwm",
}


@dataclass(frozen=True, slots=True)
class _Watched:
    index: int
    name: str
    family: str
    low: float
    high: float
    stale_s: float


class LimitCheck:
    """Judge blocks of samples against the limits of a rig.

    Args:
        channels: (c,) of the stream.
        rig: thrust coefficient, number of rotors.
        limits: what no reading may exceed.
        stale_s: thrust and rpm that bring no new value for so long are dead; the others get longer.
        start_s: time on the bench's clock from which silence counts.
    """

    def __init__(
        self,
        channels: Sequence[Channel],
        rig: Rig,
        limits: Limits,
        stale_s: float,
        start_s: float,
    ) -> None:
        names = [channel.name for channel in channels]
        self._watched = _watched(names, limits, stale_s)
        self._columns = np.array([item.index for item in self._watched], np.intp)
        self._low = np.array([item.low for item in self._watched], float)
        self._high = np.array([item.high for item in self._watched], float)
        self._stale_s = np.array([item.stale_s for item in self._watched], float)
        self._fresh_s: Array = np.full(len(self._watched), start_s)
        self._rpm = [
            names.index(f"rpm{i + 1}") for i in range(rig.n_rotors) if f"rpm{i + 1}" in names
        ]
        self._thrust = names.index("thrust_N") if "thrust_N" in names else -1
        self._n_rotors = rig.n_rotors
        self._pulse = rig.propulsion
        self._pwm_us: Array | None = None
        self._commanded_s = start_s
        self._slowest_rpm = self._fastest_rpm = np.zeros(rig.n_rotors)
        self._seen_rpm: Array = np.full(len(self._rpm), np.nan)
        self._thrust_per_rpm2 = rig.propulsion.thrust_coefficient_N_s2 * (pi / 30.0) ** 2
        self._margin_N = PLAUSIBLE_MARGIN * limits.load_cell_rating_N
        self._plausible_s = self._last_s = start_s
        self._same_N, self._same_since_s = np.nan, start_s
        self._square, self._rpm_moved_s = 0.0, -inf

    def commanded(self, pwm_us: Array, now_s: float) -> None:
        """Note what every motor is told (n_rotors,): us, to compare its rpm with."""
        if self._pwm_us is not None and np.array_equal(pwm_us, self._pwm_us):
            return
        pulse = self._pulse
        drive_us = np.where(pwm_us > pulse.pwm_stop_us, pwm_us - pulse.pwm_start_us, 0.0)
        rpm = pulse.speed_per_us_rad_s * np.maximum(drive_us, 0.0) * 30.0 / pi
        self._pwm_us, self._commanded_s = np.array(pwm_us), now_s
        self._slowest_rpm = TOO_SLOW * rpm - SLACK_RPM
        self._fastest_rpm = TOO_FAST * rpm + SLACK_RPM

    def breach(self, time_s: Array, values: Array) -> LimitExceeded | None:
        """Return the first limit that samples (m,), (m, c) break, or None.

        Args:
            time_s: of each sample, on the bench's clock.
            values: in channel order; nan where a channel had no new value.
        """
        if not len(time_s):
            return None
        seen = values[:, self._columns]
        broken = (seen > self._high) | (seen < self._low)
        if broken.any():
            return self._beyond(seen, broken)
        self._skip_gap(float(time_s[0]))
        self._last_s = float(time_s[-1])
        self._note_fresh(time_s, seen)
        silent_s = self._last_s - self._fresh_s
        if (silent_s > self._stale_s).any():
            return self._stale(silent_s)
        if len(self._rpm) < self._n_rotors:
            return None
        rpm = self._filled(values[:, self._rpm])
        error: LimitExceeded | None = None
        if self._thrust >= 0:
            thrust_N, squares = values[:, self._thrust], np.einsum("ij,ij->i", rpm, rpm)
            error = self._implausible(time_s, squares, thrust_N) or self._stuck(squares, thrust_N)
        return error or self._disobeyed(rpm)

    def _filled(self, rpm: Array) -> Array:
        """Return speeds (m, n) with every gap holding the channel's last reading.

        A device may send thrust and speeds in different rows; a reading that is too old to compare
        with is a silent channel, which is judged by itself.
        """
        if np.isnan(rpm).any():
            whole = np.vstack([self._seen_rpm, rpm])
            rows = np.where(np.isnan(whole), 0, np.arange(len(whole))[:, None])
            np.maximum.accumulate(rows, axis=0, out=rows)
            rpm = np.take_along_axis(whole, rows, axis=0)[1:]
        self._seen_rpm = rpm[-1].copy()
        return rpm

    def _skip_gap(self, first_s: float) -> None:
        gap_s = first_s - self._last_s
        if gap_s > GAP_S:
            self._fresh_s += gap_s
            self._plausible_s += gap_s
            self._same_since_s += gap_s

    def _note_fresh(self, time_s: Array, seen: Array) -> None:
        fresh = ~np.isnan(seen)
        newest = np.where(fresh, time_s[:, None], -inf).max(axis=0)
        np.maximum(self._fresh_s, newest, out=self._fresh_s)

    def _disobeyed(self, rpm: Array) -> LimitExceeded | None:
        """Return an error when a motor's rpm has not followed its pulse by now."""
        since_s = self._last_s - self._commanded_s
        if self._pwm_us is None or since_s < TOO_SLOW_S:
            return None
        # A motor that was never heard of compares as neither too slow nor too fast.
        bad = rpm[-1] < self._slowest_rpm
        limits_rpm = self._slowest_rpm
        if since_s > TOO_FAST_S and not bad.any():
            bad = rpm[-1] > self._fastest_rpm
            limits_rpm = self._fastest_rpm
        if not bad.any():
            return None
        motor = int(np.argmax(bad))
        return LimitExceeded(
            f"rpm{motor + 1}",
            float(rpm[-1, motor]),
            float(limits_rpm[motor]),
            f"that does not fit a pulse of {self._pwm_us[motor]:g} us after {since_s:.1f} s; check "
            f"motor {motor + 1}, its ESC, its rpm channel and the rig's pulse map",
        )

    def _stuck(self, squares: Array, thrust_N: Array) -> LimitExceeded | None:
        """Return an error when thrust repeats one number while rpm readings change."""
        shown = thrust_N[~np.isnan(thrust_N)]
        if len(shown) and not (shown == self._same_N).all():
            self._same_N = float(shown[-1])
            self._same_since_s = self._last_s
        turning = squares[squares > 0.0]
        if len(turning):
            if (turning != self._square).any():
                self._rpm_moved_s = self._last_s
            self._square = float(turning[-1])
        same_s = self._last_s - self._same_since_s
        if same_s <= STUCK_S or self._rpm_moved_s <= self._same_since_s:
            return None
        return LimitExceeded(
            "repetition of one thrust_N reading in s",
            same_s,
            STUCK_S,
            f"the load cell shows {self._same_N:.6g} N all the time; check its amplifier and cable",
        )

    def _implausible(self, time_s: Array, squares: Array, thrust_N: Array) -> LimitExceeded | None:
        """Return an error when thrust has disagreed with rpm for too long."""
        expected_N = self._thrust_per_rpm2 * squares
        high_N = PLAUSIBLE_HIGH * expected_N + self._margin_N
        low_N = PLAUSIBLE_LOW * expected_N - self._margin_N
        bad = (thrust_N > high_N) | (thrust_N < low_N)
        good = (thrust_N <= high_N) & (thrust_N >= low_N)
        if not bad.any():
            if good.any():
                self._plausible_s = float(time_s[good][-1])
            return None
        since_s = np.maximum.accumulate(np.maximum(np.where(good, time_s, -inf), self._plausible_s))
        self._plausible_s = float(since_s[-1])
        late = bad & (time_s - since_s > IMPLAUSIBLE_S)
        if not late.any():
            return None
        row = int(np.argmax(late))
        limit_N = high_N[row] if thrust_N[row] > high_N[row] else low_N[row]
        return LimitExceeded(
            "thrust_N",
            float(thrust_N[row]),
            float(limit_N),
            f"that is not plausible for {float(np.sqrt(squares[row] / len(self._rpm))):.0f} rpm, "
            f"where k w^2 gives {float(expected_N[row]):.3g} N; check the load cell's sign and "
            f"scale, the rpm channels and the rig's thrust coefficient",
        )

    def _beyond(self, seen: Array, broken: NDArray[np.bool_]) -> LimitExceeded:
        row = int(np.argmax(broken.any(axis=1)))
        column = int(np.argmax(broken[row]))
        watched, value = self._watched[column], float(seen[row, column])
        limit = watched.high if value > watched.high else watched.low
        return LimitExceeded(watched.name, value, limit, _ADVICE[watched.family])

    def _stale(self, silent_s: Array) -> LimitExceeded:
        column = int(np.argmax(silent_s > self._stale_s))
        watched = self._watched[column]
        return LimitExceeded(
            f"silence of {watched.name} in s",
            float(silent_s[column]),
            watched.stale_s,
            "the channel brings no new values; check its wiring and its sensor",
        )


def _watched(names: Sequence[str], limits: Limits, stale_s: float) -> list[_Watched]:
    thrust_N = min(limits.thrust_N, limits.load_cell_rating_N)
    bounds = {
        "thrust_N": (-thrust_N, thrust_N, stale_s),
        "rpm": (-inf, limits.rpm, stale_s),
        "current_A": (-inf, limits.current_A, SLOW * stale_s),
        "voltage_V": (limits.voltage_min_V, inf, SLOW * stale_s),
        "temperature_degC": (-inf, limits.temperature_degC, SLOW * stale_s),
    }
    found = []
    for index, name in enumerate(names):
        family = "rpm" if name.rstrip("0123456789") == "rpm" else name
        if family in bounds:
            found.append(_Watched(index, name, family, *bounds[family]))
    return found
