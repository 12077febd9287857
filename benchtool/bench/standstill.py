"""Whether rotors stand after a stop: what was measured, never what was acknowledged.

A rotor is seen to stand by its measured speed, or by its measured output where a bench reads its
outputs back. The device's own pulses and acknowledgements repeat the command and show nothing.
Thrust shows nothing either: what a tare may leave (0.1 % of `limits.thrust_N`) is the thrust of a
rotor of the rig pquad at 630 rpm. Pure.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf, nan, pi

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.bench import DeviceInfo
from benchtool.bench.rpm_tracking import rotor_speeds
from benchtool.core.array_type import Array
from benchtool.core.rig import Rig

SAFE_TIP_SPEED_m_s = 1.0
"""A rotor whose tips are slower counts as standing: walking pace, at which even 0.1 kg of blade,
all of it at the tip, carries 0.05 J, as 50 g dropped from 0.1 m. A choice."""

FLICKER_SDS = 3.0  # a tachometer's noise at rest: standard deviations and one quantum
CONFIRMATION_TIME_S = 0.1  # readings stay below the threshold: the first may be a dropout; assumed
REPORT_TIMEOUT_S = (
    0.5  # of drive after which a speed channel that shows nothing shows no standstill
)
AVERAGING_TIME_S = (
    0.15  # longer drive turns a motor even after a stop: ESCs take 0.1 to 0.3 s; assumed
)
OUTPUT_SLACK_us = 3.0  # rounding of a stop pulse on its way to an output and back; assumed


def standstill_rpm(rig: Rig) -> float:
    """Return the speed below which a rotor of this rig counts as standing: rpm."""
    sensor = rig.sensors.get("rpm")
    flicker_rpm = FLICKER_SDS * sensor.noise + sensor.quantum if sensor else 0.0
    return max(SAFE_TIP_SPEED_m_s / rig.propulsion.radius_m * 30.0 / pi, flicker_rpm)


@dataclass(frozen=True, slots=True)
class Standstill:
    """Say what was seen of the rotors since zero was commanded.

    Attributes:
        seen: every rotor that was driven was seen to stand.
        unmeasured: rotors (from 1) that were driven and have no channel that could show it.
        only_unmeasured: nothing else is in doubt: every rotor with a channel was seen to stand.
        rpm: the fastest speed that does not stand; nan where none was read.
        text: all of it in a sentence; empty when no motor was driven.
    """

    seen: bool
    unmeasured: tuple[int, ...]
    only_unmeasured: bool
    rpm: float
    text: str


class StandstillMonitor:
    """Follow commands and readings and judge which rotors stand. Pure.

    Attributes:
        zero_s: when a motor was commanded to stop last, on the bench's clock.
    """

    def __init__(self, identity: DeviceInfo, rig: Rig, now_s: float) -> None:
        names = [channel.name for channel in identity.channels]
        n = rig.n_rotors
        self._limit_rpm = standstill_rpm(rig)
        self._propulsion = rig.propulsion
        stop_us = rig.propulsion.pwm_stop_us
        self._stop_us = stop_us if identity.pwm_stop_us is None else identity.pwm_stop_us
        self._speed = [_place(names, f"rpm{rotor}") for rotor in range(1, n + 1)]
        pulses = [_place(names, f"pwm{rotor}_us") for rotor in range(1, n + 1)]
        self._output = pulses if identity.outputs_measured else [None] * n
        self._pulse_places = pulses
        self._reported: list[int | None] = [None] * n
        if identity.has_loop:
            self.expect_loop()
        self._pulses_us: Array = np.full(n, stop_us)
        self._rows = [_RotorState(now_s) for _ in range(n)]
        self.zero_s = now_s

    def expect_loop(self) -> None:
        """Take the pulses that the bench reports for what its motors should do."""
        self._reported = self._pulse_places

    def commanded(self, pulses_us: Array, now_s: float) -> None:
        """Note what every motor is commanded (n_rotors,): us, before it is sent."""
        stop_us = self._propulsion.pwm_stop_us
        for rotor, before_us, pulse_us in zip(self._rows, self._pulses_us, pulses_us, strict=True):
            if pulse_us > stop_us:
                rotor.driven, rotor.zero_s = True, inf
            elif before_us > stop_us:
                rotor.stopped(now_s)
                self.zero_s = now_s
        self._pulses_us = np.array(pulses_us)

    def take(self, time_s: Array, values: Array) -> None:
        """Judge samples (m,), (m, c); nan where a channel had no new value."""
        if not len(time_s):
            return
        expected_rpm = rotor_speeds(self._propulsion, self._pulses_us)
        for index, rotor in enumerate(self._rows):
            if (speed := self._speed[index]) is not None:
                rpm = np.abs(values[:, speed])
                rotor.speed.take(time_s, rpm, rpm < self._limit_rpm, rotor.zero_s)
                expected = float(expected_rpm[index])
                if (place := self._reported[index]) is not None:
                    # A loop makes the pulses, so the lowest that it reports says what to expect.
                    lowest_us = np.nanmin(values[:, place], initial=inf)
                    expected = float(rotor_speeds(self._propulsion, np.array([lowest_us]))[0])
                rotor.compare(time_s, rpm, expected, self._limit_rpm)
            if (output := self._output[index]) is not None:
                shown = values[:, output]
                low = shown <= self._stop_us + OUTPUT_SLACK_us
                rotor.output.take(time_s, shown, low, rotor.zero_s)

    def state(self) -> Standstill:
        """Return what was seen so far."""
        turning: list[str] = []
        read_s = stood_s = self.zero_s  # the newest reading that turns, the first that stands
        silent, unmeasured, stand, fastest_rpm = [], [], [], nan
        for number, rotor in enumerate(self._rows, 1):
            speed, output = rotor.speed, rotor.output
            has_speed = self._speed[number - 1] is not None
            has_output = self._output[number - 1] is not None
            if speed.high:
                turning.append(f"rpm{number} {speed.last:.0f}")
                read_s = max(read_s, speed.last_s)
                fastest_rpm = max(speed.last, fastest_rpm if fastest_rpm == fastest_rpm else 0.0)
            elif output.high:
                turning.append(f"output of rotor {number} {output.last:.0f} us")
                read_s = max(read_s, output.last_s)
            elif not rotor.driven:
                continue
            elif (speed.low and rotor.answers) or output.low:
                stand.append(number)
                stood_s = max(stood_s, min(each.stood_s for each in (speed, output) if each.low))
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
            mute = [n for n in silent if self._rows[n - 1].answers]
            why = (
                "no reading came after zero was commanded"
                if mute
                else "the speed channel did not show the motor turning"
            )
            parts.append(f"{_rotors(silent)} not seen to stand: {why}; cut the power")
        if unmeasured:
            parts.append(
                f"{_rotors(unmeasured)} not seen to stand: this bench measures no speed there; "
                f"look before you go near"
            )
        if stand:
            after_s = stood_s - self.zero_s
            parts.append(f"{_rotors(stand)} seen to stand {after_s:.1f} s after zero was commanded")
        trouble = bool(turning or silent)
        return Standstill(
            seen=not trouble and not unmeasured,
            unmeasured=tuple(unmeasured),
            only_unmeasured=bool(unmeasured) and not trouble,
            rpm=fastest_rpm,
            text="; ".join(parts),
        )


class _Seen:
    """Hold whether one channel shows a standstill, newest reading first to count."""

    def __init__(self) -> None:
        self.last = nan
        self._low_s = nan
        self.last_s = nan
        self.stood_s = nan  # when readings had first stayed low for long enough

    def forget(self) -> None:
        self.last = self._low_s = self.last_s = self.stood_s = nan

    @property
    def low(self) -> bool:
        """Whether readings stayed low for long enough."""
        return self.last_s - self._low_s >= CONFIRMATION_TIME_S - 1e-9

    @property
    def high(self) -> bool:
        """Whether the newest reading is not low."""
        return self.last == self.last and self._low_s != self._low_s

    def take(self, time_s: Array, shown: Array, low: NDArray[np.bool_], since_s: float) -> None:
        fresh = np.flatnonzero(~np.isnan(shown) & (time_s > since_s))
        if not len(fresh):
            return
        highs = np.flatnonzero(~low[fresh])
        if len(highs):
            self._low_s = nan
            fresh_low = fresh[highs[-1] + 1 :]
        else:
            fresh_low = fresh
        if len(fresh_low) and self._low_s != self._low_s:
            self._low_s = float(time_s[fresh_low[0]])
        self.last, self.last_s = float(shown[fresh[-1]]), float(time_s[fresh[-1]])
        if len(highs):
            self.stood_s = nan
        if self.low and self.stood_s != self.stood_s:
            stood = time_s[fresh_low] - self._low_s >= CONFIRMATION_TIME_S - 1e-9
            self.stood_s = float(time_s[fresh_low[stood][0]])


class _RotorState:
    """Hold what is known of one rotor."""

    def __init__(self, now_s: float) -> None:
        self.driven = self.shown = False
        self.answers = True
        self.zero_s = now_s
        self.speed, self.output = _Seen(), _Seen()
        self._due_s = inf

    def stopped(self, now_s: float) -> None:
        """Count only readings from now on."""
        self.zero_s = now_s
        self.speed.forget()
        self.output.forget()

    def compare(self, time_s: Array, rpm: Array, expected_rpm: float, limit_rpm: float) -> None:
        """Note whether the speed channel shows a motor that is driven well above standstill."""
        high = bool((rpm >= limit_rpm).any())
        self.shown |= high
        self.answers |= high
        if self.zero_s < inf or not expected_rpm > 2.0 * limit_rpm:
            self._due_s = inf
            return
        self._due_s = min(self._due_s, float(time_s[0]))
        driven_s = time_s[-1] - self._due_s
        present = rpm[~np.isnan(rpm)]
        if len(present) and driven_s >= REPORT_TIMEOUT_S:
            self.answers = bool(present[-1] >= limit_rpm)
        elif driven_s > AVERAGING_TIME_S and not self.shown:
            self.answers = False


def unmeasured_rotors(identity: DeviceInfo, rig: Rig) -> str:
    """Return, for whoever arms it, which rotors of a bench cannot be seen to stand; "" for none."""
    names = {channel.name for channel in identity.channels}
    blind = [
        number
        for number in range(1, rig.n_rotors + 1)
        if f"rpm{number}" not in names
        and not (identity.outputs_measured and f"pwm{number}_us" in names)
    ]
    if not blind:
        return ""
    return (
        f"{_rotors(blind, 'will not be')} seen to stand: this bench measures no speed there; after "
        f"every stop, look before you go near"
    )


def _place(names: Sequence[str], name: str) -> int | None:
    return names.index(name) if name in names else None


def _rotors(numbers: Iterable[int], verb: str = "") -> str:
    listed = [str(number) for number in numbers]
    if len(listed) == 1:
        return f"rotor {listed[0]} {verb or 'was'}"
    return f"rotors {', '.join(listed[:-1])} and {listed[-1]} {verb or 'were'}"
