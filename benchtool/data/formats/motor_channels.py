"""Which output channel drives which motor, as the autopilot's parameters say."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping

from benchtool.data.repairs.imported import Finding

# ArduPilot, SRV_Channel.h: 33..40 Motor1..8, 82..85 Motor9..12, 70 throttle, 73 and 74 left/right.
_ARDUPILOT: dict[int, int] = (
    {33 + i: 1 + i for i in range(8)} | {82 + i: 9 + i for i in range(4)} | {70: 1, 73: 1, 74: 2}
)
# PX4, output functions: 101..112 Motor1..12.
_PX4: dict[int, int] = {101 + i: 1 + i for i in range(12)}

_SERVO = re.compile(r"SERVO(\d+)_FUNCTION")
_MAIN = re.compile(r"(?:PWM_MAIN|HIL_ACT|PWM_AUX)_FUNC(\d+)")


def ardupilot_motors(parameters: Mapping[str, float]) -> dict[int, int]:
    """Return motor number by output channel (from 1)."""
    return _motors(parameters, _SERVO, _ARDUPILOT)


def px4_motors(parameters: Mapping[str, float]) -> dict[int, int]:
    """Return motor number by output channel (from 1), of the first outputs that have motors."""
    for prefix in ("PWM_MAIN", "PWM_AUX", "HIL_ACT"):
        own = {name: value for name, value in parameters.items() if name.startswith(prefix)}
        if found := _motors(own, _MAIN, _PX4):
            return found
    return {}


def _motors(
    parameters: Mapping[str, float], pattern: re.Pattern[str], functions: Mapping[int, int]
) -> dict[int, int]:
    found: dict[int, int] = {}
    for name, value in parameters.items():
        matched = pattern.fullmatch(name)
        if matched and value == value and abs(value) < 1e6 and int(value) in functions:
            motor = functions[int(value)]
            if motor not in found.values():
                found[int(matched[1])] = motor
    return dict(sorted(found.items(), key=lambda item: item[1]))


def logged_motors(
    motors: Mapping[int, int], logged: Collection[int], parameter: str, findings: list[Finding]
) -> dict[int, int]:
    """Return motor number by those channels whose pulses are logged, and tell how that was known.

    Args:
        motors: motor number by channel, as the parameters say; empty where none does.
        logged: channels with pulses; each is taken for the motor of its number without parameters.
        parameter: what would say it, for people.
        findings: added to.
    """
    if not motors:
        words = (
            f"no {parameter} says which channel drives which motor; pwm1 is channel 1, and a "
            f"channel may move a servo"
        )
        findings.append(Finding("doubt", "motor channels", words))
        return {channel: channel for channel in logged}
    pairs = ", ".join(f"motor {motor} on channel {channel}" for channel, motor in motors.items())
    words = f"{pairs}; rotors carry the autopilot's motor numbers, not a rig's"
    findings.append(Finding("read as", "motor channels", words))
    for channel, motor in motors.items():
        if channel not in logged:
            words = f"motor {motor} is on channel {channel}, of which no pulse stands in the log"
            findings.append(Finding("lacks", "outputs", words, f"pwm{motor}_us"))
    return {channel: motor for channel, motor in motors.items() if channel in logged}
