"""Hello of a device: its description as a value and as text lines."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan
from typing import Any

from benchtool.bench.bench import DeviceInfo
from benchtool.bench.serial.commands import PROTOCOL_VERSION
from benchtool.bench.serial.frames import MAX_LINE_BYTES, build_payload, crc16
from benchtool.bench.transport.transport import BITS_PER_BYTE
from benchtool.core.channel import Channel
from benchtool.core.errors import InputError, ProtocolError

Fields = tuple[str, ...]

UNLIMITED_BAUD = 0  # a link without baud rate: USB CDC, TCP, a pseudo-terminal
MAX_SPEED = 1000.0  # fastest virtual bench


@dataclass(frozen=True, slots=True, kw_only=True)
class Hello(DeviceInfo):
    """Device information in a hello; `rate_Hz` is the proposed stream rate.

    Attributes:
        watchdog_s: the motors stop after this time without a valid line, wall time.
    """

    address: str = ""
    protocol: str = ""
    pwm_stop_us: float
    pwm_idle_us: float
    moves_plate: bool = True
    simulated: bool = False
    frame_bytes: int = 128  # longest sample frame, for the stream rate that a baud rate allows
    baud: int = UNLIMITED_BAUD  # baud rate of the device's serial port, 0 for a link without one
    version: int = PROTOCOL_VERSION

    def __post_init__(self) -> None:
        object.__setattr__(self, "channel_hash", channel_hash(self.channels))

    def identity(self, address: str, rate_Hz: float) -> DeviceInfo:
        """Return the device information of a bench opened at `address`."""
        facts = dict(self.facts)
        if self.speed != 1.0:
            facts["speed"] = f"{self.speed:g}"
        facts["pwm_stop_us"] = f"{self.pwm_stop_us:g}"
        facts["pwm_idle_us"] = f"{self.pwm_idle_us:g}"
        return replace(
            self,
            address=address,
            protocol=f"benchtool-{self.version}",
            rate_Hz=rate_Hz,
            rejects_late_commands=True,
            facts=facts,
        )


_NUMBERS: dict[str, tuple[str, type[float], float, float, str]] = {  # name, type and range, default
    "rotors": ("n_rotors", int, 1, 64, ""),
    "rate": ("rate_Hz", float, 0.01, 1e6, ""),
    "watchdog": ("watchdog_s", float, 100.0, 10e3, "250"),  # ms on the wire
    "plate": ("moves_plate", bool, 0, 1, "0"),
    "simulated": ("simulated", bool, 0, 1, "0"),
    "frame": ("frame_bytes", int, 8, MAX_LINE_BYTES, "128"),
    "baud": ("baud", int, 0, 100_000_000, str(UNLIMITED_BAUD)),
    "speed": ("speed", float, 0.001, MAX_SPEED, "1"),
    "loop": ("has_loop", bool, 0, 1, "0"),
}


def hello_lines(hello: Hello) -> tuple[Fields, ...]:
    """Return the hello as lines of fields, in transmission order."""
    lines: list[Fields] = [
        ("protocol", str(hello.version)),
        ("device", hello.device_id),
        ("firmware", hello.firmware),
    ]
    for key, (name, kind, *_) in _NUMBERS.items():
        value = getattr(hello, name) * (1000.0 if key == "watchdog" else 1)
        if key == "rate":
            lines.append(("pwm", f"{hello.pwm_stop_us:g}", f"{hello.pwm_idle_us:g}"))
        if key != "loop" or value:
            lines.append((key, f"{value:g}" if kind is float else str(int(value))))
    for channel, rate_Hz in zip(hello.channels, hello.channel_rates_Hz, strict=True):
        lines.append(("channel", channel.name, channel.unit, f"{rate_Hz:g}"))
    lines += [("limit", name, f"{value:.9g}") for name, value in hello.limits.items()]
    lines += [("fact", name, text) for name, text in hello.facts.items()]
    return tuple(lines)


def channel_hash(channels: Sequence[Channel]) -> str:
    """Return the CRC of a channel map, names and units in order, as four hexadecimal digits."""
    lines = (f"{channel.name},{channel.unit}\n" for channel in channels)
    return f"{crc16(''.join(lines).encode('ascii', 'replace')):04X}"


_REQUIRED = ("protocol", "device", "firmware", "rotors", "pwm", "rate", "channel")

_FIELD_COUNTS = {"channel": 3, "limit": 2, "fact": 2, "pwm": 2}

_MAX_LENGTH = 100


def parse_hello(lines: Iterable[Sequence[str]]) -> Hello:
    """Parse a hello from its lines; unknown keys, from later versions, are ignored."""
    fields_by_key: dict[str, Sequence[str]] = {}
    channels: list[Channel] = []
    rates_Hz: list[float] = []
    limits: dict[str, float] = {}
    facts: dict[str, str] = {}
    for line in lines:
        key, fields = line[0], line[1:]
        if len(fields) < _FIELD_COUNTS.get(key, 1):
            raise _error(f"the line {','.join(line)!r} has too few fields")
        if not all(text.isprintable() for text in line):
            raise _error(f"the line {','.join(line)!r} has non-printable characters")
        if key == "channel":
            try:
                channels.append(Channel(fields[0], fields[1]))
            except InputError as error:
                raise _error(str(error)) from error
            rates_Hz.append(_parse_number(f"rate of {fields[0]}", fields[2], 0.0, 1e6))
        elif key == "limit":
            # Plate limits may be 0: a stage may reach its zero or have no lateral travel.
            low = 0.0 if fields[0].startswith("plate_") else 1e-9
            limits[fields[0]] = _parse_number(f"limit {fields[0]}", fields[1], low, 1e9)
        elif key == "fact":
            facts[fields[0]] = fields[1]
        else:
            fields_by_key[key] = fields
    _check_lines(fields_by_key, channels)
    values: dict[str, Any] = {
        "device_id": _parse_text("device", fields_by_key["device"][0]),
        "firmware": _parse_text("firmware", fields_by_key["firmware"][0]),
    }
    for key, (name, kind, low, high, default) in _NUMBERS.items():
        text = fields_by_key[key][0] if key in fields_by_key else default
        values[name] = kind(_parse_number(key, text, low, high, is_whole=kind is not float))
    values["watchdog_s"] /= 1000.0
    stop_us = _parse_number("stop pulse", fields_by_key["pwm"][0], 0.0, 20e3)
    return Hello(
        pwm_stop_us=stop_us,
        pwm_idle_us=_parse_number("idle pulse", fields_by_key["pwm"][1], stop_us, 20e3),
        channels=tuple(channels),
        channel_rates_Hz=tuple(rates_Hz),
        limits=limits,
        facts=facts,
        **values,
    )


def _check_lines(fields_by_key: Mapping[str, Sequence[str]], channels: Sequence[Channel]) -> None:
    """Raise for another version, missing lines, and duplicate channels."""
    _check_version(fields_by_key.get("protocol", ("none",))[0])
    keys = {*fields_by_key, *(("channel",) if channels else ())}
    if missing := [key for key in _REQUIRED if key not in keys]:
        raise _error(f"line {missing[0]!r} is missing; required: {', '.join(_REQUIRED)}")
    names = [channel.name for channel in channels]
    if duplicates := {name for name in names if names.count(name) > 1}:
        raise _error(f"channel {min(duplicates)!r} is duplicated")


def _check_version(version: str) -> None:
    if version != str(PROTOCOL_VERSION):
        raise ProtocolError(
            f"the device speaks protocol version {version[:20]}, this program version "
            f"{PROTOCOL_VERSION}; update the older of the two"
        )


def _parse_text(key: str, text: str) -> str:
    if not 0 < len(text) <= _MAX_LENGTH:
        raise _error(f"{key} is {text[:20]!r}, not a text of 1 to {_MAX_LENGTH} characters")
    return text


def _parse_number(key: str, text: str, low: float, high: float, is_whole: bool = False) -> float:
    try:
        value = float(text)
    except ValueError:
        value = nan
    if not low <= value <= high:
        raise _error(f"{key} is {text[:20]!r}, not a number from {low:g} to {high:g}")
    if is_whole and value != int(value):
        raise _error(f"{key} is {text[:20]!r}, not a whole number")
    return value


def _error(problem: str) -> ProtocolError:
    return ProtocolError(f"the device's hello is invalid: {problem}; update its firmware")


MAX_HELLO_LINES = 256  # further lines are ignored; a bench with 64 rotors sends about 220


class HelloReader:
    """Assembly of a hello from its lines.

    Each line has its index, and the acknowledgement has the count and a CRC over all lines, so a
    lost line may arrive with a later attempt.
    """

    def __init__(self) -> None:
        self._indexed: dict[int, Fields] = {}

    def take(self, line: Fields) -> None:
        """Store the fields of one line; raise for a version without line indices."""
        if line and line[0].isdecimal():
            if int(line[0]) < MAX_HELLO_LINES and len(line) > 1:
                self._indexed[int(line[0])] = line
        elif line[:1] == ("protocol",):
            _check_version("".join(line[1:2]))

    def hello(self, answer: Sequence[str]) -> Hello | None:
        """Return the complete hello, or None if it must be requested again.

        `answer` is the fields of the acknowledgement after the device time.

        Raises:
            ProtocolError: the hello is complete, but invalid.
        """
        lines = [line for _, line in sorted(self._indexed.items())]
        if len(answer) < 2 or answer[0] != str(len(lines)):
            return None
        checksum = crc16(b"".join(build_payload("H", line) + b"\n" for line in lines))
        if answer[1] != f"{checksum:04X}":
            self._indexed.clear()
            return None
        return parse_hello(line[1:] for line in lines)


def max_rate_Hz(frame_bytes: int, baud: int) -> float:
    """Return the highest stream rate for frames of that length, in frames per second."""
    return baud / (BITS_PER_BYTE * frame_bytes)


def check_rate(rate_Hz: float, frame_bytes: int, baud: int) -> None:
    """Raise with the calculation if a stream exceeds the line's rate; 0 baud has no limit."""
    if rate_Hz < 0.0 or rate_Hz != rate_Hz:
        raise InputError(f"stream rate {rate_Hz:g} Hz is out of range; allowed: 0 or more")
    required_baud = rate_Hz * frame_bytes * BITS_PER_BYTE
    if baud and required_baud > baud:
        raise InputError(
            f"{rate_Hz:g} frames/s x {frame_bytes} bytes x {BITS_PER_BYTE} bits = "
            f"{required_baud:,.0f} baud, but the link has {baud:,} baud; request at most "
            f"{int(max_rate_Hz(frame_bytes, baud))} Hz or raise baud on both ends"
        )
