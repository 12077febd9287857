"""Parameters of autopilots: ArduPilot, PX4 and Betaflight.

All three linearise thrust over throttle v, 0 at the idle pulse, at which rotors must turn, 1 at the
longest. ArduPilot (MOT_THST_EXPO) and PX4 (THR_MDL_FAC) invert T = T_max ((1 - e) v + e v^2);
Betaflight (thrust_linear) commands x (1 + t (1 - x)^2) for a wanted share x of full thrust.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchtool.core.array import Array
from benchtool.export.vehicle import Number, Vehicle

IDLE = 0.1
"""Throttle of the rig at which rotors idle: high enough to turn, 1 % of full thrust where thrust
goes with the square. A choice: try it, and raise it where a motor stutters."""

MAX_THRUST_LINEAR = 150
"""Largest thrust_linear that Betaflight takes, in percent."""

PX4_FLOAT, PX4_INT32 = 9, 6
"""MAV_PARAM_TYPE of a parameter file's last column."""

_GRID = np.linspace(0.0, 1.0, 201)


def share_over_idle(vehicle: Vehicle, v: Array) -> Array:
    """Return thrust over full thrust at throttles from idle (0) to full (1) (n,)."""
    return vehicle.thrust_N(IDLE + (1.0 - IDLE) * v) / vehicle.thrust_max.value


def expo_over_idle(vehicle: Vehicle, low: float) -> Number:
    """Return the e of least squared error of thrust over the range from idle, `low` to 1."""
    bend = _GRID * _GRID - _GRID
    share = share_over_idle(vehicle, _GRID)
    e = float(bend @ (share - _GRID) / (bend @ bend))
    found = Number(e, "1", f"over the range from idle; e from 0 is {vehicle.expo.value:.4g}, "
                   f"{vehicle.expo.why}", vehicle.expo.stated).within(low, 1.0)  # fmt: skip
    error = np.abs(_GRID + found.value * bend - share).max()
    return replace(found, why=f"thrust within {100.0 * error:.1f} % of full, {found.why}")


def _pulse(vehicle: Vehicle, key: str) -> Number:
    return vehicle.of_rig(f"propulsion.{key}", "us")


def _idle(vehicle: Vehicle) -> Number:
    p = vehicle.rig.propulsion
    pulse_us = p.pwm_start_us + IDLE * (p.pwm_max_us - p.pwm_start_us)
    share = 100.0 * float(share_over_idle(vehicle, np.zeros(1))[0])
    return Number(pulse_us, "us", f"idle, {share:.2g} % of full thrust, a choice: rotors must turn")


def _left_out(name: str, number: Number) -> str:
    """Return the comment in place of what rests on a typical number: it must not be flown."""
    return f"# {name} left out, measure it (a motor test, --motor) or state it: {number.why}"


def ardupilot(vehicle: Vehicle) -> str:
    """Return a parameter file of ArduCopter: NAME,VALUE lines as Mission Planner writes them.

    Throttle 0 to 1 covers MOT_SPIN_MIN to MOT_SPIN_MAX of the ESC's range, and thrust is scaled
    with voltage below MOT_BAT_VOLT_MAX, which is therefore the voltage of the thrust curve.
    """
    idle, stop, most = _idle(vehicle), _pulse(vehicle, "pwm_stop_us"), _pulse(vehicle, "pwm_max_us")
    span_us = most.value - stop.value
    numbers = {
        "MOT_PWM_MIN": stop,
        "MOT_PWM_MAX": most,
        "MOT_SPIN_MIN": Number((idle.value - stop.value) / span_us, "1", idle.why),
        "MOT_SPIN_MAX": Number(1.0, "1", "where the fitted curve ends"),
        "MOT_THST_EXPO": expo_over_idle(vehicle, -1.0),
        "MOT_THST_HOVER": vehicle.hover_share.within(0.125, 0.6875),
        "MOT_BAT_VOLT_MAX": vehicle.of_rig("propulsion.voltage_nominal_V", "V"),
        "MOT_BAT_VOLT_MIN": vehicle.of_rig("limits.voltage_min_V", "V"),
    }
    return "\n".join(
        line
        for name, number in numbers.items()
        for line in (
            (f"# {number.note}", f"{name},{number.value:.6g}")
            if number.stated
            else (_left_out(name, number),)
        )
    )


