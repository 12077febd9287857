"""What a host learns of an autopilot on opening, and the identity that it makes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from benchtool.bench.bench import Identity
from benchtool.bench.mavlink.health import HIL
from benchtool.bench.mavlink.link import MavlinkLink
from benchtool.bench.mavlink.messages import Message
from benchtool.bench.mavlink.pilots import (
    ACCEPTED,
    PILOTS,
    SEEN_S,
    TIMEOUT_S,
    MavCommand,
    Pilot,
    PulseRange,
)
from benchtool.bench.mavlink.settings import (
    NO_THRUST,
    MavlinkSettings,
    Wiring,
)
from benchtool.core.channel import Channel
from benchtool.core.errors import InputError, ProtocolError

REQUEST_MESSAGE = 512
VERSION_S = 0.5

ALONE = {"rotors_together": 1.0}
"""Limit of an autopilot whose motor test turns one motor at a time."""

UNMAPPED = (
    "the address has no map=, so rotor 1 is taken to hang on output 1 and so on; where it does "
    "not, pulses and speeds are recorded under other rotors than theirs; make a map with benchtool "
    "bench map and add map=FILE"
)
"""Said of a pitch bench: its loop turns all rotors together, so that none shows its output."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotInfo:
    """Hold what an autopilot says of itself.

    Attributes:
        wiring: rotors, outputs and messages.
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


def read_autopilot(
    link: MavlinkLink, beat: Message, settings: MavlinkSettings, clock: Callable[[], float]
) -> AutopilotInfo:
    """Ask an autopilot what it is.

    Raises:
        ProtocolError: an autopilot whose motors benchtool cannot turn.
        InputError: the number of rotors is not known, or does not fit the map.
    """
    pilot = PILOTS.get(beat.autopilot)
    if pilot is None:
        known = " and ".join(pilot.name for pilot in PILOTS.values())
        raise ProtocolError(
            f"system {link.system} is an autopilot of kind {beat.autopilot} (MAV_AUTOPILOT), but "
            f"benchtool can turn motors of {known} only; use one of these"
        )
    simulated = bool(beat.base_mode & HIL)
    speedup = ("SIM_SPEEDUP",) if simulated else ()
    parameters = link.parameters((*pilot.asked, *speedup), pilot.required)
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
) -> Wiring:
    known = settings.motor_map
    n = settings.rotors or (len(known.motors) if known else reported)
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


def _version(link: MavlinkLink, clock: Callable[[], float]) -> tuple[str, str]:
    """Return the autopilot's own name and its version, as far as it reports them."""
    found: list[Message] = []
    before = link.on_message

    def listen(message: Message, arrived_s: float) -> None:
        if message.msgname == "AUTOPILOT_VERSION":
            found.append(message)
        before(message, arrived_s)

    link.on_message = listen
    try:
        number = float(link.words.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        request = MavCommand(REQUEST_MESSAGE, (number, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        if link.exchange(request) == ACCEPTED:
            until_s = clock() + VERSION_S
            while not found and clock() < until_s:
                link.pump(0.02)
    finally:
        link.on_message = before
    if not found:
        return f"mavlink-system-{link.system}", ""
    version = found[0]
    long = bytes(version.uid2).rstrip(b"\0").hex()
    name = long or f"{version.uid:x}"
    number = version.flight_sw_version
    return f"mavlink-{name}", f"{number >> 24}.{number >> 16 & 255}.{number >> 8 & 255}"


def identity_of(
    address: str,
    autopilot: AutopilotInfo,
    settings: MavlinkSettings,
    channels: tuple[Channel, ...],
    rate_Hz: float,
    slowest_s: float,
    more: Mapping[str, str],
) -> Identity:
    """Return the identity of an open bench.

    Args:
        slowest_s: longest time that an acknowledgement took (wall time).
    """
    pulses = autopilot.pulses
    facts = {
        "autopilot": autopilot.pilot.name,
        "pwm_stop_us": f"{pulses.stop_us:g}",
        "pwm_idle_us": f"{pulses.idle_us:g}",
        "motors": " ".join(map(str, autopilot.wiring.motors)),
        "outputs": " ".join(str(output or "?") for output in autopilot.wiring.outputs),
        **more,
    }
    if autopilot.speed != 1.0:
        facts["speed"] = f"{autopilot.speed:g}"
    if settings.mode == "pitch":
        facts |= {"mode": "pitch", "armed_by": settings.arm}
    outputs = autopilot.wiring.outputs
    unmapped = settings.mode == "pitch" and len(outputs) > 1 and 0 in outputs
    warnings = [settings.warning, UNMAPPED if unmapped else ""]
    if warning := "; ".join(filter(None, warnings)):
        facts["warning"] = warning
    return Identity(
        address=address,
        device_id=autopilot.device_id,
        firmware=autopilot.firmware,
        protocol="MAVLink 2",
        channels=channels,
        rate_Hz=rate_Hz,
        n_rotors=autopilot.wiring.n_rotors,
        simulated=autopilot.simulated,
        moves_plate=autopilot.simulated,
        limits={"pwm_us": pulses.high_us, **({} if autopilot.pilot.together else ALONE)},
        watchdog_s=TIMEOUT_S,
        has_loop=settings.mode == "pitch",
        armed_by_operator=settings.mode == "pitch" and settings.arm == "operator",
        pwm_stop_us=pulses.stop_us,
        pwm_idle_us=pulses.idle_us,
        outputs_measured=True,
        longest_delay_s=autopilot.speed * max(slowest_s, SEEN_S),
        speed=autopilot.speed,
        facts=facts,
    )
