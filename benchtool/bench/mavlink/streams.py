"""Requests for the message streams of an autopilot, and their results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from benchtool.bench.drivers import MIN_HZ
from benchtool.bench.mavlink.autopilots import RESEND_INTERVAL_S
from benchtool.bench.mavlink.frames import ACCEPTED, dialect, interval, message_id
from benchtool.bench.mavlink.link import MavlinkLink
from benchtool.bench.mavlink.rows import SPEEDS, TELEMETRY
from benchtool.bench.mavlink.settings import THRUST_MESSAGES, MavlinkSettings
from benchtool.bench.transport.transport import BITS_PER_BYTE
from benchtool.core.errors import InputError, ProtocolError

SLOW_HZ, BATTERY_HZ = 20.0, 4.0  # speeds and distance; battery; as ESC telemetry; assumed
LISTEN_TIMEOUT_S = 1.2  # an accepted message that has not arrived by then counts as missing
MIN_LISTEN_S = 0.4  # wall time, also for fast virtual autopilots: a process may be delayed

# Messages needed to find the values that change in it: ESCs with telemetry have counts that change
# at 10 Hz or more, and their message comes at 20 Hz.
REQUIRED_MESSAGES = dict.fromkeys(TELEMETRY, 6)

FRAME_BYTES, SIGNATURE_BYTES = 12, 13  # around the payload of a MAVLink 2 frame

OUTPUT_MESSAGES = ("SERVO_OUTPUT_RAW", "ACTUATOR_OUTPUT_STATUS")

RATES_HZ = (200.0, 125.0, 100.0, 50.0, 40.0, 25.0, 20.0, MIN_HZ)  # for slow lines; assumed

# Sent on demand, or by other components: no streams that could be disabled.
UNREQUESTED_MESSAGES = {"HEARTBEAT", "STATUSTEXT", "COMMAND_ACK", "PARAM_VALUE", "TIMESYNC",
            "AUTOPILOT_VERSION", "SYSTEM_TIME", *THRUST_MESSAGES}  # fmt: skip

LATE_TIMEOUT_S = 0.5  # a later acknowledgement means a full link: 100 times ArduPilot's; assumed

StreamState = Literal["comes", "denied", "accepted, but nothing comes", "comes unasked"]


@dataclass(frozen=True, slots=True)
class StreamRequest:
    """Request of a message at a rate; a fallback if the message `instead_of` is missing."""

    name: str
    rate_Hz: float
    instead_of: str = ""


def stream_requests(settings: MavlinkSettings, n_rotors: int) -> tuple[StreamRequest, ...]:
    """Return the requested messages, the first choice of a channel before its fallback."""
    rate_Hz = settings.rate_Hz
    slow_Hz, battery_Hz = min(SLOW_HZ, rate_Hz), min(BATTERY_HZ, rate_Hz)
    requests = [
        StreamRequest("SERVO_OUTPUT_RAW", rate_Hz),
        StreamRequest("ACTUATOR_OUTPUT_STATUS", rate_Hz, instead_of="SERVO_OUTPUT_RAW"),
        StreamRequest("BATTERY_STATUS", battery_Hz),
        StreamRequest("SYS_STATUS", battery_Hz, instead_of="BATTERY_STATUS"),
    ]
    if settings.mode == "pitch":
        requests += [StreamRequest("ATTITUDE", rate_Hz), StreamRequest("ATTITUDE_TARGET", rate_Hz)]
    elif settings.cell is None:
        requests.append(StreamRequest(settings.thrust.message, rate_Hz))
    if settings.speeds:
        names = (*list(TELEMETRY)[: (n_rotors + 3) // 4], *SPEEDS)
        requests += [StreamRequest(name, slow_Hz) for name in names]
    if settings.orientation is not None:
        requests.append(StreamRequest("DISTANCE_SENSOR", slow_Hz))
        requests.append(StreamRequest("RANGEFINDER", slow_Hz, instead_of="DISTANCE_SENSOR"))
    return tuple(requests)


def fit_rates(
    settings: MavlinkSettings, n_rotors: int, baud: int
) -> tuple[MavlinkSettings, list[str]]:
    """Return the settings with a rate that fits a serial line, and warnings about it."""
    for rate_Hz in (settings.rate_Hz, *RATES_HZ):
        fits_line = not baud or _required_baud(settings, rate_Hz, n_rotors) <= baud
        if rate_Hz <= settings.rate_Hz and fits_line:
            break
    else:
        check_fit(settings, MIN_HZ, n_rotors, baud)
    if rate_Hz == settings.rate_Hz:
        return settings, []
    warning = (
        f"outputs come at {rate_Hz:g} Hz instead of {settings.rate_Hz:g}: the link runs at "
        f"{baud:,} baud"
    )
    return replace(settings, rate_Hz=rate_Hz), [warning]


def check_fit(settings: MavlinkSettings, rate_Hz: float, n_rotors: int, baud: int) -> None:
    """Raise if a rate of outputs exceeds the rate of a serial line; 0 baud has no limit."""
    required_baud = _required_baud(settings, rate_Hz, n_rotors)
    if baud and required_baud > baud:
        raise InputError(
            f"outputs at {rate_Hz:g} Hz and the other streams are "
            f"{required_baud / BITS_PER_BYTE:,.0f} bytes/s x {BITS_PER_BYTE} bits = "
            f"{required_baud:,.0f} baud, but the link has {baud:,} baud; reduce them (rate=, "
            f"rpm=none) or raise the baud rate on both ends"
        )


def _required_baud(settings: MavlinkSettings, rate_Hz: float, n_rotors: int) -> float:
    """Return the bits per second of the preferred messages; denied requests reduce it."""
    classes = dialect().mavlink_map
    # Every repeated motor command is acknowledged.
    rates_Hz = {"COMMAND_ACK": 1.0 / RESEND_INTERVAL_S} | {
        request.name: request.rate_Hz
        for request in stream_requests(replace(settings, rate_Hz=rate_Hz), n_rotors)
        # A link carries one kind of speeds.
        if not request.instead_of and request.name not in SPEEDS
    }
    sizes = {name: int(classes[message_id(name)].unpacker.size) for name in rates_Hz}
    overhead_bytes = FRAME_BYTES + (SIGNATURE_BYTES if settings.key else 0)
    bytes_per_s = sum(rates_Hz[name] * (size + overhead_bytes) for name, size in sizes.items())
    return BITS_PER_BYTE * bytes_per_s


def request_streams(
    link: MavlinkLink,
    requests: tuple[StreamRequest, ...],
    counts: Mapping[str, int],
    speed: float,  # seconds of the autopilot's time per wall second
) -> dict[str, StreamState]:
    """Request every message and return the result of each.

    The counts of received messages by name are updated while the link is read.
    """
    states: dict[str, StreamState] = {}
    for is_fallback in (False, True):
        accepted = {
            request.name: link.exchange(interval(request.name, request.rate_Hz)) == ACCEPTED
            for request in requests
            if bool(request.instead_of) is is_fallback
            and (not is_fallback or states.get(request.instead_of) != "comes")
        }
        initial = {name: counts[name] for name in accepted}
        deadline_s = link.clock() + max(LISTEN_TIMEOUT_S / speed, MIN_LISTEN_S)
        pending = set(accepted)
        while pending and link.clock() < deadline_s:
            link.pump(0.02)
            pending = {n for n in pending if counts[n] - initial[n] < REQUIRED_MESSAGES.get(n, 1)}
        for name, is_accepted in accepted.items():
            has_come = counts[name] > initial[name]
            if is_accepted:
                states[name] = "comes" if has_come else "accepted, but nothing comes"
            else:
                # Named values come from scripts and companions, which accept no request.
                is_named_value = has_come and name in THRUST_MESSAGES
                states[name] = "comes unasked" if is_named_value else "denied"
    return states


def streaming_messages(states: Mapping[str, StreamState], *names: str) -> list[str]:
    """Return which of these messages, or of all, are received as requested."""
    return [name for name in names or states if states.get(name) == "comes"]


def silent_messages(states: Mapping[str, StreamState]) -> list[str]:
    """Return warnings about messages that are not received."""
    return [f"{name}: {state}" for name, state in states.items() if not state.startswith("comes")]


def disable_other_streams(
    link: MavlinkLink, counts: Mapping[str, int], states: Mapping[str, StreamState]
) -> list[str]:
    """Disable streams on a serial port that this bench did not request; return warnings.

    Intervals belong to the autopilot's port and outlast the host that requested them. On a link
    that may be shared they are not changed.
    """
    other_names = [
        name
        for name, count in sorted(counts.items())
        if count > 1 and name not in UNREQUESTED_MESSAGES and states.get(name) != "comes"
    ]
    for name in other_names:
        link.exchange(interval(name, 0.0))
    names = " ".join(other_names)
    return [f"disabled streams that this bench does not need: {names}"] if other_names else []


def require_outputs(states: dict[str, StreamState], system: int) -> None:
    """Raise if the autopilot does not report its outputs, which could not be read back."""
    if not streaming_messages(states, *OUTPUT_MESSAGES):
        listed = ", ".join(f"{name} {states[name]}" for name in OUTPUT_MESSAGES if name in states)
        raise ProtocolError(
            f"system {system} sends no servo outputs ({listed}), needed to verify motor commands; "
            f"raise the rate of the telemetry port or use another port"
        )


def stream_facts(states: dict[str, StreamState]) -> dict[str, str]:
    """Return metadata for a run: messages that are received, denied or missing."""
    groups: dict[str, list[str]] = {}
    for name, state in states.items():
        groups.setdefault(state, []).append(name)
    return {f"messages {state}": " ".join(names) for state, names in groups.items()}
