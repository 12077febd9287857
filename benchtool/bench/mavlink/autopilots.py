"""How each autopilot is commanded to turn motors, what it allows, and what it reports of itself.

A pilot is chosen by the heartbeat. Every command dies by itself after `TIMEOUT_S`, so that motors
stand still soon after the host has died; it is sent again every `RESEND_INTERVAL_S`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import nan

from benchtool.bench.bench import DeviceInfo
from benchtool.bench.mavlink import messages as mav
from benchtool.bench.mavlink.link import MavlinkLink
from benchtool.bench.mavlink.settings import NO_THRUST, ChannelWiring, MavlinkSettings
from benchtool.core.errors import InputError, ProtocolError

RESEND_INTERVAL_S = 0.05  # interval of a repeated order: four in a row may get lost without a gap
DETECTION_TIMEOUT_S = (
    0.3  # from an acknowledged pulse to the outputs; ArduPilot takes 0.02 to 0.07 s
)

HIL = 32
"""Bit of the heartbeat's base_mode (MAV_MODE_FLAG): hardware in the loop, where "all motors /
actuators are blocked", which is what the virtual autopilot shows."""

VERSION_TIMEOUT_S = 0.5

LEAST_US, LONGEST_US = 800.0, 2200.0  # RC_MIN_LIMIT_PWM and RC_MAX_LIMIT_PWM of ArduCopter
UNMAPPED = (  # warning of a pitch bench: its loop turns all rotors at once
    "the address has no map=, so rotor 1 is taken to hang on output 1 and so on; where it does "
    "not, pulses and speeds are recorded under other rotors than theirs; make a map with benchtool "
    "bench map and add map=FILE"
)

MOTORS_OF_FRAME = {1: 4, 2: 6, 3: 8, 4: 8, 5: 6, 7: 3, 12: 12, 14: 10}
"""ArduCopter's FRAME_CLASS: quad, hexa, octa, octaquad, Y6, tri, dodecahexa, deca."""


@dataclass(frozen=True, slots=True)
class PulseRange:
    """The pulses of an autopilot's outputs: stopped, slowest, longest, and what counts as idle."""

    stop_us: float
    low_us: float
    high_us: float
    idle_us: float


class Autopilot(ABC):
    """Be one kind of autopilot.

    Attributes:
        parameters: that are worth reading when the link opens.
        required: those without which pulses cannot be bounded to the autopilot's own range.
        together: whether several motors can turn in tests at the same time.
        arms: whether its heartbeat shows armed while a motor test runs.
    """

    name: str
    parameters: tuple[str, ...]
    required: tuple[str, ...] = ()
    together: bool
    arms: bool

    @abstractmethod
    def n_motors(self, values: Mapping[str, float]) -> int | None:
        """Return how many motors its parameters say that it has, None when they do not."""

    @abstractmethod
    def pulses(self, values: Mapping[str, float]) -> PulseRange:
        """Return the pulses that its parameters give; refuse a range that makes no sense."""

    @abstractmethod
    def turn(
        self, pulses_us: Mapping[int, float], pulses: PulseRange
    ) -> tuple[mav.MavCommand, ...]:
        """Return the orders that turn motors (by test number) at pulses above stop, or refuse."""

    @abstractmethod
    def stop(self, motors: tuple[int, ...]) -> tuple[mav.MavCommand, ...]:
        """Return the orders that stop motors at once."""


