"""Bench check, and mapping of motors, outputs and ESCs to rotors."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import nan, pi
from typing import TYPE_CHECKING

import numpy as np

from benchtool.acquire.average import read_span
from benchtool.acquire.motors import STANDSTILL_RPM
from benchtool.bench.bench import Bench
from benchtool.bench.guard import GuardedBench
from benchtool.bench.mavlink.settings import MotorMap
from benchtool.core.channel import channel_family
from benchtool.core.errors import BenchError, InputError
from benchtool.core.rig import Rig

if TYPE_CHECKING:
    from benchtool.bench.mavlink.bench import MavlinkBench

ARMING_S = 2.0  # stop pulse that arms hobby ESCs: 1 to 2 s by their manuals
LOW_THROTTLE_SHARE = 0.15  # of the pulse range: above the start, 1/50 of full thrust; assumed

SPIN_S = 1.5
POLL_INTERVAL_S = 1.0

SPEED_BAND = (0.65, 1.5)  # measured over expected; a wrong pole count is a factor of 2; assumed

# Maximum measured over expected thrust, or its inverse, at the measured speed: static thrust
# coefficients differ by up to 1.5 (UIUC Propeller Database); wrong units exceed it. Assumed.
THRUST_FACTOR = 2.0

PULSE_TOLERANCE_US = 3.0  # rounding of pulses on their way to an output; assumed


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Result of one check, with a sentence that has the numbers."""

    name: str
    passed: bool
    text: str


def check_bench(bench: Bench, rig: Rig) -> Iterator[CheckResult]:
    """Yield the results of a bench check; motors are at zero between and after checks.

    Raises:
        BenchError: a rotor turns at zero throttle; nothing else is tried.
    """
    stop_us = np.full(rig.n_rotors, rig.propulsion.pwm_stop_us)
    names = [channel.name for channel in bench.identity.channels]
    bench.set_pwm(stop_us)
    at_rest = _means(bench, names, POLL_INTERVAL_S)
    turning = {
        name: value
        for name, value in at_rest.items()
        if channel_family(name) == "rpm" and not abs(value) < STANDSTILL_RPM
    }
    if turning:
        name, value = next(iter(turning.items()))
        reading = f"reads {value:.0f} rpm" if value == value else "has no value"
        raise BenchError(
            f"{name} {reading} at zero throttle, limit {STANDSTILL_RPM:g} rpm; stop that rotor or "
            f"repair its tachometer before arming"
        )
    without_speed = [rotor for rotor in range(rig.n_rotors) if f"rpm{rotor + 1}" not in names]
    yield CheckResult("standstill", True, _standstill_text(without_speed, rig.n_rotors))
    read_span(bench, ARMING_S)
    yield CheckResult("arming", True, f"stop pulse of {stop_us[0]:g} us held for {ARMING_S:g} s")
    low_us = low_throttle_us(rig)
    for rotor in range(rig.n_rotors):
        pulses = stop_us.copy()
        pulses[rotor] = low_us
        bench.set_pwm(pulses)
        read_span(bench, SPIN_S)
        means = _means(bench, names, POLL_INTERVAL_S)
        bench.set_pwm(stop_us)
        if rotor in without_speed and bench.identity.outputs_measured:
            yield _judge_output(rotor, low_us, means)
        else:
            yield from _judge_speed(rotor, low_us, means, rig)
        yield from _judge_thrust(rotor, low_us, means, at_rest, rig)
        read_span(bench, SPIN_S)
    bench.stop()


def _standstill_text(without_speed: list[int], n_rotors: int) -> str:
    if not without_speed:
        return "no rotor turns at zero throttle"
    listed = ", ".join(str(rotor + 1) for rotor in without_speed)
    prefix = ""
    if len(without_speed) < n_rotors:
        prefix = "no other rotor turns at zero throttle, but "
    return f"{prefix}no speed channel for rotors {listed}: check that they are still"


def _judge_output(rotor: int, low_us: float, means: dict[str, float]) -> CheckResult:
    """Check a rotor without speed channel by its output readback."""
    channel = f"pwm{rotor + 1}_us"
    others = [
        name
        for name, value in means.items()
        if name.startswith("pwm") and name != channel and abs(value - low_us) <= PULSE_TOLERANCE_US
    ]
    pulse_us = means.get(channel, nan)
    text = f"{channel} reads {pulse_us:.0f} us of {low_us:g} us; its speed is not measured"
    if others:
        text = f"{others[0]} also has the pulse of motor {rotor + 1}; check the output mapping"
    is_driven = abs(pulse_us - low_us) <= PULSE_TOLERANCE_US
    return CheckResult(f"rotor {rotor + 1} output", bool(is_driven and not others), text)


