"""Whether motors turn as they are commanded, by the host or by a control loop on the bench."""

from __future__ import annotations

from math import exp, pi

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.errors import LimitExceeded
from benchtool.core.rig import Propulsion

TOO_SLOW, TOO_SLOW_S = 0.25, 2.0
"""A motor slower than this share of what its pulse gives, so long after the command, is dead, or
its rpm channel is. The share leaves room for a pulse map that is only roughly known. A choice."""

TOO_FAST, TOO_FAST_S = 4.0, 5.0  # for a motor that is faster, or turns without a command
RPM_TOLERANCE = (
    300.0  # on both, for pulses near the start of the map, where motors stutter; assumed
)
MEAN_S = 0.5  # time constant of speed and pulse means: ten lags of a motor; assumed
GAP_S = 0.5  # the stream was not read for longer: our own gap, not that of a channel


class HostPulseTracking:
    """Hold each rotor's speed against the pulse that the host commands."""

    def __init__(self, propulsion: Propulsion, n_rotors: int, start_s: float) -> None:
        self._propulsion = propulsion
        self._pwm_us: Array | None = None
        self._commanded_s = start_s
        self._slowest_rpm = self._fastest_rpm = np.zeros(n_rotors)
        self.has_driven = False

    @property
    def at_zero(self) -> bool:
        """Whether the host commands no motor to turn."""
        stop_us = self._propulsion.pwm_stop_us
        return self._pwm_us is None or bool((self._pwm_us <= stop_us).all())

    def commanded(self, pwm_us: Array, now_s: float) -> None:
        """Note what every motor is commanded (n_rotors,): us."""
        if self._pwm_us is not None and np.array_equal(pwm_us, self._pwm_us):
            return
        rpm = rotor_speeds(self._propulsion, pwm_us)
        self._pwm_us, self._commanded_s = np.array(pwm_us), now_s
        self._slowest_rpm = TOO_SLOW * rpm - RPM_TOLERANCE
        self._fastest_rpm = TOO_FAST * rpm + RPM_TOLERANCE
        self.has_driven |= not self.at_zero

    def mismatch(self, rpm: Array, now_s: float) -> LimitExceeded | None:
        """Return an error when a motor's last rpm (n_rotors,) has not followed its pulse by now."""
        since_s = now_s - self._commanded_s
        if self._pwm_us is None or since_s < TOO_SLOW_S:
            return None
        # A motor without a reading compares as neither too slow nor too fast.
        bad = rpm < self._slowest_rpm
        limits_rpm = self._slowest_rpm
        if since_s > TOO_FAST_S and not bad.any():
            bad = rpm > self._fastest_rpm
            limits_rpm = self._fastest_rpm
        if not bad.any():
            return None
        motor = int(np.argmax(bad))
        return _error(motor, rpm, limits_rpm, f"a pulse of {self._pwm_us[motor]:g} us", since_s)


class LoopPulseTracking:
    """Hold each rotor's speed against the pulses that a bench's own loop reports.

    What the host commanded last says nothing of them: the loop adds to it, saturates, ends its
    schedule. A motor is judged by running means, and must be wrong for as long as one that the
    host drives; the means make that later by less than a second.
    """

    def __init__(self, propulsion: Propulsion, n_rotors: int, start_s: float) -> None:
        self._propulsion = propulsion
        self._reported_rpm: Array = np.full(n_rotors, np.nan)
        self._rpm: Array = np.full(n_rotors, np.nan)
        self._last_s = start_s
        self._not_slow_s: Array = np.full(n_rotors, start_s)
        self._not_fast_s: Array = np.full(n_rotors, start_s)

    def mismatch(self, pwm_us: Array, rpm: Array, now_s: float) -> LimitExceeded | None:
        """Return an error when a motor has not followed its reported pulses.

        Args:
            pwm_us: (m, n_rotors) a block of pulses as the bench reports them, gaps filled.
        """
        gap_s, self._last_s = now_s - self._last_s, now_s
        reported_rpm, seen = rotor_speeds(self._propulsion, pwm_us).mean(axis=0), rpm.mean(axis=0)
        if gap_s > GAP_S:  # nobody looked: what happened meanwhile is not known
            self._not_slow_s, self._not_fast_s = self._not_slow_s + gap_s, self._not_fast_s + gap_s
        share = 1.0 - exp(-max(gap_s, 0.0) / MEAN_S)
        self._reported_rpm = _moved(self._reported_rpm, reported_rpm, share)
        self._rpm = _moved(self._rpm, seen, share)
        slowest = TOO_SLOW * self._reported_rpm - RPM_TOLERANCE
        fastest = TOO_FAST * self._reported_rpm + RPM_TOLERANCE
        self._not_slow_s = np.where(self._rpm < slowest, self._not_slow_s, now_s)
        self._not_fast_s = np.where(self._rpm > fastest, self._not_fast_s, now_s)
        for limits_rpm, good_s, allowed_s in (
            (slowest, self._not_slow_s, TOO_SLOW_S),
            (fastest, self._not_fast_s, TOO_FAST_S),
        ):
            bad_s = now_s - good_s
            if (bad_s > allowed_s).any():
                motor = int(np.argmax(bad_s))
                words = f"the pulses that the bench reports, now {pwm_us[-1, motor]:g} us,"
                return _error(motor, self._rpm, limits_rpm, words, float(bad_s[motor]))
        return None


def rotor_speeds(propulsion: Propulsion, pwm_us: Array) -> Array:
    """Return the speeds that pulses give by the rig's map, of the same shape: rpm."""
    stop_us, start_us = propulsion.pwm_stop_us, propulsion.pwm_start_us
    drive_us = np.where(pwm_us > stop_us, pwm_us - start_us, 0.0)
    rpm: Array = propulsion.speed_per_us_rad_s * np.maximum(drive_us, 0.0) * 30.0 / pi
    return np.where(np.isnan(pwm_us), np.nan, rpm)


def _moved(mean: Array, new: Array, share: float) -> Array:
    """Return the running means moved towards new values; those without a reading begin there."""
    moved = np.where(np.isnan(mean), new, mean + share * (new - mean))
    return np.where(np.isnan(moved), mean, moved)


def _error(motor: int, rpm: Array, limits_rpm: Array, pulses: str, since_s: float) -> LimitExceeded:
    return LimitExceeded(
        f"rpm{motor + 1}",
        float(rpm[motor]),
        float(limits_rpm[motor]),
        f"that does not fit {pulses} after {since_s:.1f} s; check motor {motor + 1}, its ESC, its "
        f"rpm channel and the rig's pulse map",
    )
