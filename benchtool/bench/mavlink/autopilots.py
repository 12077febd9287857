"""Motor commands, pulse ranges and device information of each kind of autopilot.

The kind is chosen by the heartbeat. Every motor command expires after `TIMEOUT_S`, so that motors
stop soon after the host has stopped sending; it is repeated every `RESEND_INTERVAL_S`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from typing import Any

from benchtool.bench.bench import DeviceInfo
from benchtool.bench.mavlink import frames as mav
from benchtool.bench.mavlink.link import MavlinkLink
from benchtool.bench.mavlink.settings import MavlinkSettings, MotorMap
from benchtool.core.errors import InputError, ProtocolError

RESEND_INTERVAL_S = 0.05  # of a repeated command: four in a row may be lost without a gap
DETECTION_TIMEOUT_S = 0.3  # from acknowledgement to outputs; ArduPilot takes 0.02 to 0.07 s

# Bit of the heartbeat's base_mode (MAV_MODE_FLAG): hardware in the loop, where "all motors /
# actuators are blocked"; set by the virtual autopilot.
HIL_FLAG = 32

VERSION_TIMEOUT_S = 0.5

MIN_PULSE_US, MAX_PULSE_US = 800.0, 2200.0  # RC_MIN_LIMIT_PWM and RC_MAX_LIMIT_PWM of ArduCopter
UNMAPPED_WARNING = (  # of a pitch bench, whose loop turns all rotors at once
    "the address has no map=, so output 1 is assumed to drive rotor 1 and so on; otherwise pulse "
    "widths and speeds are recorded under the wrong rotors; make a map with benchtool bench map "
    "and add map=FILE"
)

# ArduCopter's FRAME_CLASS: quad, hexa, octa, octaquad, Y6, tri, dodecahexa, deca.
MOTORS_OF_FRAME = {1: 4, 2: 6, 3: 8, 4: 8, 5: 6, 7: 3, 12: 12, 14: 10}


@dataclass(frozen=True, slots=True)
class PulseRange:
    """Pulse widths of an autopilot's outputs: stopped, slowest, longest, idle."""

    stop_us: float
    low_us: float
    high_us: float
    idle_us: float


class Autopilot(ABC):
    """One kind of autopilot."""

    name: str
    parameters: tuple[str, ...]  # parameters that are read when the link opens
    # Parameters needed to limit pulse widths to the autopilot's range
    required: tuple[str, ...] = ()
    can_run_together: bool  # several motors can be tested at the same time
    arms: bool  # its heartbeat shows armed while a motor test runs

    @abstractmethod
    def n_motors(self, values: Mapping[str, float]) -> int | None:
        """Return the number of motors from its parameters, or None if unknown."""

    @abstractmethod
    def pulses(self, values: Mapping[str, float]) -> PulseRange:
        """Return the pulse widths from its parameters; raise for an invalid range."""

    @abstractmethod
    def turn(
        self, pulses_us: Mapping[int, float], pulses: PulseRange
    ) -> tuple[mav.MavCommand, ...]:
        """Return the commands that turn motors (by test number) at pulse widths, or raise."""

    @abstractmethod
    def stop(self, motors: tuple[int, ...]) -> tuple[mav.MavCommand, ...]:
        """Return the commands that stop motors immediately."""


