"""Check a bench before it is trusted; learn which motor, output and ESC belongs to each rotor."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import nan, pi
from typing import Protocol, runtime_checkable

import numpy as np

from benchtool.acquire.average import read_span
from benchtool.acquire.motors import STANDSTILL_RPM
from benchtool.bench.bench import Bench
from benchtool.bench.guard import GuardedBench
from benchtool.bench.mavlink.settings import MotorMap
from benchtool.core.errors import BenchError, InputError
from benchtool.core.rig import Rig

ARMING_S = 2.0  # hold of the stop pulse that hobby ESCs take as arming: 1 to 2 s by their manuals
LOW_THROTTLE_SHARE = 0.15  # of the pulse range: above the start, a fiftieth of full thrust; assumed

SPIN_S = 1.5
POLL_INTERVAL_S = 1.0

SPEED_BAND = (0.65, 1.5)  # measured over expected; a wrong pole count is a factor of 2; assumed

THRUST_FACTOR = 2.0
"""Measured over expected thrust, or its inverse, that passes at the speed that was read: static
thrust coefficients lie within 1.5 of each other (UIUC Propeller Database), and a cell in grams for
newtons, or a rotor of another size, is beyond. A choice."""

PULSE_TOLERANCE_US = 3.0  # rounding of pulses on their way to an output; assumed


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Say what was checked, whether it passed, and the numbers in one sentence."""

    name: str
    passed: bool
    text: str


def check_bench(bench: Bench, rig: Rig) -> Iterator[CheckResult]:
    """Give the findings of a bench check as they are made; motors are at zero between and after.

    Raises:
        BenchError: a rotor turns at zero command: nothing else is tried.
    """
    stop_us = np.full(rig.n_rotors, rig.propulsion.pwm_stop_us)
    names = [channel.name for channel in bench.identity.channels]
    bench.set_pwm(stop_us)
    still = _means(bench, names, POLL_INTERVAL_S)
    turning = {
        name: value
        for name, value in still.items()
        if _is_rpm(name) and not abs(value) < STANDSTILL_RPM
    }
    if turning:
        name, value = next(iter(turning.items()))
        reading = f"reads {value:.0f} rpm" if value == value else "brings no value"
        raise BenchError(
            f"{name} {reading} at zero command, limit {STANDSTILL_RPM:g} rpm; stop that rotor or "
            f"mend its tachometer before anything is armed"
        )
    silent = [rotor for rotor in range(rig.n_rotors) if f"rpm{rotor + 1}" not in names]
    yield CheckResult("standstill", True, _standstill_text(silent, rig.n_rotors))
    read_span(bench, ARMING_S)
    yield CheckResult("arming", True, f"stop pulse of {stop_us[0]:g} us held for {ARMING_S:g} s")
    low_us = low_throttle_us(rig)
    for rotor in range(rig.n_rotors):
        pulses = stop_us.copy()
        pulses[rotor] = low_us
        bench.set_pwm(pulses)
        read_span(bench, SPIN_S)
        seen = _means(bench, names, POLL_INTERVAL_S)
        bench.set_pwm(stop_us)
        if rotor in silent and bench.identity.outputs_measured:
            yield _judge_output(rotor, low_us, seen)
        else:
            yield from _judge_speed(rotor, low_us, seen, rig)
        yield from _judge_thrust(rotor, low_us, seen, still, rig)
        read_span(bench, SPIN_S)
    bench.stop()


def _standstill_text(silent: list[int], n_rotors: int) -> str:
    if not silent:
        return "no rotor turns at zero command"
    listed = ", ".join(str(rotor + 1) for rotor in silent)
    rest = "" if len(silent) == n_rotors else "no other rotor turns at zero command, but "
    return f"{rest}no channel measures the speed of rotors {listed}: see that they stand"


