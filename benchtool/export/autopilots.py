"""Parameter files of ArduPilot, PX4 and Betaflight.

Each maps a demand d, 0 at the idle pulse and 1 at the maximum pulse, to a throttle. ArduPilot
(MOT_THST_EXPO) and PX4 (THR_MDL_FAC) command the v of d = (1 - e) v + e v^2. Betaflight
(thrust_linear, t in percent over 100) commands d (1 + t (1 - d) (1 + t (1 - 2 d))) since 2026.6,
and d (1 + t (1 - d)^2) in 4.3 to 2025.12. The parameter minimises the variation of the gain dT/dd,
the criterion of ArduPilot's ThrustExpo tool.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchtool.core.array_type import Array
from benchtool.export.vehicle import ExportedNumber, Vehicle

DEFAULT_IDLE_SHARE = 0.1  # idle throttle: 1 % of full thrust for a square law; assumed
MAX_THRUST_LINEAR = 150  # of Betaflight, in percent
PX4_FLOAT, PX4_INT32 = 9, 6  # MAV_PARAM_TYPE of a parameter file's last column
DEMANDS = np.linspace(0.0, 1.0, 1001)  # step of ArduPilot's ThrustExpo tool
EXPO_STEP = 0.005  # of the same tool
MAX_USUAL_EXPO = 0.75  # maximum in ArduPilot's page "Setting the Aircraft Up for Tuning"

ARDUPILOT = (
    "linearised as AP_Motors_Thrust_Linearization.cpp of ArduPilot 04dc0b71 does, by the criterion "
    "of WebTools/ThrustExpo 18e89bc0"
)
CAUTION = (
    f"CAUTION: above {MAX_USUAL_EXPO}, ArduPilot's value for propellers of 20 inches and larger; "
    "check that mid throttle is linear, rather than a perfect fit at the ends"
)
PX4 = "linearised as mixer_module/functions/FunctionMotors.hpp of PX4 15c4f088 does"


def expo_throttle(expo: float, demand: Array) -> Array:
    """Return the throttle command of ArduPilot and PX4, 0 (idle) to 1 (full)."""
    if expo == 0.0:
        return demand
    root = np.sqrt((1.0 - expo) ** 2 + 4.0 * expo * demand)
    return np.asarray((root + expo - 1.0) / (2.0 * expo), float)


def betaflight_throttle(share: float, demand: Array) -> Array:
    """Return the throttle command of Betaflight 2026.6."""
    margin = 1.0 - demand
    return np.asarray(demand * (1.0 + share * margin * (1.0 + share * (margin - demand))), float)


def cubic_throttle(share: float, demand: Array) -> Array:
    """Return the throttle command of Betaflight 4.3 to 2025.12."""
    return np.asarray(demand * (1.0 + share * (1.0 - demand) ** 2), float)


def most_linear(
    vehicle: Vehicle, throttle: Callable[[float, Array], Array], settings: Array
) -> tuple[float, str]:
    """Return the setting with the smallest variation of the gain, and a description of it."""
    scores = []
    for setting in settings.tolist():
        command = DEFAULT_IDLE_SHARE + (1.0 - DEFAULT_IDLE_SHARE) * np.clip(
            throttle(setting, DEMANDS), 0.0, 1.0
        )
        gain = np.diff(vehicle.thrust_N(command))
        scores.append((float(gain.std() / gain.mean()), setting, float(gain.max() / gain.min())))
    relative_sd, best, ratio = min(scores)
    text = f"sd {100.0 * relative_sd:.2g} %, largest over smallest {ratio:.3g}"
    return best, f"gain dT/d(demand) from idle to full: {text}"


def expo_over_idle(vehicle: Vehicle, low: float, source: str) -> ExportedNumber:
    """Return the expo from `low` to 1 at which thrust is most linear in demand above idle."""
    settings = np.round(np.arange(low, 1.0 + 0.5 * EXPO_STEP, EXPO_STEP), 3)
    value, text = most_linear(vehicle, expo_throttle, settings)
    limit = "limit of the target; " if value in (low, 1.0) else ""
    why = f"{limit}{source}; {text}; thrust over throttle: {vehicle.expo.why}"
    return ExportedNumber(value, "1", why, vehicle.expo.stated)


def _pulse(vehicle: Vehicle, key: str) -> ExportedNumber:
    return vehicle.of_rig(f"propulsion.{key}", "us")


def _idle(vehicle: Vehicle) -> ExportedNumber:
    start_us = vehicle.rig.propulsion.pwm_start_us
    pulse_us = start_us + DEFAULT_IDLE_SHARE * (vehicle.full[0].value - start_us)
    share = 100.0 * float(vehicle.thrust_N(np.array(DEFAULT_IDLE_SHARE))) / vehicle.thrust_max.value
    return ExportedNumber(
        pulse_us, "us", f"idle, {share:.2g} % of full thrust; assumed, rotors must turn"
    )


def _omitted(name: str, number: ExportedNumber) -> str:
    """Return the comment that replaces a value based on a typical number."""
    return f"# {name} omitted, measure it (motor test, --motor) or state it: {number.why}"


def ardupilot(vehicle: Vehicle) -> str:
    """Return a parameter file of ArduCopter: NAME,VALUE lines as in Mission Planner.

    Throttle 0 to 1 covers MOT_SPIN_MIN to MOT_SPIN_MAX of the ESC's range, and thrust is scaled
    with voltage below MOT_BAT_VOLT_MAX, which is therefore the voltage of the thrust curve.
    """
    idle, stop, maximum = (
        _idle(vehicle),
        _pulse(vehicle, "pwm_stop_us"),
        _pulse(vehicle, "pwm_max_us"),
    )
    full, span_us = vehicle.full[0], maximum.value - stop.value
    expo = expo_over_idle(vehicle, -1.0, ARDUPILOT)
    if expo.value > MAX_USUAL_EXPO:
        expo = replace(expo, why=f"{CAUTION}; {expo.why}")
    numbers = {
        "MOT_PWM_MIN": stop,
        "MOT_PWM_MAX": maximum,
        "MOT_SPIN_MIN": ExportedNumber((idle.value - stop.value) / span_us, "1", idle.why),
        "MOT_SPIN_MAX": ExportedNumber(
            (full.value - stop.value) / span_us, "1", f"end of the curve; {full.why}"
        ),
        "MOT_THST_EXPO": expo,
        "MOT_THST_HOVER": vehicle.hover_share.within(0.125, 0.6875),
        "MOT_BAT_VOLT_MAX": vehicle.full[1],
        "MOT_BAT_VOLT_MIN": vehicle.of_rig("limits.voltage_min_V", "V"),
    }
    return "\n".join(
        line
        for name, number in numbers.items()
        for line in (
            (f"# {number.note}", f"{name},{number.value:.6g}")
            if number.stated
            else (_omitted(name, number),)
        )
    )


def px4(vehicle: Vehicle) -> str:
    """Return a parameter file of PX4, tab separated as in QGroundControl.

    Axes are forward, right, down; a positive KM is a counter-clockwise rotor.
    """
    rig = vehicle.rig
    ratio = vehicle.torque_per_thrust
    numbers: list[tuple[str, ExportedNumber, int]] = []
    # One rotor is a test stand, whose geometry must not replace that of a vehicle.
    if rig.n_rotors > 1:
        numbers += [
            ("CA_AIRFRAME", ExportedNumber(0, "1", "multirotor"), PX4_INT32),
            ("CA_ROTOR_COUNT", ExportedNumber(rig.n_rotors, "1", f"rig {rig.name}"), PX4_INT32),
        ]
    for i, rotor in enumerate(rig.rotors if rig.n_rotors > 1 else ()):
        label = f"rotor {rotor.name}"
        numbers += [
            (f"CA_ROTOR{i}_PX", ExportedNumber(rotor.x_m, "m", f"{label}, forward"), PX4_FLOAT),
            (f"CA_ROTOR{i}_PY", ExportedNumber(0.0 - rotor.y_m, "m", f"{label}, right"), PX4_FLOAT),
            (f"CA_ROTOR{i}_CT", vehicle.thrust_max.within(0.0, 100.0), PX4_FLOAT),
            (
                f"CA_ROTOR{i}_KM",
                ExportedNumber(rotor.spin * ratio.value, "m", ratio.why, ratio.stated),
                PX4_FLOAT,
            ),
        ]
    numbers += [
        ("THR_MDL_FAC", expo_over_idle(vehicle, 0.0, PX4), PX4_FLOAT),
        ("MPC_THR_HOVER", vehicle.hover_share.within(0.1, 0.8), PX4_FLOAT),
    ]
    pulses = {"DIS": _pulse(vehicle, "pwm_stop_us"), "MIN": _idle(vehicle), "MAX": vehicle.full[0]}
    for i in range(1, rig.n_rotors + 1):
        numbers += [(f"PWM_MAIN_{name}{i}", pulse, PX4_INT32) for name, pulse in pulses.items()]
    lines = ["# Vehicle-Id Component-Id Name Value Type"]
    for name, number, kind in numbers:
        if not number.stated:
            lines.append(_omitted(name, number))
            continue
        value = f"{number.value:.0f}" if kind == PX4_INT32 else f"{number.value:.9g}"
        lines += [f"# {number.note}", f"1\t1\t{name}\t{value}\t{kind}"]
    return "\n".join(lines)


def betaflight(vehicle: Vehicle) -> str:
    """Return lines for Betaflight's command line; other settings depend on its version."""
    if not vehicle.expo.stated:
        return _omitted("thrust_linear", vehicle.expo)
    settings = np.arange(MAX_THRUST_LINEAR + 1, dtype=float) / 100.0
    value, text = most_linear(vehicle, betaflight_throttle, settings)
    cubic_value, cubic_text = most_linear(vehicle, cubic_throttle, settings)
    idle, maximum = _idle(vehicle), vehicle.full[0]
    return "\n".join([
        f"# %; thrust over throttle: expo {vehicle.expo.value:.4g}, {vehicle.expo.why}",
        f"# valid for motors from {idle.value:.0f} us ({idle.why}) to {maximum.value:.0f} us",
        f"# Betaflight 4.3 to 2025.12, instead of the next line; {cubic_text}:",
        f"# set thrust_linear = {100.0 * cubic_value:.0f}",
        f"# Betaflight 2026.6 and later (pull request 15226); {text}:",
        f"set thrust_linear = {100.0 * value:.0f}",
        "save",
    ])  # fmt: skip
