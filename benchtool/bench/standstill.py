"""Checks of measured rotor speeds: against pulse widths, and standstill after a stop.

Pulse widths are those of the host or of a control loop on the bench. Standstill of a rotor is
confirmed by its measured speed, or by its measured output if a bench reads its outputs back. Pulse
widths and acknowledgements that only repeat the command confirm nothing. Neither does thrust: the
largest accepted offset of a tare (0.1 % of `limits.thrust_N`) is the thrust of a rotor of the rig
pquad at 630 rpm. Pure functions of commands and readings.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import exp, inf, isnan, nan, pi

import numpy as np

from benchtool.bench.bench import DeviceInfo
from benchtool.core.errors import LimitExceeded
from benchtool.core.rig import Propulsion, Rig
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
        self._pwm_us: list[float] | None = None
        self._commanded_s = start_s
        self._min_rpm = self._max_rpm = [0.0] * n_rotors
        self.has_driven = False
        self.at_zero = True  # every motor is commanded to stop

    def record_command(self, pwm_us: Array, now_s: float) -> None:
        """Set the commanded pulse width of every motor (n_rotors,): us."""
        pulses_us = pwm_us.tolist()
        if pulses_us == self._pwm_us:
            return
        rpm = rotor_speeds(self._propulsion, pwm_us)
        self._pwm_us, self._commanded_s = pulses_us, now_s
        self._min_rpm = (TOO_SLOW * rpm - RPM_TOLERANCE).tolist()
        self._max_rpm = (TOO_FAST * rpm + RPM_TOLERANCE).tolist()
        self.at_zero = max(pulses_us) <= self._propulsion.pwm_stop_us
        self.has_driven |= not self.at_zero

    def find_mismatch(self, rpm: Sequence[float], now_s: float) -> LimitExceeded | None:
        """Return an error when a motor's last rpm (n_rotors,) has not followed its pulse by now."""
        since_s = now_s - self._commanded_s
        if self._pwm_us is None or since_s < TOO_SLOW_S:
            return None
        # nan compares as neither too slow nor too fast.
        limits_rpm = self._min_rpm
        bad = [speed < limit for speed, limit in zip(rpm, limits_rpm, strict=True)]
        if since_s > TOO_FAST_S and not any(bad):
            limits_rpm = self._max_rpm
            bad = [speed > limit for speed, limit in zip(rpm, limits_rpm, strict=True)]
        if not any(bad):
            return None
        motor = bad.index(True)
        pulses = f"a pulse of {self._pwm_us[motor]:g} us"
        return _mismatch_error(motor, rpm[motor], limits_rpm[motor], pulses, since_s)


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
                rpm_now, limit_rpm = float(self._rpm[motor]), float(limits_rpm[motor])
                return _mismatch_error(motor, rpm_now, limit_rpm, pulses, float(bad_s[motor]))
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


def _mismatch_error(
    motor: int, rpm: float, limit_rpm: float, pulses: str, since_s: float
) -> LimitExceeded:
    return LimitExceeded(
        f"rpm{motor + 1}",
        rpm,
        limit_rpm,
        f"that does not fit {pulses} after {since_s:.1f} s; check motor {motor + 1}, its ESC, "
        f"its rpm channel and the rig's pulse map",
    )


# Largest tip speed of a rotor at standstill: walking pace, at which even 0.1 kg of blade, all of it
# at the tip, has 0.05 J, as 50 g dropped from 0.1 m; assumed.
SAFE_TIP_SPEED_m_s = 1.0

FLICKER_SDS = 3.0  # tachometer noise at rest: standard deviations, plus one quantum
CONFIRMATION_TIME_S = 0.1  # below the threshold, because the first may be a dropout; assumed
REPORT_TIMEOUT_S = 0.5  # of drive; a speed channel still at zero then confirms no standstill
AVERAGING_TIME_S = 0.15  # longer drive turns a motor even after a stop: ESC lag 0.1-0.3 s; assumed
OUTPUT_SLACK_us = 3.0  # rounding of a stop pulse to an output and back; assumed


def standstill_rpm(rig: Rig) -> float:
    """Return the largest speed of a rotor of this rig at standstill: rpm."""
    sensor = rig.sensors.get("rpm")
    flicker_rpm = FLICKER_SDS * sensor.noise + sensor.quantum if sensor else 0.0
    return max(SAFE_TIP_SPEED_m_s / rig.propulsion.radius_m * 30.0 / pi, flicker_rpm)


@dataclass(frozen=True, slots=True)
class Standstill:
    """Standstill check since zero was commanded."""

    is_confirmed: bool  # standstill of every driven rotor is confirmed
    is_only_unmeasured: bool  # every rotor with a channel is confirmed, the others are not
    rpm: float  # highest speed above the threshold; nan if there is none
    text: str  # result as a sentence; empty if no motor was driven