def _judge_output(rotor: int, low_us: float, seen: dict[str, float]) -> CheckResult:
    """Judge a rotor without a speed by the outputs that were read back."""
    own = f"pwm{rotor + 1}_us"
    others = [
        name
        for name, value in seen.items()
        if name.startswith("pwm") and name != own and abs(value - low_us) <= PULSE_TOLERANCE_US
    ]
    text = f"{own} reads {seen.get(own, nan):.0f} us of {low_us:g} us; its speed is not measured"
    if others:
        text = (
            f"{others[0]} shows the pulse of motor {rotor + 1} as well; look at the map of outputs"
        )
    shown = abs(seen.get(own, nan) - low_us) <= PULSE_TOLERANCE_US
    return CheckResult(f"rotor {rotor + 1} output", bool(shown and not others), text)


def _judge_speed(
    rotor: int, low_us: float, seen: dict[str, float], rig: Rig
) -> Iterator[CheckResult]:
    own = f"rpm{rotor + 1}"
    expected_rpm = _expected_rpm(low_us, rig)
    others = {
        name: value
        for name, value in seen.items()
        if _is_rpm(name) and name != own and abs(value) >= STANDSTILL_RPM
    }
    rpm = seen.get(own, nan)
    low, high = (share * expected_rpm for share in SPEED_BAND)
    yield CheckResult(
        f"rotor {rotor + 1} speed",
        bool(low <= rpm <= high),
        f"{own} reads {rpm:.0f} at {low_us:g} us, expected {low:.0f} to {high:.0f}",
    )
    if others:
        name, value = next(iter(others.items()))
        text = f"{name} reads {value:.0f} while only motor {rotor + 1} is commanded; swap channels"
    else:
        text = f"only {own} answers to pwm{rotor + 1}_us"
    yield CheckResult(f"rotor {rotor + 1} channel", not others and rpm >= STANDSTILL_RPM, text)


def _judge_thrust(
    rotor: int, low_us: float, seen: dict[str, float], still: dict[str, float], rig: Rig
) -> Iterator[CheckResult]:
    if "thrust_N" not in still:
        # A pitch bench has no load cell.
        return
    thrust_N = seen.get("thrust_N", nan) - still["thrust_N"]
    rpm = seen.get(f"rpm{rotor + 1}", nan)
    nominal_rpm = _expected_rpm(low_us, rig)
    if not SPEED_BAND[0] <= rpm / nominal_rpm <= SPEED_BAND[1]:
        rpm = nominal_rpm  # a wrong speed has been reported by itself
    expected_N = rig.propulsion.thrust_coefficient_N_s2 * (rpm * pi / 30.0) ** 2
    ratio = thrust_N / expected_N
    text = f"thrust rose by {thrust_N:+.3f} N, expected {expected_N:+.3f} N at {rpm:.0f} rpm"
    passed = bool(1.0 / THRUST_FACTOR <= ratio <= THRUST_FACTOR)
    if not passed:
        mend = (
            "the motor turns the wrong way, the propeller is upside down, or the cell's sign is "
            "reversed"
            if ratio < 0.0
            else "look at the propeller, calibrate the load cell (benchtool calibrate), and see "
            "that radius_m and thrust_coefficient_N_s2 of the rig are its own"
        )
        text += f": {ratio:.2g} times, allowed 1/{THRUST_FACTOR:g} to {THRUST_FACTOR:g}; {mend}"
    yield CheckResult(f"rotor {rotor + 1} thrust", passed, text)


def _expected_rpm(low_us: float, rig: Rig) -> float:
    p = rig.propulsion
    return p.speed_per_us_rad_s * (low_us - p.pwm_start_us) * 30.0 / pi


def low_throttle_us(rig: Rig) -> float:
    """Return the pulse of the low-throttle test: us."""
    p = rig.propulsion
    return float(round(p.pwm_start_us + LOW_THROTTLE_SHARE * (p.pwm_max_us - p.pwm_start_us)))