class ArduPilot(Autopilot):
    """Turn motors by DO_MOTOR_TEST, one at a time."""

    name = "ArduPilot"
    required = ("MOT_PWM_MIN", "MOT_PWM_MAX")
    parameters = ("FRAME_CLASS", *required, "MOT_SPIN_ARM")
    arms = True
    together = False

    def n_motors(self, values: Mapping[str, float]) -> int | None:
        return MOTORS_OF_FRAME.get(round(values.get("FRAME_CLASS", 0.0)))

    def pulses(self, values: Mapping[str, float]) -> PulseRange:
        low_us, high_us = values["MOT_PWM_MIN"], values["MOT_PWM_MAX"]
        if not LEAST_US <= low_us < high_us <= LONGEST_US:
            raise ProtocolError(
                f"MOT_PWM_MIN is {low_us:g} us and MOT_PWM_MAX {high_us:g} us, but benchtool needs "
                f"{LEAST_US:g} to {LONGEST_US:g} us, the less first; set them on the autopilot"
            )
        idle_us = low_us + values.get("MOT_SPIN_ARM", 0.1) * (high_us - low_us)
        return PulseRange(low_us, low_us, high_us, idle_us)

    def turn(
        self, pulses_us: Mapping[int, float], pulses: PulseRange
    ) -> tuple[mav.MavCommand, ...]:
        if len(pulses_us) > 1:
            listed = ", ".join(map(str, sorted(pulses_us)))
            raise InputError(
                f"motors {listed} cannot turn together: ArduPilot's motor test turns one motor at "
                f"a time; name one with --rotors, or use an autopilot whose actuator test allows "
                f"several (PX4)"
            )
        # ArduPilot gives pulses outside of its own range to the output as they are.
        for motor, pulse_us in pulses_us.items():
            if not pulses.low_us <= pulse_us <= pulses.high_us:
                raise InputError(
                    f"a pulse of {pulse_us:g} us for motor {motor} was not sent; the autopilot's "
                    f"range is {pulses.low_us:g} to {pulses.high_us:g} us (MOT_PWM_MIN to "
                    f"MOT_PWM_MAX)"
                )
        # Type 1 is a pulse in us; one motor, the board's usual order.
        return tuple(
            mav.MavCommand(mav.MOTOR_TEST, (motor, 1.0, pulse_us, mav.TIMEOUT_S, 1.0, 0.0, 0.0))
            for motor, pulse_us in pulses_us.items()
        )

    def stop(self, motors: tuple[int, ...]) -> tuple[mav.MavCommand, ...]:
        # A time-out of 0 ends the test, whichever motor turns.
        return (mav.MavCommand(mav.MOTOR_TEST, (motors[0], 1.0, 0.0, 0.0, 1.0, 0.0, 0.0)),)


class Px4(Autopilot):
    """Turn motors by ACTUATOR_TEST, any number together."""

    name = "PX4"
    parameters = ("CA_ROTOR_COUNT", "PWM_MAIN_MIN1", "PWM_MAIN_MAX1", "PWM_MAIN_DIS1")
    arms = False
    together = True

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
    """Hold what an autopilot says of itself; `speed` is its seconds per second of ours."""

    pilot: Autopilot
    pulses: PulseRange
    wiring: ChannelWiring
    device_id: str
    firmware: str
    simulated: bool
    speed: float

    def identity(self, settings: MavlinkSettings, facts: Mapping[str, str]) -> DeviceInfo:
        """Return the identity without what its streams say."""
        wiring, pulses, pilot = self.wiring, self.pulses, self.pilot
        pitch = settings.mode == "pitch"
        known = {
            "autopilot": pilot.name,
            "pwm_stop_us": f"{pulses.stop_us:g}",
            "pwm_idle_us": f"{pulses.idle_us:g}",
            "motors": " ".join(map(str, wiring.motors)),
            "outputs": " ".join(str(output or "?") for output in wiring.outputs),
            **facts,
        }
        if self.speed != 1.0:
            known["speed"] = f"{self.speed:g}"
        if pitch:
            known |= {"mode": "pitch", "armed_by": settings.arm}
        unmapped = pitch and len(wiring.outputs) > 1 and 0 in wiring.outputs
        if warnings := [*filter(None, (settings.warning, UNMAPPED if unmapped else ""))]:
            known["warning"] = "; ".join(warnings)
        return DeviceInfo(
            address="",
            device_id=self.device_id,
            firmware=self.firmware,
            protocol="MAVLink 2",
            channels=(),
            rate_Hz=settings.rate_Hz,
            n_rotors=wiring.n_rotors,
            simulated=self.simulated,
            moves_plate=self.simulated,
            limits={"pwm_us": pulses.high_us} | ({} if pilot.together else {"rotors_together": 1}),
            watchdog_s=mav.TIMEOUT_S,
            has_loop=pitch,
            armed_by_operator=pitch and settings.arm == "operator",
            pwm_stop_us=pulses.stop_us,
            pwm_idle_us=pulses.idle_us,
            outputs_measured=True,
            speed=self.speed,
            facts=known,
        )