class ArduPilot(Autopilot):
    """ArduPilot: DO_MOTOR_TEST, one motor at a time."""

    name = "ArduPilot"
    required = ("MOT_PWM_MIN", "MOT_PWM_MAX")
    parameters = ("FRAME_CLASS", *required, "MOT_SPIN_ARM")
    arms = True
    can_run_together = False

    def n_motors(self, values: Mapping[str, float]) -> int | None:
        return MOTORS_OF_FRAME.get(round(values.get("FRAME_CLASS", 0.0)))

    def pulses(self, values: Mapping[str, float]) -> PulseRange:
        low_us, high_us = values["MOT_PWM_MIN"], values["MOT_PWM_MAX"]
        if not MIN_PULSE_US <= low_us < high_us <= MAX_PULSE_US:
            raise ProtocolError(
                f"MOT_PWM_MIN is {low_us:g} us and MOT_PWM_MAX {high_us:g} us; allowed: "
                f"{MIN_PULSE_US:g} to {MAX_PULSE_US:g} us, in this order; set them on the autopilot"
            )
        idle_us = low_us + values.get("MOT_SPIN_ARM", 0.1) * (high_us - low_us)
        return PulseRange(low_us, low_us, high_us, idle_us)

    def turn(
        self, pulses_us: Mapping[int, float], pulses: PulseRange
    ) -> tuple[mav.MavCommand, ...]:
        if len(pulses_us) > 1:
            motors = ", ".join(map(str, sorted(pulses_us)))
            raise InputError(
                f"motors {motors} cannot turn together: ArduPilot's motor test turns one motor at "
                f"a time; name one with --rotors, or use an autopilot whose actuator test allows "
                f"several (PX4)"
            )
        # ArduPilot does not limit the pulse widths of a motor test to its range.
        for motor, pulse_us in pulses_us.items():
            if not pulses.low_us <= pulse_us <= pulses.high_us:
                raise InputError(
                    f"pulse width {pulse_us:g} us of motor {motor} is out of range, command not "
                    f"sent; allowed: {pulses.low_us:g} to {pulses.high_us:g} us (MOT_PWM_MIN to "
                    f"MOT_PWM_MAX)"
                )
        # Type 1 is a pulse width in us; one motor, in the board's default order.
        return tuple(
            mav.MavCommand(mav.MOTOR_TEST, (motor, 1.0, pulse_us, mav.TIMEOUT_S, 1.0, 0.0, 0.0))
            for motor, pulse_us in pulses_us.items()
        )

    def stop(self, motors: tuple[int, ...]) -> tuple[mav.MavCommand, ...]:
        # A timeout of 0 ends the test of every motor.
        return (mav.MavCommand(mav.MOTOR_TEST, (motors[0], 1.0, 0.0, 0.0, 1.0, 0.0, 0.0)),)


class Px4(Autopilot):
    """PX4: ACTUATOR_TEST, any number of motors together."""

    name = "PX4"
    parameters = ("CA_ROTOR_COUNT", "PWM_MAIN_MIN1", "PWM_MAIN_MAX1", "PWM_MAIN_DIS1")
    arms = False
    can_run_together = True

    def n_motors(self, values: Mapping[str, float]) -> int | None:
        return round(values.get("CA_ROTOR_COUNT", 0.0)) or None

    def pulses(self, values: Mapping[str, float]) -> PulseRange:
        low_us = values.get("PWM_MAIN_MIN1", 1100.0)
        stop_us = values.get("PWM_MAIN_DIS1", 1000.0)
        return PulseRange(stop_us, low_us, values.get("PWM_MAIN_MAX1", 1900.0), low_us)

    def turn(
        self, pulses_us: Mapping[int, float], pulses: PulseRange
    ) -> tuple[mav.MavCommand, ...]:
        span_us = pulses.high_us - pulses.low_us
        orders = []
        for motor, pulse_us in pulses_us.items():
            # From 0 (slowest) to 1; below the slowest pulse a motor is stopped.
            value = (pulse_us - pulses.low_us) / span_us if pulse_us >= pulses.low_us else nan
            orders.append(self._test(motor, value, mav.TIMEOUT_S))
        return tuple(orders)

    def stop(self, motors: tuple[int, ...]) -> tuple[mav.MavCommand, ...]:
        return tuple(self._test(motor, nan, 0.0) for motor in motors)

    def _test(self, motor: int, value: float, timeout_s: float) -> mav.MavCommand:
        # The fifth parameter is the output function: 1 to 12 are motors.
        return mav.MavCommand(
            mav.ACTUATOR_TEST, (value, timeout_s, 0.0, 0.0, float(motor), 0.0, 0.0)
        )