def _means(bench: Bench, names: list[str], seconds: float) -> dict[str, float]:
    values = read_span(bench, seconds)
    counts = (~np.isnan(values)).sum(axis=0)
    sums = np.nansum(values, axis=0)
    return {name: float(sums[i] / counts[i]) if counts[i] else nan for i, name in enumerate(names)}


def _is_rpm(name: str) -> bool:
    return name.rstrip("0123456789") == "rpm"


TURN_S = 1.2  # time of a motor's turn: rotors have started, no dead speed channel ended it
PAUSE_S = 1.0  # between two motors: the one before must stand, so that only one ESC reports a speed

STEP_S = 0.05


@runtime_checkable
class ReportsOutputs(Protocol):
    """Be a bench that reports what every output shows and every ESC reads."""

    def outputs_us(self) -> tuple[float, ...]:
        """Return the pulse of every output, 0 where there is none."""
        ...

    def speeds_rpm(self) -> dict[int, float]:
        """Return the speed that each ESC last reported, by its place from 1."""
        ...


def detect_motor_map(
    bench: Bench, rig: Rig, rotor_of: Callable[[int], int], report: Callable[[str], None]
) -> MotorMap:
    """Turn each motor alone at low throttle and note its output and its ESC.

    Args:
        rotor_of: gives the rotor (from 0) that a motor test (from 1) has turned; called when
            the motor stands again, each rotor once.

    Raises:
        InputError: a bench that has no outputs to look at.
        BenchError: several outputs or none follow a motor.
    """
    device = bench.bench if isinstance(bench, GuardedBench) else bench
    if not isinstance(device, ReportsOutputs):
        raise InputError("only a flight controller has motors to map; name a mavlink: address")
    low_us = low_throttle_us(rig)
    stop_us = np.full(rig.n_rotors, rig.propulsion.pwm_stop_us)
    found = MotorMap(
        rig=rig.name,
        autopilot=bench.identity.facts["autopilot"],
        motors=tuple(range(1, rig.n_rotors + 1)),
        outputs=(0,) * rig.n_rotors,
        escs=(0,) * rig.n_rotors,
    )
    for motor in range(1, rig.n_rotors + 1):
        pulses_us = stop_us.copy()
        pulses_us[motor - 1] = low_us
        bench.set_pwm(pulses_us)
        read_span(bench, TURN_S, STEP_S)
        output, esc = _driven(device, motor, low_us), _turning(device)
        bench.set_pwm(stop_us)
        read_span(bench, PAUSE_S, STEP_S)
        rotor = rotor_of(motor)
        name = f"rotor {rotor + 1} ({rig.rotors[rotor].name})"
        esc_text = f"ESC {esc} reports its speed" if esc else "no ESC reports its speed"
        report(f"motor {motor} drives output {output}, {name}; " + esc_text)
        found = replace(
            found,
            motors=_with(found.motors, rotor, motor),
            outputs=_with(found.outputs, rotor, output),
            escs=_with(found.escs, rotor, esc),
        )
    bench.stop()
    return found


def _driven(device: ReportsOutputs, motor: int, low_us: float) -> int:
    shown = device.outputs_us()
    # What shows the low pulse is driven; idle outputs show the stop pulse, servos what they like.
    driven = [output for output, us in enumerate(shown, 1) if abs(us - low_us) <= 3.0]
    if len(driven) != 1:
        listed = ", ".join(map(str, driven)) or "none"
        raise BenchError(
            f"motor {motor} was turned at {low_us:g} us, and outputs that show it are: {listed}; "
            f"exactly one must; look at the autopilot's output functions"
        )
    return driven[0]


def _turning(device: ReportsOutputs) -> int:
    """Return the place of the one ESC that reports a speed, 0 where none or several do."""
    turning = [place for place, rpm in device.speeds_rpm().items() if rpm > 0.0]
    return turning[0] if len(turning) == 1 else 0


def _with(places: tuple[int, ...], rotor: int, place: int) -> tuple[int, ...]:
    return (*places[:rotor], place, *places[rotor + 1 :])
