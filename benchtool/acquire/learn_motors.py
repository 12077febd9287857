"""Learn which motor, output and ESC belongs to each rotor: one motor after another, slowly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np

from benchtool.acquire.average import read_span
from benchtool.acquire.bench_check import low_throttle_us
from benchtool.bench.bench import Bench
from benchtool.bench.guard import GuardedBench
from benchtool.bench.mavlink.settings import MotorMap
from benchtool.core.errors import BenchError, InputError
from benchtool.core.rig import Rig

SPIN_S = 1.2
"""A motor turns so long: rotors have started, and a dead speed channel has not ended it yet."""

REST_S = 1.0
"""Between two motors: the one before must stand, so that only one ESC reports a speed."""

STEP_S = 0.05


@runtime_checkable
class Mapped(Protocol):
    """Be a bench that reports what every output shows and every ESC reads."""

    def outputs_us(self) -> tuple[int, ...]:
        """Return the pulse of every output, 0 where there is none."""
        ...

    def speeds_rpm(self) -> dict[int, float]:
        """Return the speed that each ESC last reported, by its place from 1."""
        ...


def learn_motors(
    bench: Bench,
    rig: Rig,
    rotor_of: Callable[[int], int],
    report: Callable[[str], None],
) -> MotorMap:
    """Turn each motor alone at low throttle and note its output and its ESC.

    Args:
        bench: open, within its limits, opened without a map.
        rig: what stands on it.
        rotor_of: gives the rotor (from 0) that a motor test (from 1) has turned; called when
            the motor stands again, each rotor once.
        report: called with a sentence about each rotor.

    Raises:
        InputError: a bench that has no outputs to look at.
        BenchError: several outputs or none follow a motor.
    """
    device = bench.bench if isinstance(bench, GuardedBench) else bench
    if not isinstance(device, Mapped):
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
        read_span(bench, SPIN_S, STEP_S)
        output, esc = _driven(device, motor, low_us), _turning(device)
        bench.set_pwm(stop_us)
        read_span(bench, REST_S, STEP_S)
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


def _driven(device: Mapped, motor: int, low_us: float) -> int:
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


def _turning(device: Mapped) -> int:
    """Return the place of the one ESC that reports a speed, 0 where none or several do."""
    turning = [place for place, rpm in device.speeds_rpm().items() if rpm > 0.0]
    return turning[0] if len(turning) == 1 else 0


def _with(places: tuple[int, ...], rotor: int, place: int) -> tuple[int, ...]:
    return (*places[:rotor], place, *places[rotor + 1 :])
