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

from benchtool.core.units import Array
from benchtool.export.vehicle import ExportedNumber, Vehicle

DEFAULT_IDLE_SHARE = 0.1  # idle throttle: 1 % of full thrust for a square law; assumed
MAX_THRUST_LINEAR = 150  # of Betaflight, in percent
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


def idle_pulse(vehicle: Vehicle) -> ExportedNumber:
    """Return the pulse at `DEFAULT_IDLE_SHARE` of the throttle."""
    start_us = vehicle.rig.propulsion.pwm_start_us
    pulse_us = start_us + DEFAULT_IDLE_SHARE * (vehicle.full[0].value - start_us)
    share = 100.0 * float(vehicle.thrust_N(np.array(DEFAULT_IDLE_SHARE))) / vehicle.thrust_max.value
    return ExportedNumber(
        pulse_us, "us", f"idle, {share:.2g} % of full thrust; assumed, rotors must turn"
    )


def ardupilot(vehicle: Vehicle) -> dict[str, object]:
    """Return the values of a parameter file of ArduCopter."""
    expo = expo_over_idle(vehicle, -1.0, ARDUPILOT)
    if expo.value > MAX_USUAL_EXPO:
        expo = replace(expo, why=f"{CAUTION}; {expo.why}")
    return {"expo": expo, "idle": idle_pulse(vehicle)}


def px4(vehicle: Vehicle) -> dict[str, object]:
    """Return the values of a parameter file of PX4."""
    return {"expo": expo_over_idle(vehicle, 0.0, PX4), "idle": idle_pulse(vehicle)}


def betaflight(vehicle: Vehicle) -> dict[str, object]:
    """Return the values of lines for Betaflight's command line."""
    settings = np.arange(MAX_THRUST_LINEAR + 1, dtype=float) / 100.0
    linear, linear_gain = most_linear(vehicle, betaflight_throttle, settings)
    cubic, cubic_gain = most_linear(vehicle, cubic_throttle, settings)
    return {
        "idle": idle_pulse(vehicle),
        "linear": linear,
        "linear_gain": linear_gain,
        "cubic": cubic,
        "cubic_gain": cubic_gain,
    }