class StandstillMonitor:
    """Standstill check of every rotor from commands and readings."""

    def __init__(self, identity: DeviceInfo, rig: Rig, now_s: float) -> None:
        names = [channel.name for channel in identity.channels]
        n = rig.n_rotors
        self._limit_rpm = standstill_rpm(rig)
        self._propulsion = rig.propulsion
        stop_us = rig.propulsion.pwm_stop_us
        self._stop_us = stop_us if identity.pwm_stop_us is None else identity.pwm_stop_us
        self._speed_columns = [_find_column(names, f"rpm{rotor}") for rotor in range(1, n + 1)]
        pwm_columns = [_find_column(names, f"pwm{rotor}_us") for rotor in range(1, n + 1)]
        self._output_columns = pwm_columns if identity.outputs_measured else [None] * n
        self._pwm_columns = pwm_columns
        self._reported_columns: list[int | None] = [None] * n
        if identity.has_loop:
            self.expect_loop()
        self._pulses_us: Array = np.full(n, stop_us)
        self._expected_rpm = [0.0] * n
        self._rotors = [_RotorState(now_s) for _ in range(n)]
        self.zero_s = now_s  # time of the last stop command of a motor, bench time

    def expect_loop(self) -> None:
        """Expect the speeds of the pulse widths that the bench reports."""
        self._reported_columns = self._pwm_columns

    def record_command(self, pulses_us: Array, now_s: float) -> None:
        """Record the command of every motor (n_rotors,): us, before it is sent."""
        stop_us = self._propulsion.pwm_stop_us
        for rotor, before_us, pulse_us in zip(
            self._rotors, self._pulses_us, pulses_us, strict=True
        ):
            if pulse_us > stop_us:
                rotor.driven, rotor.zero_s = True, inf
            elif before_us > stop_us:
                rotor.restart(now_s)
                self.zero_s = now_s
        self._pulses_us = np.array(pulses_us)
        self._expected_rpm = rotor_speeds(self._propulsion, self._pulses_us).tolist()

    def update(self, time_s: Array, values: Array) -> None:
        """Update the check with samples (m,), (m, c); nan where a channel had no new value."""
        if not len(time_s):
            return
        times_s, columns = time_s.tolist(), values.T.tolist()
        max_output_us = self._stop_us + OUTPUT_SLACK_us
        for index, rotor in enumerate(self._rotors):
            if (speed_column := self._speed_columns[index]) is not None:
                rpm = [abs(speed) for speed in columns[speed_column]]
                if rotor.zero_s < inf:
                    is_low = [speed < self._limit_rpm for speed in rpm]
                    rotor.speed.take(times_s, rpm, is_low, rotor.zero_s)
                expected = self._expected_rpm[index]
                if (pwm_column := self._reported_columns[index]) is not None:
                    # A loop sets the pulse widths: the smallest reported one is expected.
                    lowest_us = np.nanmin(values[:, pwm_column], initial=inf)
                    expected = float(rotor_speeds(self._propulsion, np.array([lowest_us]))[0])
                rotor.compare(times_s, rpm, expected, self._limit_rpm)
            output_column = self._output_columns[index]
            if output_column is not None and rotor.zero_s < inf:
                output_us = columns[output_column]
                is_low = [width_us <= max_output_us for width_us in output_us]
                rotor.output.take(times_s, output_us, is_low, rotor.zero_s)

    def state(self) -> Standstill:
        """Return the result so far."""
        turning: list[str] = []
        # Time of the newest reading of a turning rotor, and of the last confirmation.
        read_s = standstill_s = self.zero_s
        silent, unmeasured, standing, fastest_rpm = [], [], [], nan
        for number, rotor in enumerate(self._rotors, 1):
            speed, output = rotor.speed, rotor.output
            has_speed = self._speed_columns[number - 1] is not None
            has_output = self._output_columns[number - 1] is not None
            if speed.is_high:
                turning.append(f"rpm{number} {speed.last:.0f}")
                read_s = max(read_s, speed.last_s)
                fastest_rpm = max(speed.last, fastest_rpm if fastest_rpm == fastest_rpm else 0.0)
            elif output.is_high:
                turning.append(f"output of rotor {number} {output.last:.0f} us")
                read_s = max(read_s, output.last_s)
            elif not rotor.driven:
                continue
            elif (speed.is_low and rotor.speed_responds) or output.is_low:
                standing.append(number)
                times_s = [channel.standstill_s for channel in (speed, output) if channel.is_low]
                standstill_s = max(standstill_s, min(times_s))
            elif has_speed or has_output:
                silent.append(number)
            else:
                unmeasured.append(number)
        parts = []
        if turning:
            after_s = read_s - self.zero_s
            parts.append(
                f"MOTORS MAY STILL TURN: {', '.join(turning)}, {after_s:.1f} s after zero was "
                f"commanded (below {self._limit_rpm:.0f} rpm counts as standing), cut the power"
            )
        if silent:
            without_reading = [n for n in silent if self._rotors[n - 1].speed_responds]
            reason = (
                "no reading came after zero was commanded"
                if without_reading
                else "the speed channel did not show the motor turning"
            )
            parts.append(f"{_format_rotors(silent)} not seen to stand: {reason}; cut the power")
        if unmeasured:
            parts.append(
                f"{_format_rotors(unmeasured)} not seen to stand: this bench measures no speed "
                f"there; look before you go near"
            )
        if standing:
            after_s = standstill_s - self.zero_s
            parts.append(
                f"{_format_rotors(standing)} seen to stand {after_s:.1f} s after zero was commanded"
            )
        is_unconfirmed = bool(turning or silent)
        return Standstill(
            is_confirmed=not is_unconfirmed and not unmeasured,
            is_only_unmeasured=bool(unmeasured) and not is_unconfirmed,
            rpm=fastest_rpm,
            text="; ".join(parts),
        )


