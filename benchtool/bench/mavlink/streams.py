"""Which messages a bench requests of an autopilot, and what became of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from benchtool.bench.mavlink.link import MavlinkLink
from benchtool.bench.mavlink.messages import ESC_STATUS, dialect
from benchtool.bench.mavlink.pilots import (
    ACCEPTED,
    RESEND_S,
    MavCommand,
)
from benchtool.bench.mavlink.settings import (
    LEAST_HZ,
    THRUST_MESSAGES,
    MavlinkSettings,
)
from benchtool.bench.serial.bench import BITS_PER_BYTE
from benchtool.core.errors import InputError, ProtocolError

SET_INTERVAL = 511
COMMAND_ACK = 77
SLOW_HZ, BATTERY_HZ = 20.0, 4.0
"""Speeds and distance; battery. ESC telemetry has no more to say (a choice)."""

ESC_TELEMETRY = ("ESC_TELEMETRY_1_TO_4", "ESC_TELEMETRY_5_TO_8", "ESC_TELEMETRY_9_TO_12")

LISTEN_S = 1.2
"""A message that was accepted and has not come after so long is one that never comes."""

LEAST_LISTEN_S = 0.4
"""Wall time that is waited for it even where a virtual autopilot's time runs faster: a busy machine
can hold a process up for that long."""

NEEDED = dict.fromkeys(ESC_TELEMETRY, 6)
"""So many of a message must come to know what lives in it: ESCs that report something have counts
that move, at 10 Hz and more, and their message comes at 20 Hz."""

FRAME_BYTES, SIGNATURE_BYTES = 12, 13
"""Around the payload of a MAVLink 2 frame."""

OUTPUT_MESSAGES = ("SERVO_OUTPUT_RAW", "ACTUATOR_OUTPUT_STATUS")

ALTERNATES = ("ESC_STATUS", "RAW_RPM", "RPM")
"""Speeds that come where ESC_TELEMETRY does not: a line carries one kind."""

RATES_HZ = (200.0, 125.0, 100.0, 50.0, 40.0, 25.0, 20.0, LEAST_HZ)
"""Rates that are tried where a slow line does not carry what was asked for; a choice."""

UNBIDDEN = {"HEARTBEAT", "STATUSTEXT", "COMMAND_ACK", "PARAM_VALUE", "AUTOPILOT_VERSION",
            "TIMESYNC", "SYSTEM_TIME", *THRUST_MESSAGES}  # fmt: skip
"""Messages that come as they are needed, or from others: no stream that could be switched off."""

LATE_S = 0.5
"""Acknowledgements that take longer say that a link carries more than it can; a choice, a hundred
times what ArduPilot needs."""

StreamState = Literal["comes", "denied", "accepted, but nothing comes", "comes unasked"]


@dataclass(frozen=True, slots=True)
class StreamRequest:
    """Ask for a message at a rate; `stead` names the one in whose stead it is asked for."""

    name: str
    rate_Hz: float
    stead: str = ""


def stream_requests(settings: MavlinkSettings, n_rotors: int) -> tuple[StreamRequest, ...]:
    """Return what is asked for, the first choice of a channel before the second."""
    rate_Hz = settings.rate_Hz
    slow_Hz = min(SLOW_HZ, rate_Hz)
    found = [
        StreamRequest("SERVO_OUTPUT_RAW", rate_Hz),
        StreamRequest("ACTUATOR_OUTPUT_STATUS", rate_Hz, stead="SERVO_OUTPUT_RAW"),
        StreamRequest("BATTERY_STATUS", min(BATTERY_HZ, rate_Hz)),
        StreamRequest("SYS_STATUS", min(BATTERY_HZ, rate_Hz), stead="BATTERY_STATUS"),
    ]
    if settings.mode == "pitch":
        found += [StreamRequest("ATTITUDE", rate_Hz), StreamRequest("ATTITUDE_TARGET", rate_Hz)]
    elif settings.cell is None:
        found.append(StreamRequest(settings.thrust.message, rate_Hz))
    if settings.speeds:
        found += [StreamRequest(name, slow_Hz) for name in ESC_TELEMETRY[: (n_rotors + 3) // 4]]
        found += [StreamRequest(name, slow_Hz) for name in ("ESC_STATUS", "RAW_RPM", "RPM")]
    if settings.distance:
        found.append(StreamRequest("DISTANCE_SENSOR", slow_Hz))
        found.append(StreamRequest("RANGEFINDER", slow_Hz, stead="DISTANCE_SENSOR"))
    return tuple(found)


def fitted(
    settings: MavlinkSettings, n_rotors: int, baud: int
) -> tuple[MavlinkSettings, list[str]]:
    """Return the settings with a rate that fits a serial line, and what must be said of that.

    Raises:
        InputError: not even the slowest fits, with the arithmetic.
    """
    for rate_Hz in (settings.rate_Hz, *RATES_HZ):
        if rate_Hz <= settings.rate_Hz and fits(settings, rate_Hz, n_rotors, baud):
            break
    else:
        check_fit(settings, LEAST_HZ, n_rotors, baud)
    if rate_Hz == settings.rate_Hz:
        return settings, []
    remark = (
        f"outputs come at {rate_Hz:g} Hz instead of {settings.rate_Hz:g}: the link runs at "
        f"{baud:,} baud"
    )
    return replace(settings, rate_Hz=rate_Hz), [remark]


def check_fit(settings: MavlinkSettings, rate_Hz: float, n_rotors: int, baud: int) -> None:
    """Refuse a rate of outputs that does not fit a serial line; 0 baud has no limit.

    Raises:
        InputError: with the arithmetic.
    """
    if not fits(settings, rate_Hz, n_rotors, baud):
        needed = _bytes_per_s(settings, rate_Hz, n_rotors)
        raise InputError(
            f"outputs at {rate_Hz:g} Hz and what comes with them are {needed:,.0f} bytes/s x "
            f"{BITS_PER_BYTE} bits = {BITS_PER_BYTE * needed:,.0f} baud, but the link runs at "
            f"{baud:,} baud; ask for less (rate=, rpm=none) or raise the baud rate on both ends"
        )


def fits(settings: MavlinkSettings, rate_Hz: float, n_rotors: int, baud: int) -> bool:
    """Return whether everything that is asked for fits a serial line."""
    return not baud or BITS_PER_BYTE * _bytes_per_s(settings, rate_Hz, n_rotors) <= baud


def _bytes_per_s(settings: MavlinkSettings, rate_Hz: float, n_rotors: int) -> float:
    """Return the bytes per second of first choices; what is denied makes it less."""
    signature = SIGNATURE_BYTES if settings.key else 0
    known = dialect().mavlink_map
    # Every order to turn that is sent again is acknowledged.
    acks = float(known[COMMAND_ACK].unpacker.size + FRAME_BYTES + signature) / RESEND_S
    return acks + float(
        sum(
            request.rate_Hz
            * (known[number_of(request.name)].unpacker.size + FRAME_BYTES + signature)
            for request in stream_requests(replace(settings, rate_Hz=rate_Hz), n_rotors)
            if not request.stead and request.name not in ALTERNATES
        )
    )


def request_streams(
    link: MavlinkLink,
    wanted: tuple[StreamRequest, ...],
    counts: Callable[[str], int],
    clock: Callable[[], float],
    speed: float,
) -> dict[str, StreamState]:
    """Ask for every message and say what became of each.

    Args:
        wanted: messages, first choices first.
        counts: how many of a message have come so far.
        speed: of the autopilot's time.

    Raises:
        LinkLost: the autopilot does not answer.
    """
    states: dict[str, StreamState] = {}
    for stage in (False, True):
        asked = [
            request
            for request in wanted
            if bool(request.stead) is stage and (not stage or states.get(request.stead) != "comes")
        ]
        taken = []
        for request in asked:
            result = link.exchange(interval(request.name, request.rate_Hz))
            if result == ACCEPTED:
                taken.append(request)
            else:
                states[request.name] = "denied"
        before = {request.name: counts(request.name) for request in asked}
        until_s = clock() + max(LISTEN_S / speed, LEAST_LISTEN_S)
        watched = {request.name for request in asked}
        waiting = set(watched)
        while waiting and clock() < until_s:
            link.pump(0.02)
            watched = {name for name in watched if counts(name) == before[name]}
            waiting = {
                name for name in waiting if counts(name) - before[name] < NEEDED.get(name, 1)
            }
        for request in taken:
            came = request.name not in watched
            states[request.name] = "comes" if came else "accepted, but nothing comes"
        for request in asked:
            # Named values come from scripts and companions, which nobody can ask.
            if request.name in THRUST_MESSAGES and request.name not in watched:
                states[request.name] = "comes" if request in taken else "comes unasked"
    return states


def switch_off_others(
    link: MavlinkLink, counts: Mapping[str, int], states: Mapping[str, StreamState]
) -> list[str]:
    """End the streams of a serial port that nobody here asked for; return what must be said.

    Intervals belong to the autopilot's port and outlast the host that asked for them. On a link
    that others may share they are left alone.

    Args:
        counts: how many of each message of the autopilot itself have come.
        became: what became of the messages that were asked for.
    """
    others = [
        name
        for name, count in sorted(counts.items())
        if count > 1 and name not in UNBIDDEN and states.get(name) != "comes"
    ]
    for name in others:
        link.exchange(interval(name, 0.0))
    return [f"switched off, because nobody here asks for it: {' '.join(others)}"] if others else []


def require_outputs(states: dict[str, StreamState], system: int) -> None:
    """Refuse an autopilot that does not tell its outputs: nothing could be read back.

    Raises:
        ProtocolError: what became of the messages.
    """
    if not any(states.get(name) == "comes" for name in OUTPUT_MESSAGES):
        listed = ", ".join(f"{name} {states[name]}" for name in OUTPUT_MESSAGES if name in states)
        raise ProtocolError(
            f"system {system} does not tell its outputs ({listed}), so nobody could see what its "
            f"motors do; raise the telemetry port's rate or take another port"
        )


def interval(name: str, rate_Hz: float) -> MavCommand:
    """Return the order that asks for a message at a rate; 0 ends it."""
    every_us = 1e6 / rate_Hz if rate_Hz > 0.0 else -1.0
    return MavCommand(SET_INTERVAL, (float(number_of(name)), every_us, 0.0, 0.0, 0.0, 0.0, 0.0))


def number_of(name: str) -> int:
    """Return the number of a message."""
    if name == "ESC_STATUS":
        return ESC_STATUS
    return int(getattr(dialect(), f"MAVLINK_MSG_ID_{name}"))


def stream_facts(states: dict[str, StreamState]) -> dict[str, str]:
    """Return in words, for a run's facts, which messages come, were denied, or never came."""
    groups: dict[str, list[str]] = {}
    for name, what in states.items():
        groups.setdefault(what, []).append(name)
    return {f"messages {what}": " ".join(names) for what, names in groups.items()}
