"""Comparison of rotor speeds with pulse widths, from the host or a control loop on the bench."""

from __future__ import annotations

from math import exp, pi

import numpy as np

from benchtool.core.errors import LimitExceeded
from benchtool.core.rig import Propulsion
from benchtool.core.units import Array

# Least share of the expected speed this long after the command; below it the motor or its rpm
# channel has failed. The margin covers a roughly known pulse map; assumed.
TOO_SLOW, TOO_SLOW_S = 0.25, 2.0

TOO_FAST, TOO_FAST_S = 4.0, 5.0  # for a motor that is faster, or turns without a command
RPM_TOLERANCE = 300.0  # on both, for the start of the pulse map, where motors stutter; assumed
MEAN_S = 0.5  # time constant of speed and pulse means: ten lags of a motor; assumed
GAP_S = 0.5  # a longer gap is a pause of the reader, not of a channel


class HostPulseTracking:
    """Comparison of each rotor's speed with the pulse width that the host commands."""

    def __init__(self, propulsion: Propulsion, n_rotors: int, start_s: float) -> None:
        self._propulsion = propulsion
        self._pwm_us: Array | None = None
        self._commanded_s = start_s
        self._min_rpm = self._max_rpm = np.zeros(n_rotors)
        self.has_driven = False

    @property
    def at_zero(self) -> bool:
        """Return whether every motor is commanded to stop."""
        stop_us = self._propulsion.pwm_stop_us
        return self._pwm_us is None or bool((self._pwm_us <= stop_us).all())

    def record_command(self, pwm_us: Array, now_s: float) -> None:
        """Set the commanded pulse width of every motor (n_rotors,): us."""
        if self._pwm_us is not None and np.array_equal(pwm_us, self._pwm_us):
            return
        rpm = rotor_speeds(self._propulsion, pwm_us)
        self._pwm_us, self._commanded_s = np.array(pwm_us), now_s
        self._min_rpm = TOO_SLOW * rpm - RPM_TOLERANCE
        self._max_rpm = TOO_FAST * rpm + RPM_TOLERANCE
        self.has_driven |= not self.at_zero

    def find_mismatch(self, rpm: Array, now_s: float) -> LimitExceeded | None:
        """Return an error when a motor's last rpm (n_rotors,) has not followed its pulse by now."""
        since_s = now_s - self._commanded_s
        if self._pwm_us is None or since_s < TOO_SLOW_S:
            return None
        # nan compares as neither too slow nor too fast.
        bad = rpm < self._min_rpm
        limits_rpm = self._min_rpm
        if since_s > TOO_FAST_S and not bad.any():
            bad = rpm > self._max_rpm
            limits_rpm = self._max_rpm
        if not bad.any():
            return None
        motor = int(np.argmax(bad))
        pulses = f"a pulse of {self._pwm_us[motor]:g} us"
        return _error(motor, rpm, limits_rpm, pulses, since_s)


class LoopPulseTracking:
    """Comparison of each rotor's speed with the pulse widths that a loop on the bench reports.

    The host's last command does not apply: the loop adds to it, saturates, and ends its schedule.
    Running means are compared, with the same time limits as for the host's commands; the means
    delay the error by less than a second.
    """

    def __init__(self, propulsion: Propulsion, n_rotors: int, start_s: float) -> None:
        self._propulsion = propulsion
        self._reported_rpm: Array = np.full(n_rotors, np.nan)
        self._rpm: Array = np.full(n_rotors, np.nan)
        self._last_s = start_s
        self._not_slow_s: Array = np.full(n_rotors, start_s)
        self._not_fast_s: Array = np.full(n_rotors, start_s)

    def find_mismatch(self, pwm_us: Array, rpm: Array, now_s: float) -> LimitExceeded | None:
        """Return an error if a motor has not followed its reported pulse widths (m, n_rotors)."""
        gap_s, self._last_s = now_s - self._last_s, now_s
        reported_rpm, means = rotor_speeds(self._propulsion, pwm_us).mean(axis=0), rpm.mean(axis=0)
        if gap_s > GAP_S:  # not read meanwhile, so the state in the gap is unknown
            self._not_slow_s, self._not_fast_s = self._not_slow_s + gap_s, self._not_fast_s + gap_s
        weight = 1.0 - exp(-max(gap_s, 0.0) / MEAN_S)
        self._reported_rpm = _update_mean(self._reported_rpm, reported_rpm, weight)
        self._rpm = _update_mean(self._rpm, means, weight)
        min_rpm = TOO_SLOW * self._reported_rpm - RPM_TOLERANCE
        max_rpm = TOO_FAST * self._reported_rpm + RPM_TOLERANCE
        self._not_slow_s = np.where(self._rpm < min_rpm, self._not_slow_s, now_s)
        self._not_fast_s = np.where(self._rpm > max_rpm, self._not_fast_s, now_s)
        for limits_rpm, good_s, allowed_s in (
            (min_rpm, self._not_slow_s, TOO_SLOW_S),
            (max_rpm, self._not_fast_s, TOO_FAST_S),
        ):
            bad_s = now_s - good_s
            if (bad_s > allowed_s).any():
                motor = int(np.argmax(bad_s))
                pulses = f"the pulse widths that the bench reports, now {pwm_us[-1, motor]:g} us,"
                return _error(motor, self._rpm, limits_rpm, pulses, float(bad_s[motor]))
        return None


def rotor_speeds(propulsion: Propulsion, pwm_us: Array) -> Array:
    """Return the speeds for pulse widths from the rig's pulse map, of the same shape: rpm."""
    stop_us, start_us = propulsion.pwm_stop_us, propulsion.pwm_start_us
    drive_us = np.where(pwm_us > stop_us, pwm_us - start_us, 0.0)
    rpm: Array = propulsion.speed_per_us_rad_s * np.maximum(drive_us, 0.0) * 30.0 / pi
    return np.where(np.isnan(pwm_us), np.nan, rpm)


def _update_mean(mean: Array, new: Array, weight: float) -> Array:
    """Return updated running means; nan means start at the new value."""
    updated = np.where(np.isnan(mean), new, mean + weight * (new - mean))
    return np.where(np.isnan(updated), mean, updated)


def _error(motor: int, rpm: Array, limits_rpm: Array, pulses: str, since_s: float) -> LimitExceeded:
    return LimitExceeded(
        f"rpm{motor + 1}",
        float(rpm[motor]),
        float(limits_rpm[motor]),
        f"that does not fit {pulses} after {since_s:.1f} s; check motor {motor + 1}, its ESC, "
        f"its rpm channel and the rig's pulse map",
    )
