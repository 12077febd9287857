"""Standstill check after a stop, from measured speeds.

Standstill of a rotor is confirmed by its measured speed, or by its measured output if a bench reads
its outputs back. Pulse widths and acknowledgements that only repeat the command confirm nothing.
Neither does thrust: the largest accepted offset of a tare (0.1 % of `limits.thrust_N`) is the
thrust of a rotor of the rig pquad at 630 rpm. Pure functions of commands and readings.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf, nan, pi

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.bench import DeviceInfo
from benchtool.bench.rpm_tracking import rotor_speeds
from benchtool.core.rig import Rig
from benchtool.core.units import Array

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

    def update(self, time_s: Array, values: Array) -> None:
        """Update the check with samples (m,), (m, c); nan where a channel had no new value."""
        if not len(time_s):
            return
        expected_rpm = rotor_speeds(self._propulsion, self._pulses_us)
        for index, rotor in enumerate(self._rotors):
            if (speed_column := self._speed_columns[index]) is not None:
                rpm = np.abs(values[:, speed_column])
                rotor.speed.take(time_s, rpm, rpm < self._limit_rpm, rotor.zero_s)
                expected = float(expected_rpm[index])
                if (pwm_column := self._reported_columns[index]) is not None:
                    # A loop sets the pulse widths: the smallest reported one is expected.
                    lowest_us = np.nanmin(values[:, pwm_column], initial=inf)
                    expected = float(rotor_speeds(self._propulsion, np.array([lowest_us]))[0])
                rotor.compare(time_s, rpm, expected, self._limit_rpm)
            if (output_column := self._output_columns[index]) is not None:
                output_us = values[:, output_column]
                is_low = output_us <= self._stop_us + OUTPUT_SLACK_us
                rotor.output.take(time_s, output_us, is_low, rotor.zero_s)

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

    def reset(self) -> None:
        self.last = self._low_s = self.last_s = self.standstill_s = nan

    @property
    def is_low(self) -> bool:
        """Return whether readings stayed low for long enough."""
        return self.last_s - self._low_s >= CONFIRMATION_TIME_S - 1e-9

    @property
    def is_high(self) -> bool:
        """Return whether the newest reading is above the threshold."""
        return self.last == self.last and self._low_s != self._low_s

    def take(self, time_s: Array, values: Array, is_low: NDArray[np.bool_], since_s: float) -> None:
        fresh = np.flatnonzero(~np.isnan(values) & (time_s > since_s))
        if not len(fresh):
            return
        highs = np.flatnonzero(~is_low[fresh])
        if len(highs):
            self._low_s = nan
            fresh_low = fresh[highs[-1] + 1 :]
        else:
            fresh_low = fresh
        if len(fresh_low) and self._low_s != self._low_s:
            self._low_s = float(time_s[fresh_low[0]])
        self.last, self.last_s = float(values[fresh[-1]]), float(time_s[fresh[-1]])
        if len(highs):
            self.standstill_s = nan
        if self.is_low and self.standstill_s != self.standstill_s:
            is_confirmed = time_s[fresh_low] - self._low_s >= CONFIRMATION_TIME_S - 1e-9
            self.standstill_s = float(time_s[fresh_low[is_confirmed][0]])


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
        self.speed.reset()
        self.output.reset()

    def compare(self, time_s: Array, rpm: Array, expected_rpm: float, limit_rpm: float) -> None:
        """Update whether the speed channel responds to a drive well above standstill."""
        is_high = bool((rpm >= limit_rpm).any())
        self.has_turned |= is_high
        self.speed_responds |= is_high
        if self.zero_s < inf or not expected_rpm > 2.0 * limit_rpm:
            self._due_s = inf
            return
        self._due_s = min(self._due_s, float(time_s[0]))
        driven_s = time_s[-1] - self._due_s
        present = rpm[~np.isnan(rpm)]
        if len(present) and driven_s >= REPORT_TIMEOUT_S:
            self.speed_responds = bool(present[-1] >= limit_rpm)
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