def read_autopilot(
    link: MavlinkLink, beat: mav.Message, settings: MavlinkSettings, clock: Callable[[], float]
) -> AutopilotInfo:
    """Ask an autopilot what it is.

    Raises:
        ProtocolError: an autopilot whose motors benchtool cannot turn.
        InputError: the number of rotors is not known, or does not fit the map.
    """
    pilot = AUTOPILOTS.get(beat.autopilot)
    if pilot is None:
        known = " and ".join(pilot.name for pilot in AUTOPILOTS.values())
        raise ProtocolError(
            f"system {link.system} is an autopilot of kind {beat.autopilot} (MAV_AUTOPILOT), but "
            f"benchtool can turn motors of {known} only; use one of these"
        )
    simulated = bool(beat.base_mode & HIL)
    speedup = ("SIM_SPEEDUP",) if simulated else ()
    parameters = link.parameters((*pilot.parameters, *speedup), pilot.required)
    device_id, version = _version(link, clock)
    return AutopilotInfo(
        pilot=pilot,
        pulses=pilot.pulses(parameters),
        wiring=_wiring(pilot.n_motors(parameters), settings, link.system, simulated),
        device_id=device_id,
        firmware=f"{pilot.name} {version}".strip(),
        simulated=simulated,
        speed=parameters.get("SIM_SPEEDUP", 1.0) or 1.0,
    )


def _wiring(
    reported: int | None, settings: MavlinkSettings, system: int, simulated: bool
) -> ChannelWiring:
    known = settings.motor_map
    n = settings.rotors or (len(known.motors) if known else reported)
    if not n:
        raise InputError(
            f"system {system} does not say how many motors it has; give rotors=N in the address"
        )
    if known and len(known.motors) != n:
        raise InputError(
            f"rotors={n}, but the map of rig {known.rig!r} has {len(known.motors)}; leave rotors "
            f"out or make the map anew with benchtool bench map"
        )
    straight = tuple(range(1, n + 1))
    return ChannelWiring(
        motors=known.motors if known else straight,
        outputs=known.outputs if known else (0,) * n,
        escs=known.escs if known else straight,
        thrust=NO_THRUST if settings.cell else settings.thrust,
        thrust_scale_N=settings.thrust_scale_N,
        orientation=settings.orientation if settings.distance else None,
        virtual=simulated,
    )


def _version(link: MavlinkLink, clock: Callable[[], float]) -> tuple[str, str]:
    """Return the autopilot's own name and its version, as far as it reports them."""
    found: list[mav.Message] = []
    before = link.on_message

    def listen(message: mav.Message, arrived_s: float) -> None:
        if message.msgname == "AUTOPILOT_VERSION":
            found.append(message)
        before(message, arrived_s)

    link.on_message = listen
    try:
        number = float(mav.number_of("AUTOPILOT_VERSION"))
        request = mav.MavCommand(mav.REQUEST_MESSAGE, (number, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        if link.exchange(request) == mav.ACCEPTED:
            until_s = clock() + VERSION_TIMEOUT_S
            while not found and clock() < until_s:
                link.pump(0.02)
    finally:
        link.on_message = before
    if not found:
        return f"mavlink-system-{link.system}", ""
    name = bytes(found[0].uid2).rstrip(b"\0").hex() or f"{found[0].uid:x}"
    number = found[0].flight_sw_version
    return f"mavlink-{name}", f"{number >> 24}.{number >> 16 & 255}.{number >> 8 & 255}"