def px4(vehicle: Vehicle) -> str:
    """Return a parameter file of PX4, tab separated as QGroundControl writes it.

    Axes are forward, right, down; a positive KM is a rotor that turns counter-clockwise.
    """
    rig = vehicle.rig
    ratio = vehicle.torque_per_thrust
    numbers: list[tuple[str, Number, int]] = []
    # One rotor is a stand, whose geometry must not go over that of a vehicle.
    if rig.n_rotors > 1:
        numbers += [
            ("CA_AIRFRAME", Number(0, "1", "multirotor"), PX4_INT32),
            ("CA_ROTOR_COUNT", Number(rig.n_rotors, "1", f"rig {rig.name}"), PX4_INT32),
        ]
    for i, rotor in enumerate(rig.rotors if rig.n_rotors > 1 else ()):
        place = f"rotor {rotor.name}"
        numbers += [
            (f"CA_ROTOR{i}_PX", Number(rotor.x_m, "m", f"{place}, forward"), PX4_FLOAT),
            (f"CA_ROTOR{i}_PY", Number(0.0 - rotor.y_m, "m", f"{place}, right"), PX4_FLOAT),
            (f"CA_ROTOR{i}_CT", vehicle.thrust_max.within(0.0, 100.0), PX4_FLOAT),
            (
                f"CA_ROTOR{i}_KM",
                Number(rotor.spin * ratio.value, "m", ratio.why, ratio.stated),
                PX4_FLOAT,
            ),
        ]
    numbers += [
        ("THR_MDL_FAC", expo_over_idle(vehicle, 0.0), PX4_FLOAT),
        ("MPC_THR_HOVER", vehicle.hover_share.within(0.1, 0.8), PX4_FLOAT),
    ]
    pulses = {
        "DIS": _pulse(vehicle, "pwm_stop_us"),
        "MIN": _idle(vehicle),
        "MAX": _pulse(vehicle, "pwm_max_us"),
    }
    for i in range(1, rig.n_rotors + 1):
        numbers += [(f"PWM_MAIN_{name}{i}", each, PX4_INT32) for name, each in pulses.items()]
    lines = ["# Vehicle-Id Component-Id Name Value Type"]
    for name, number, kind in numbers:
        if not number.stated:
            lines.append(_left_out(name, number))
            continue
        value = f"{number.value:.0f}" if kind == PX4_INT32 else f"{number.value:.9g}"
        lines += [f"# {number.note}", f"1\t1\t{name}\t{value}\t{kind}"]
    return "\n".join(lines)


def thrust_linear(vehicle: Vehicle) -> tuple[int, float]:
    """Return Betaflight's thrust_linear in percent, and the largest error of thrust over T_max.

    The curve x (1 + t (1 - x)^2) has one number for every throttle; it is the t of the least
    squared error of thrust.
    """
    found = []
    for percent in range(MAX_THRUST_LINEAR + 1):
        throttle = _GRID * (1.0 + 0.01 * percent * (1.0 - _GRID) ** 2)
        error = share_over_idle(vehicle, throttle) - _GRID
        found.append((float(error @ error), percent, float(np.abs(error).max())))
    _, best, error_max = min(found)
    return best, error_max


def betaflight(vehicle: Vehicle) -> str:
    """Return lines for Betaflight's command line; names of its other settings change by version."""
    if not vehicle.expo.stated:
        return _left_out("thrust_linear", vehicle.expo)
    percent, error = thrust_linear(vehicle)
    idle, most = _idle(vehicle), _pulse(vehicle, "pwm_max_us")
    return "\n".join([
        f"# %; thrust within {100.0 * error:.1f} % of full; expo {vehicle.expo.value:.4g}, "
        f"{vehicle.expo.why}",
        f"# holds for motors from {idle.value:.0f} us ({idle.why}) to {most.value:.0f} us",
        f"set thrust_linear = {percent}",
        "save",
    ])  # fmt: skip