class _ChannelState:
    """State of one channel of a rotor; the newest reading decides."""

    def __init__(self) -> None:
        self.last = nan
        self._low_s = nan
        self.last_s = nan
        self.standstill_s = nan  # time at which readings had first stayed low for long enough

    @property
    def is_low(self) -> bool:
        """Return whether readings stayed low for long enough."""
        return self.last_s - self._low_s >= CONFIRMATION_TIME_S - 1e-9

    @property
    def is_high(self) -> bool:
        """Return whether the newest reading is above the threshold."""
        return self.last == self.last and self._low_s != self._low_s

    def take(
        self, times_s: list[float], values: list[float], is_low: list[bool], since_s: float
    ) -> None:
        for time_s, value, low in zip(times_s, values, is_low, strict=True):
            if isnan(value) or time_s <= since_s:
                continue
            self.last, self.last_s = value, time_s
            if not low:
                self._low_s = self.standstill_s = nan
                continue
            if isnan(self._low_s):
                self._low_s = time_s
            if isnan(self.standstill_s) and self.is_low:
                self.standstill_s = time_s


class _RotorState:
    """State of one rotor."""

    def __init__(self, now_s: float) -> None:
        self.driven = self.has_turned = False
        self.speed_responds = True
        self.zero_s = now_s
        self.speed, self.output = _ChannelState(), _ChannelState()
        self._due_s = inf

    def restart(self, now_s: float) -> None:
        """Discard the readings before this stop command."""
        self.zero_s = now_s
        self.speed, self.output = _ChannelState(), _ChannelState()

    def compare(
        self, times_s: list[float], rpm: list[float], expected_rpm: float, limit_rpm: float
    ) -> None:
        """Update whether the speed channel responds to a drive well above standstill."""
        present = [speed for speed in rpm if not isnan(speed)]
        is_high = any(speed >= limit_rpm for speed in present)
        self.has_turned |= is_high
        self.speed_responds |= is_high
        if self.zero_s < inf or not expected_rpm > 2.0 * limit_rpm:
            self._due_s = inf
            return
        self._due_s = min(self._due_s, times_s[0])
        driven_s = times_s[-1] - self._due_s
        if present and driven_s >= REPORT_TIMEOUT_S:
            self.speed_responds = present[-1] >= limit_rpm
        elif driven_s > AVERAGING_TIME_S and not self.has_turned:
            self.speed_responds = False


def format_unmeasured_rotors(identity: DeviceInfo, rig: Rig) -> str:
    """Return the rotors whose standstill cannot be confirmed as a sentence, or ""."""
    names = {channel.name for channel in identity.channels}
    unmeasured = [
        number
        for number in range(1, rig.n_rotors + 1)
        if f"rpm{number}" not in names
        and not (identity.outputs_measured and f"pwm{number}_us" in names)
    ]
    if not unmeasured:
        return ""
    return (
        f"{_format_rotors(unmeasured, 'will not be')} seen to stand: this bench measures no speed "
        f"there; after every stop, look before you go near"
    )


def _find_column(names: Sequence[str], name: str) -> int | None:
    return names.index(name) if name in names else None


def _format_rotors(numbers: Iterable[int], verb: str = "") -> str:
    texts = [str(number) for number in numbers]
    if len(texts) == 1:
        return f"rotor {texts[0]} {verb or 'was'}"
    return f"rotors {', '.join(texts[:-1])} and {texts[-1]} {verb or 'were'}"
