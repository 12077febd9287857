"""Which messages a bench requests of an autopilot, and what became of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from benchtool.bench.addresses import MIN_RATE_HZ
from benchtool.bench.mavlink.autopilots import RESEND_INTERVAL_S
from benchtool.bench.mavlink.link import MavlinkLink
from benchtool.bench.mavlink.messages import ACCEPTED, dialect, interval, number_of
from benchtool.bench.mavlink.rows import SPEEDS, TELEMETRY
from benchtool.bench.mavlink.settings import THRUST_MESSAGES, MavlinkSettings
from benchtool.bench.transport.transport import BITS_PER_BYTE
from benchtool.core.errors import InputError, ProtocolError

SLOW_HZ, BATTERY_HZ = 20.0, 4.0  # speeds and distance; battery; as ESC telemetry; assumed
LISTEN_TIMEOUT_S = (
    1.2  # a message that was accepted and has not come after so long is one that never comes
)
MIN_LISTEN_S = 0.4  # wall time, however fast a virtual autopilot runs: a process may be held up

REQUIRED_MESSAGES = dict.fromkeys(TELEMETRY, 6)
"""So many of a message must come to know what lives in it: ESCs that report something have counts
that move, at 10 Hz and more, and their message comes at 20 Hz."""

FRAME_BYTES, SIGNATURE_BYTES = 12, 13  # around the payload of a MAVLink 2 frame

OUTPUT_MESSAGES = ("SERVO_OUTPUT_RAW", "ACTUATOR_OUTPUT_STATUS")

RATES_HZ = (
    200.0,
    125.0,
    100.0,
    50.0,
    40.0,
    25.0,
    20.0,
    MIN_RATE_HZ,
)  # tried on a slow line; assumed

UNREQUESTED_MESSAGES = {"HEARTBEAT", "STATUSTEXT", "COMMAND_ACK", "PARAM_VALUE", "TIMESYNC",
            "AUTOPILOT_VERSION", "SYSTEM_TIME", *THRUST_MESSAGES}  # fmt: skip
"""Messages that come as they are needed, or from others: no stream that could be switched off."""

LATE_TIMEOUT_S = 0.5  # a later acknowledgement means a full link: 100 times ArduPilot's; assumed

StreamState = Literal["comes", "denied", "accepted, but nothing comes", "comes unasked"]


@dataclass(frozen=True, slots=True)
class StreamRequest:
    """Request a message at a rate; only if the one that `instead_of` names never comes."""

    name: str
    rate_Hz: float
    instead_of: str = ""


def stream_requests(settings: MavlinkSettings, n_rotors: int) -> tuple[StreamRequest, ...]:
    """Return what is requested, the first choice of a channel before the second."""
    rate_Hz = settings.rate_Hz
    slow_Hz, battery_Hz = min(SLOW_HZ, rate_Hz), min(BATTERY_HZ, rate_Hz)
    found = [
        StreamRequest("SERVO_OUTPUT_RAW", rate_Hz),
        StreamRequest("ACTUATOR_OUTPUT_STATUS", rate_Hz, instead_of="SERVO_OUTPUT_RAW"),
        StreamRequest("BATTERY_STATUS", battery_Hz),
        StreamRequest("SYS_STATUS", battery_Hz, instead_of="BATTERY_STATUS"),
    ]
    if settings.mode == "pitch":
        found += [StreamRequest("ATTITUDE", rate_Hz), StreamRequest("ATTITUDE_TARGET", rate_Hz)]
    elif settings.cell is None:
        found.append(StreamRequest(settings.thrust.message, rate_Hz))
    if settings.speeds:
        names = (*list(TELEMETRY)[: (n_rotors + 3) // 4], *SPEEDS)
        found += [StreamRequest(name, slow_Hz) for name in names]
    if settings.distance:
        found.append(StreamRequest("DISTANCE_SENSOR", slow_Hz))
        found.append(StreamRequest("RANGEFINDER", slow_Hz, instead_of="DISTANCE_SENSOR"))
    return tuple(found)


def fit_rates(
    settings: MavlinkSettings, n_rotors: int, baud: int
) -> tuple[MavlinkSettings, list[str]]:
    """Return the settings with a rate that fits a serial line, and remarks on that."""
    for rate_Hz in (settings.rate_Hz, *RATES_HZ):
        if rate_Hz <= settings.rate_Hz and fits_bandwidth(settings, rate_Hz, n_rotors, baud):
            break
    else:
        check_fit(settings, MIN_RATE_HZ, n_rotors, baud)
    if rate_Hz == settings.rate_Hz:
        return settings, []
    remark = (
        f"outputs come at {rate_Hz:g} Hz instead of {settings.rate_Hz:g}: the link runs at "
        f"{baud:,} baud"
    )
    return replace(settings, rate_Hz=rate_Hz), [remark]


def check_fit(settings: MavlinkSettings, rate_Hz: float, n_rotors: int, baud: int) -> None:
    """Refuse a rate of outputs that does not fit a serial line; 0 baud has no limit."""
    if not fits_bandwidth(settings, rate_Hz, n_rotors, baud):
        needed = _bytes_per_s(settings, rate_Hz, n_rotors)
        raise InputError(
            f"outputs at {rate_Hz:g} Hz and what comes with them are {needed:,.0f} bytes/s x "
            f"{BITS_PER_BYTE} bits = {BITS_PER_BYTE * needed:,.0f} baud, but the link runs at "
            f"{baud:,} baud; ask for less (rate=, rpm=none) or raise the baud rate on both ends"
        )


def fits_bandwidth(settings: MavlinkSettings, rate_Hz: float, n_rotors: int, baud: int) -> bool:
    """Return whether everything that is requested fits a serial line."""
    return not baud or BITS_PER_BYTE * _bytes_per_s(settings, rate_Hz, n_rotors) <= baud


def _bytes_per_s(settings: MavlinkSettings, rate_Hz: float, n_rotors: int) -> float:
    """Return the bytes per second of first choices; what is denied makes it less."""
    signature = SIGNATURE_BYTES if settings.key else 0
    known = dialect().mavlink_map
    # Every order to turn that is sent again is acknowledged.
    rates_Hz = {"COMMAND_ACK": 1.0 / RESEND_INTERVAL_S} | {
        request.name: request.rate_Hz
        for request in stream_requests(replace(settings, rate_Hz=rate_Hz), n_rotors)
        # A line carries one kind of speeds.
        if not request.instead_of and request.name not in SPEEDS
    }
    bytes_of = {name: int(known[number_of(name)].unpacker.size) for name in rates_Hz}
    around = FRAME_BYTES + signature
    return sum(rates_Hz[name] * (size + around) for name, size in bytes_of.items())


def request_streams(
    link: MavlinkLink,
    wanted: tuple[StreamRequest, ...],
    counts: Callable[[str], int],
    clock: Callable[[], float],
    speed: float,
) -> dict[str, StreamState]:
    """Request every message and return what became of each.

    Args:
        counts: how many of a message have come so far.
        speed: of the autopilot's time.
    """
    states: dict[str, StreamState] = {}
    for second_choice in (False, True):
        accepted = {
            request.name: link.exchange(interval(request.name, request.rate_Hz)) == ACCEPTED
            for request in wanted
            if bool(request.instead_of) is second_choice
            and (not second_choice or states.get(request.instead_of) != "comes")
        }
        before = {name: counts(name) for name in accepted}
        until_s = clock() + max(LISTEN_TIMEOUT_S / speed, MIN_LISTEN_S)
        waiting = set(accepted)
        while waiting and clock() < until_s:
            link.pump(0.02)
            waiting = {n for n in waiting if counts(n) - before[n] < REQUIRED_MESSAGES.get(n, 1)}
        for name, taken in accepted.items():
            came = counts(name) > before[name]
            if taken:
                states[name] = "comes" if came else "accepted, but nothing comes"
            else:
                # Named values come from scripts and companions, which take no request.
                named = came and name in THRUST_MESSAGES
                states[name] = "comes unasked" if named else "denied"
    return states


def streaming_messages(states: Mapping[str, StreamState], *names: str) -> list[str]:
    """Return which of these messages, or of all, come as they were requested."""
    return [name for name in names or states if states.get(name) == "comes"]


def silent_messages(states: Mapping[str, StreamState]) -> list[str]:
    """Return remarks on the messages that do not come."""
    return [f"{name}: {state}" for name, state in states.items() if not state.startswith("comes")]


def disable_other_streams(
    link: MavlinkLink, counts: Mapping[str, int], states: Mapping[str, StreamState]
) -> list[str]:
    """End the streams of a serial port that this bench did not request; return remarks on it.

    Intervals belong to the autopilot's port and outlast the host that requested them. On a link
    that others may share they are left alone.

    Args:
        states: what became of the messages that were requested.
    """
    others = [
        name
        for name, count in sorted(counts.items())
        if count > 1 and name not in UNREQUESTED_MESSAGES and states.get(name) != "comes"
    ]
    for name in others:
        link.exchange(interval(name, 0.0))
    return [f"switched off, because nobody here asks for it: {' '.join(others)}"] if others else []


def require_outputs(states: dict[str, StreamState], system: int) -> None:
    """Refuse an autopilot that does not report its outputs: nothing could be read back."""
    if not streaming_messages(states, *OUTPUT_MESSAGES):
        listed = ", ".join(f"{name} {states[name]}" for name in OUTPUT_MESSAGES if name in states)
        raise ProtocolError(
            f"system {system} does not report its outputs ({listed}), so nobody could see what its "
            f"motors do; raise the telemetry port's rate or take another port"
        )


def stream_facts(states: dict[str, StreamState]) -> dict[str, str]:
    """Return in words, for a run's facts, which messages come, were denied, or never came."""
    groups: dict[str, list[str]] = {}
    for name, what in states.items():
        groups.setdefault(what, []).append(name)
    return {f"messages {what}": " ".join(names) for what, names in groups.items()}