def _judge_speed(
    rotor: int, low_us: float, means: dict[str, float], rig: Rig
) -> Iterator[CheckResult]:
    channel = f"rpm{rotor + 1}"
    expected_rpm = _expected_rpm(low_us, rig)
    others = {
        name: value
        for name, value in means.items()
        if channel_family(name) == "rpm" and name != channel and abs(value) >= STANDSTILL_RPM
    }
    rpm = means.get(channel, nan)
    low, high = (factor * expected_rpm for factor in SPEED_BAND)
    yield CheckResult(
        f"rotor {rotor + 1} speed",
        bool(low <= rpm <= high),
        f"{channel} reads {rpm:.0f} at {low_us:g} us, expected {low:.0f} to {high:.0f}",
    )
    if others:
        name, value = next(iter(others.items()))
        text = f"{name} reads {value:.0f} while only motor {rotor + 1} is commanded; swap channels"
    else:
        text = f"only {channel} responds to pwm{rotor + 1}_us"
    yield CheckResult(f"rotor {rotor + 1} channel", not others and rpm >= STANDSTILL_RPM, text)


def _judge_thrust(
    rotor: int, low_us: float, means: dict[str, float], at_rest: dict[str, float], rig: Rig
) -> Iterator[CheckResult]:
    if "thrust_N" not in at_rest:
        return  # a pitch bench has no load cell
    thrust_N = means.get("thrust_N", nan) - at_rest["thrust_N"]
    rpm = means.get(f"rpm{rotor + 1}", nan)
    nominal_rpm = _expected_rpm(low_us, rig)
    if not SPEED_BAND[0] <= rpm / nominal_rpm <= SPEED_BAND[1]:
        rpm = nominal_rpm  # a wrong speed has been reported already
    expected_N = rig.propulsion.thrust_coefficient_N_s2 * (rpm * pi / 30.0) ** 2
    ratio = thrust_N / expected_N
    text = f"thrust rose by {thrust_N:+.3f} N, expected {expected_N:+.3f} N at {rpm:.0f} rpm"
    passed = bool(1.0 / THRUST_FACTOR <= ratio <= THRUST_FACTOR)
    if not passed:
        remedy = (
            "the motor turns the wrong way, the propeller is upside down, or the load cell's sign "
            "is reversed"
            if ratio < 0.0
            else "check the propeller, calibrate the load cell (benchtool calibrate), and check "
            "radius_m and thrust_coefficient_N_s2 of the rig"
        )
        text += f": {ratio:.2g} times, allowed 1/{THRUST_FACTOR:g} to {THRUST_FACTOR:g}; {remedy}"
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


TURN_S = 1.2  # duration of a motor test: rotors have started, below the dead channel timeout
PAUSE_S = 1.0  # between motors, until the last is at rest and only one ESC reports a speed

STEP_S = 0.05


def detect_motor_map(
    bench: Bench, rig: Rig, ask_rotor: Callable[[int], int], report: Callable[[str], None]
) -> MotorMap:
    """Turn each motor alone at low throttle and detect its output and ESC.

    Args:
        ask_rotor: returns the rotor (from 0) that a motor (from 1) turned; called at standstill,
            once per rotor.

    Raises:
        InputError: a bench without output readback.
        BenchError: not exactly one output responds to a motor.
    """
    from benchtool.bench.mavlink.bench import MavlinkBench

    device = bench.bench if isinstance(bench, GuardedBench) else bench
    if not isinstance(device, MavlinkBench):
        raise InputError("only a flight controller has motors to map; name a mavlink: address")
    low_us = low_throttle_us(rig)
    stop_us = np.full(rig.n_rotors, rig.propulsion.pwm_stop_us)
    motors, outputs, escs = ([0] * rig.n_rotors for _ in range(3))
    for motor in range(1, rig.n_rotors + 1):
        pulses_us = stop_us.copy()
        pulses_us[motor - 1] = low_us
        bench.set_pwm(pulses_us)
        read_span(bench, TURN_S, STEP_S)
        output, esc = _find_output(device, motor, low_us), _find_esc(device)
        bench.set_pwm(stop_us)
        read_span(bench, PAUSE_S, STEP_S)
        rotor = ask_rotor(motor)
        name = f"rotor {rotor + 1} ({rig.rotors[rotor].name})"
        esc_text = f"ESC {esc} reports its speed" if esc else "no ESC reports its speed"
        report(f"motor {motor} drives output {output}, {name}; " + esc_text)
        motors[rotor], outputs[rotor], escs[rotor] = motor, output, esc
    bench.stop()
    return MotorMap(
        rig=rig.name,
        autopilot=bench.identity.facts["autopilot"],
        motors=tuple(motors),
        outputs=tuple(outputs),
        escs=tuple(escs),
    )


def _find_output(device: MavlinkBench, motor: int, low_us: float) -> int:
    # Driven outputs have the low pulse, idle ones the stop pulse, servos any pulse.
    driven = [output for output, us in enumerate(device.outputs_us(), 1) if abs(us - low_us) <= 3.0]
    if len(driven) != 1:
        listed = ", ".join(map(str, driven)) or "none"
        raise BenchError(
            f"motor {motor} was commanded to {low_us:g} us; outputs with this pulse width: "
            f"{listed}; expected: exactly one; check the autopilot's output functions"
        )
    return driven[0]


def _find_esc(device: MavlinkBench) -> int:
    """Return the number of the only ESC with a speed; 0 for none or several."""
    turning = [esc for esc, rpm in device.speeds_rpm().items() if rpm > 0.0]
    return turning[0] if len(turning) == 1 else 0