AUTOPILOTS: dict[int, Autopilot] = {3: ArduPilot(), 12: Px4()}  # by the heartbeat's MAV_AUTOPILOT


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotInfo:
    """Information about an autopilot; `speed` is its seconds per wall second."""

    pilot: Autopilot
    pulses: PulseRange
    wiring: MotorMap
    device_id: str
    firmware: str
    simulated: bool
    speed: float

    def identity(
        self, settings: MavlinkSettings, facts: Mapping[str, str], **link: Any
    ) -> DeviceInfo:
        """Return the device information, with the fields of the link and its streams."""
        wiring, pulses, pilot = self.wiring, self.pulses, self.pilot
        is_pitch = settings.mode == "pitch"
        facts_ = {
            "autopilot": pilot.name,
            "pwm_stop_us": f"{pulses.stop_us:g}",
            "pwm_idle_us": f"{pulses.idle_us:g}",
            "motors": " ".join(map(str, wiring.motors)),
            "outputs": " ".join(str(output or "?") for output in wiring.outputs),
            **facts,
        }
        if self.speed != 1.0:
            facts_["speed"] = f"{self.speed:g}"
        if is_pitch:
            facts_ |= {"mode": "pitch", "armed_by": settings.arm}
        is_unmapped = is_pitch and len(wiring.outputs) > 1 and 0 in wiring.outputs
        if warnings := [*filter(None, (settings.warning, UNMAPPED_WARNING if is_unmapped else ""))]:
            facts_["warning"] = "; ".join(warnings)
        return DeviceInfo(
            device_id=self.device_id,
            firmware=self.firmware,
            protocol="MAVLink 2",
            n_rotors=wiring.n_rotors,
            simulated=self.simulated,
            moves_plate=self.simulated,
            limits={"pwm_us": pulses.high_us}
            | ({} if pilot.can_run_together else {"rotors_together": 1}),
            watchdog_s=mav.TIMEOUT_S,
            has_loop=is_pitch,
            armed_by_operator=is_pitch and settings.arm == "operator",
            pwm_stop_us=pulses.stop_us,
            pwm_idle_us=pulses.idle_us,
            outputs_measured=True,
            speed=self.speed,
            facts=facts_,
            **link,
        )


def read_autopilot(
    link: MavlinkLink, heartbeat: mav.Message, settings: MavlinkSettings
) -> AutopilotInfo:
    """Read the information of an autopilot."""
    pilot = AUTOPILOTS.get(heartbeat.autopilot)
    if pilot is None:
        names = " and ".join(pilot.name for pilot in AUTOPILOTS.values())
        raise ProtocolError(
            f"system {link.system} is an autopilot of kind {heartbeat.autopilot} (MAV_AUTOPILOT), "
            f"but benchtool can turn motors of {names} only; use one of these"
        )
    simulated = bool(heartbeat.base_mode & HIL_FLAG)
    speedup = ("SIM_SPEEDUP",) if simulated else ()
    parameters = link.read_parameters((*pilot.parameters, *speedup), pilot.required)
    device_id, version = _read_version(link)
    return AutopilotInfo(
        pilot=pilot,
        pulses=pilot.pulses(parameters),
        wiring=_find_wiring(pilot.n_motors(parameters), settings, link.system),
        device_id=device_id,
        firmware=f"{pilot.name} {version}".strip(),
        simulated=simulated,
        speed=parameters.get("SIM_SPEEDUP", 1.0) or 1.0,
    )


def _find_wiring(reported: int | None, settings: MavlinkSettings, system: int) -> MotorMap:
    """Return the map of the settings, or rotors in order with unknown outputs."""
    motor_map = settings.motor_map
    n = settings.rotors or (len(motor_map.motors) if motor_map else reported)
    if not n:
        raise InputError(
            f"system {system} does not report its number of motors; add rotors=N to the address"
        )
    if motor_map and len(motor_map.motors) != n:
        raise InputError(
            f"rotors={n}, but the map of rig {motor_map.rig!r} has {len(motor_map.motors)}; remove "
            f"rotors= or make the map again with benchtool bench map"
        )
    in_order = tuple(range(1, n + 1))
    return motor_map or MotorMap(
        rig="", autopilot="", motors=in_order, outputs=(0,) * n, escs=in_order
    )


def _read_version(link: MavlinkLink) -> tuple[str, str]:
    """Return the autopilot's identifier and version, as far as it reports them."""
    messages: list[mav.Message] = []
    previous_callback = link.on_message

    def listen(message: mav.Message, arrived_s: float) -> None:
        if message.msgname == "AUTOPILOT_VERSION":
            messages.append(message)
        previous_callback(message, arrived_s)

    link.on_message = listen
    try:
        number = float(mav.message_id("AUTOPILOT_VERSION"))
        request = mav.MavCommand(mav.REQUEST_MESSAGE, (number, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        if link.exchange(request) == mav.ACCEPTED:
            link.wait(VERSION_TIMEOUT_S, lambda: messages or None)
    finally:
        link.on_message = previous_callback
    if not messages:
        return f"mavlink-system-{link.system}", ""
    name = bytes(messages[0].uid2).rstrip(b"\0").hex() or f"{messages[0].uid:x}"
    number = messages[0].flight_sw_version
    return f"mavlink-{name}", f"{number >> 24}.{number >> 16 & 255}.{number >> 8 & 255}"
