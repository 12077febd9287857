"""Every limit on every sample, a block at a time: pure, nothing commanded, nothing raised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, pi

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.channel_limits import CHECKS
from benchtool.bench.plate_check import CHANNEL, plate_tolerance_m
from benchtool.bench.rpm_tracking import GAP_S, HostPulseTracking, LoopPulseTracking
from benchtool.core.array_type import Array
from benchtool.core.channel import Channel, channel_family
from benchtool.core.errors import BenchError, LimitExceeded, ReadingsLate
from benchtool.core.rig import Limits, Rig

PLAUSIBLE_LOW, PLAUSIBLE_HIGH = 0.2, 3.5
"""Band of thrust over k sum w^2. Ground effect in its range of validity stays below 2.5 (paper,
eq. 4, z/R from 0.5 on); the rest is room for a k that is only roughly known. A choice."""

PLAUSIBLE_MARGIN = 0.05  # share of the cell's rating on top: no tare, noise; assumed
IMPLAUSIBLE_TIMEOUT_S = 0.6  # time that thrust may disagree with rpm: slow amplifiers lag by 0.4 s
FROZEN_TIMEOUT_S = 3.0  # of one repeated number while rpm changes: 240 readings at 80 Hz; assumed


@dataclass(frozen=True, slots=True)
class _Watched:
    index: int
    name: str
    advice: str
    low: float
    high: float
    stale_s: float


class LimitCheck:
    """Judge blocks of samples against the limits of a rig.

    Args:
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
        self._names, self._rotor_stale_s = names, stale_s
        self._watch(_watched(names, limits, stale_s), start_s)
        self._rpm = [
            names.index(f"rpm{i + 1}") for i in range(rig.n_rotors) if f"rpm{i + 1}" in names
        ]
        self._thrust = names.index("thrust_N") if "thrust_N" in names else -1
        self._plate = names.index(CHANNEL) if CHANNEL in names else -1
        self._nearest_m = rig.plate.z_min_m - plate_tolerance_m(rig)
        self._turning = False
        self._stop_us = rig.propulsion.pwm_stop_us
        self._n_rotors = rig.n_rotors
        self._rig = rig
        self._host = HostPulseTracking(rig.propulsion, rig.n_rotors, start_s)
        self._loop: LoopPulseTracking | None = None
        self._armed_else = False
        self._pwm = [
            names.index(f"pwm{i + 1}_us") for i in range(rig.n_rotors) if f"pwm{i + 1}_us" in names
        ]
        self._seen_us: Array = np.full(len(self._pwm), np.nan)
        self._seen_rpm: Array = np.full(len(self._rpm), np.nan)
        self._thrust_per_rpm2 = rig.propulsion.thrust_coefficient_N_s2 * (pi / 30.0) ** 2
        self._margin_N = PLAUSIBLE_MARGIN * limits.load_cell_rating_N
        self._plausible_s = self._last_s = start_s
        self._same_N, self._same_since_s = np.nan, start_s
        self._square, self._rpm_moved_s = 0.0, -inf

    def _watch(self, watched: list[_Watched], now_s: float) -> None:
        self._watched = watched
        self._columns = np.array([item.index for item in watched], np.intp)
        self._low = np.array([item.low for item in watched], float)
        self._high = np.array([item.high for item in watched], float)
        self._stale_s = np.array([item.stale_s for item in watched], float)
        self._fresh_s: Array = np.full(len(watched), now_s)

    def tighten(self, limits: Limits) -> None:
        """Watch other limits from now on, on the same channels."""
        new = {one.index: one for one in _watched(self._names, limits, self._rotor_stale_s)}
        self._watched = [new.get(one.index, one) for one in self._watched]
        self._low = np.array([one.low for one in self._watched], float)
        self._high = np.array([one.high for one in self._watched], float)

    def commanded(self, pwm_us: Array, now_s: float) -> None:
        """Note what every motor is commanded (n_rotors,): us, to compare its rpm with."""
        self._turning = bool((pwm_us > self._stop_us).any())
        self._host.commanded(pwm_us, now_s)

    def expect_loop(self, now_s: float, *, armed_else: bool) -> None:
        """Judge speeds by the pulses that the bench reports: a loop on it makes them.

        Without a pulse of every rotor in the stream, the host's commands go on to count. Pulses
        that fall silent end the run as speeds do: they are what speeds are judged by.

        Args:
            armed_else: somebody else may start the motors, as with a transmitter, so they may turn
                before the host commands anything.
        """
        if self._loop is not None or len(self._pwm) < self._n_rotors:
            return
        stale_s = self._rotor_stale_s
        pulses = [_Watched(i, self._names[i], "", -inf, inf, stale_s) for i in self._pwm]
        self._watch([*self._watched, *pulses], now_s)
        self._loop = LoopPulseTracking(self._rig.propulsion, self._n_rotors, now_s)
        self._armed_else = armed_else

    def breach(
        self, time_s: Array, values: Array, late: ReadingsLate | None = None
    ) -> BenchError | None:
        """Return the first limit that samples (m,), (m, c) break, nan without a value, or None.

        Args:
            late: what is wrong with the times of these samples; it is returned instead of saying
                that a rotor does not follow its pulse.
        """
        if not len(time_s):
            return None
        seen = values[:, self._columns]
        broken = (seen > self._high) | (seen < self._low)
        if broken.any():
            return self._beyond(seen, broken)
        if self._turning and self._plate >= 0:
            plate_m = values[:, self._plate]
            near = plate_m[plate_m < self._nearest_m]
            if len(near):
                return LimitExceeded(
                    CHANNEL,
                    float(near[0]),
                    self._rig.plate.z_min_m,
                    "the plate is nearer than the rig's least gap while motors turn; move it away "
                    "by hand, then check stage and sensor",
                )
        if (gap_s := float(time_s[0]) - self._last_s) > GAP_S:
            self._fresh_s += gap_s
            self._plausible_s += gap_s
            self._same_since_s += gap_s
        self._last_s = float(time_s[-1])
        newest = np.where(np.isnan(seen), -inf, time_s[:, None]).max(axis=0)
        np.maximum(self._fresh_s, newest, out=self._fresh_s)
        silent_s = self._last_s - self._fresh_s
        if (silent_s > self._stale_s).any():
            column = int(np.argmax(silent_s > self._stale_s))
            watched = self._watched[column]
            return LimitExceeded(
                f"silence of {watched.name} in s",
                float(silent_s[column]),
                watched.stale_s,
                "the channel brings no new values; check its wiring and its sensor",
            )
        if len(self._rpm) < self._n_rotors:
            return None
        rpm, self._seen_rpm = _filled(values[:, self._rpm], self._seen_rpm)
        error: LimitExceeded | None = None
        if self._thrust >= 0:
            thrust_N, squares = values[:, self._thrust], np.einsum("ij,ij->i", rpm, rpm)
            error = self._implausible(time_s, squares, thrust_N) or self._stuck(squares, thrust_N)
        if error is None and (error := self._mismatch(values, rpm)) is not None:
            return late or error
        return error

    def _mismatch(self, values: Array, rpm: Array) -> LimitExceeded | None:
        """Return an error when a motor's rpm has not followed its pulse by now.

        Where a loop on the bench makes the pulses, those it reports count. The host's zero counts
        all the same: a loop that turns motors after it is as wrong as a motor that does. A bench
        that reports no pulses is judged by the host's, which is stricter than not at all.
        """
        if self._loop is None:
            return self._host.mismatch(rpm[-1], self._last_s)
        pwm_us, self._seen_us = _filled(values[:, self._pwm], self._seen_us)
        error = self._loop.mismatch(pwm_us, rpm, self._last_s)
        if error is None and self._host.at_zero and (self._host.has_driven or not self._armed_else):
            error = self._host.mismatch(rpm[-1], self._last_s)
        return error

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
        if same_s <= FROZEN_TIMEOUT_S or self._rpm_moved_s <= self._same_since_s:
            return None
        return LimitExceeded(
            "repetition of one thrust_N reading in s",
            same_s,
            FROZEN_TIMEOUT_S,
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
        late = bad & (time_s - since_s > IMPLAUSIBLE_TIMEOUT_S)
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
        return LimitExceeded(watched.name, value, limit, watched.advice)


def unmonitored_limits(channels: Sequence[Channel], n_rotors: int) -> str:
    """Return in a sentence which limits of a rig no channel of a bench can break; else nothing."""
    names = {channel.name for channel in channels}
    watched = [kind for kind, checks in CHECKS.items() if checks.limits]
    speeds = [f"rpm{rotor + 1}" for rotor in range(n_rotors)]
    wanted = (name for kind in watched for name in (speeds if kind == "rpm" else [kind]))
    missing = [name for name in wanted if name not in names]
    if not missing:
        return ""
    return f"no channel brings {', '.join(missing)}: the rig's limits on them are not watched"


def _watched(names: Sequence[str], limits: Limits, stale_s: float) -> list[_Watched]:
    found = []
    for index, name in enumerate(names):
        checks = CHECKS.get(channel_family(name))
        if checks and checks.limits:
            low, high = checks.limits(limits)
            found.append(_Watched(index, name, checks.advice, low, high, checks.silence * stale_s))
    return found


def _filled(rows: Array, seen: Array) -> tuple[Array, Array]:
    """Return rows (m, n) with every gap holding the channel's last reading, and the last row.

    A device may send thrust and speeds in different rows; a reading that is too old to compare
    with is a silent channel, which is judged by itself.

    Args:
        seen: (n,) the last ones before them.
    """
    if np.isnan(rows).any():
        whole = np.vstack([seen, rows])
        at = np.where(np.isnan(whole), 0, np.arange(len(whole))[:, None])
        np.maximum.accumulate(at, axis=0, out=at)
        rows = np.take_along_axis(whole, at, axis=0)[1:]
    return rows, rows[-1].copy()
