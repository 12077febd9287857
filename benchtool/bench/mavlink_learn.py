"""What a host learns of an autopilot before it asks for streams: kind, motors, pulses, name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from benchtool.bench.mavlink_dialect import Message
from benchtool.bench.mavlink_health import HIL
from benchtool.bench.mavlink_pilots import PILOTS, Order, Pilot, PulseRange
from benchtool.bench.mavlink_settings import MavlinkSettings
from benchtool.bench.mavlink_talk import MavlinkTalk
from benchtool.bench.mavlink_wiring import NO_THRUST, Wiring
from benchtool.errors import InputError, ProtocolError

REQUEST_MESSAGE = 512
VERSION_S = 0.5
ACCEPTED = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Learnt:
    """Hold what an autopilot says of itself.

    Attributes:
        pilot: how it is told to turn motors.
        pulses: range of its outputs.
        wiring: rotors, outputs and messages.
        device_id: its unchanging name.
        firmware: name and version.
        simulated: whether its heartbeat says that no motor turns.
        speed: its seconds per second of ours; 1 unless simulated.
    """

    pilot: Pilot
    pulses: PulseRange
    wiring: Wiring
    device_id: str
    firmware: str
    simulated: bool
    speed: float


def learn(
    talk: MavlinkTalk, beat: Message, settings: MavlinkSettings, clock: Callable[[], float]
) -> Learnt:
    """Ask an autopilot what it is.

    Raises:
        ProtocolError: an autopilot whose motors benchtool cannot turn.
        InputError: the number of rotors is not known, or does not fit the map.
    """
    pilot = PILOTS.get(beat.autopilot)
    if pilot is None:
        known = " and ".join(pilot.name for pilot in PILOTS.values())
        raise ProtocolError(
            f"system {talk.system} is an autopilot of kind {beat.autopilot} (MAV_AUTOPILOT), but "
            f"benchtool can turn motors of {known} only; use one of these"
        )
    simulated = bool(beat.base_mode & HIL)
    speedup = ("SIM_SPEEDUP",) if simulated else ()
    parameters = talk.parameters((*pilot.asked, *speedup), pilot.required)
    device_id, version = _version(talk, clock)
    return Learnt(
        pilot=pilot,
        pulses=pilot.pulses(parameters),
        wiring=_wiring(pilot.n_motors(parameters), settings, talk.system, simulated),
        device_id=device_id,
        firmware=f"{pilot.name} {version}".strip(),
        simulated=simulated,
        speed=parameters.get("SIM_SPEEDUP", 1.0) or 1.0,
    )


def _wiring(told: int | None, settings: MavlinkSettings, system: int, simulated: bool) -> Wiring:
    known = settings.motor_map
    n = settings.rotors or (len(known.motors) if known else told)
    if not n:
        raise InputError(
            f"system {system} does not tell how many motors it has; give rotors=N in the address"
        )
    if known and len(known.motors) != n:
        raise InputError(
            f"rotors={n}, but the map of rig {known.rig!r} has {len(known.motors)}; leave rotors "
            f"out or make the map anew with benchtool bench map"
        )
    straight = tuple(range(1, n + 1))
    return Wiring(
        motors=known.motors if known else straight,
        outputs=known.outputs if known else (0,) * n,
        escs=known.escs if known else straight,
        thrust=NO_THRUST if settings.cell else settings.thrust,
        thrust_scale_N=settings.thrust_scale_N,
        orientation=settings.orientation if settings.distance else None,
        virtual=simulated,
    )


def _version(talk: MavlinkTalk, clock: Callable[[], float]) -> tuple[str, str]:
    """Return the autopilot's own name and its version, as far as it tells them."""
    found: list[Message] = []
    before = talk.on_message

    def listen(message: Message, arrived_s: float) -> None:
        if message.msgname == "AUTOPILOT_VERSION":
            found.append(message)
        before(message, arrived_s)

    talk.on_message = listen
    try:
        number = float(talk.words.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        ask = Order(REQUEST_MESSAGE, (number, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        if talk.exchange(ask) == ACCEPTED:
            until_s = clock() + VERSION_S
            while not found and clock() < until_s:
                talk.pump(0.02)
    finally:
        talk.on_message = before
    if not found:
        return f"mavlink-system-{talk.system}", ""
    told = found[0]
    long = bytes(told.uid2).rstrip(b"\0").hex()
    name = long or f"{told.uid:x}"
    number = told.flight_sw_version
    version = f"{number >> 24}.{number >> 16 & 255}.{number >> 8 & 255}"
    return f"mavlink-{name}", version
