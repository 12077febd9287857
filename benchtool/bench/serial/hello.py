"""A device's description of itself: as a value, as text lines."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan
from typing import Any

from benchtool.bench.bench import DeviceInfo
from benchtool.bench.serial.commands import PROTOCOL_VERSION
from benchtool.bench.serial.frames import MAX_LINE_BYTES, crc16, parse_frame
from benchtool.bench.transport.transport import BITS_PER_BYTE
from benchtool.core.channel import Channel
from benchtool.core.errors import InputError, ProtocolError

Fields = tuple[str, ...]

UNLIMITED_BAUD = 0  # The baud rate of a link that has none: USB CDC, TCP, a pseudo-terminal
MAX_SPEED = 1000.0  # Fastest virtual bench


@dataclass(frozen=True, slots=True, kw_only=True)
class Hello(DeviceInfo):
    """Say who the device is and what it streams; `rate_Hz` is the stream rate that it proposes.

    Attributes:
        watchdog_s: the motors stop after so long without a valid line, wall time.
        frame_bytes: longest sample frame, for the arithmetic of rate against baud.
        baud: what the device's serial port runs at, 0 where the link has no baud rate.
    """

    address: str = ""
    protocol: str = ""
    pwm_stop_us: float
    pwm_idle_us: float
    moves_plate: bool = True
    simulated: bool = False
    frame_bytes: int = 128
    baud: int = UNLIMITED_BAUD
    version: int = PROTOCOL_VERSION

    def __post_init__(self) -> None:
        object.__setattr__(self, "channel_hash", channel_hash(self.channels))

    def identity(self, address: str, rate_Hz: float) -> DeviceInfo:
        """Return the identity of a bench that was opened at `address`."""
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
            orders_protected=True,
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
    """Return the hello as lines of fields, in the order in which they are sent."""
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


_NEEDED = ("protocol", "device", "firmware", "rotors", "pwm", "rate", "channel")

_COUNTS = {"channel": 3, "limit": 2, "fact": 2, "pwm": 2}

_LONGEST_TEXT = 100


def parse_hello(lines: Iterable[Sequence[str]]) -> Hello:
    """Read a hello from its lines; unknown keys are skipped: later versions may add some."""
    single: dict[str, Sequence[str]] = {}
    channels: list[Channel] = []
    rates_Hz: list[float] = []
    limits: dict[str, float] = {}
    facts: dict[str, str] = {}
    for line in lines:
        key, fields = line[0], line[1:]
        if len(fields) < _COUNTS.get(key, 1):
            raise _wrong(f"the line {','.join(line)!r} has too few fields")
        if not all(text.isprintable() for text in line):
            raise _wrong(f"the line {','.join(line)!r} holds what cannot be printed")
        if key == "channel":
            try:
                channels.append(Channel(fields[0], fields[1]))
            except InputError as error:
                raise _wrong(str(error)) from error
            rates_Hz.append(_number(f"rate of {fields[0]}", fields[2], 0.0, 1e6))
        elif key == "limit":
            # A stage may reach its zero and have no room sideways; no other limit can be 0.
            low = 0.0 if fields[0].startswith("plate_") else 1e-9
            limits[fields[0]] = _number(f"limit {fields[0]}", fields[1], low, 1e9)
        elif key == "fact":
            facts[fields[0]] = fields[1]
        else:
            single[key] = fields
    _check(single, channels)
    read: dict[str, Any] = {
        "device_id": _text("device", single["device"][0]),
        "firmware": _text("firmware", single["firmware"][0]),
    }
    for key, (name, kind, low, high, usual) in _NUMBERS.items():
        text = single[key][0] if key in single else usual
        read[name] = kind(_number(key, text, low, high, whole=kind is not float))
    read["watchdog_s"] /= 1000.0
    stop_us = _number("stop pulse", single["pwm"][0], 0.0, 20e3)
    return Hello(
        pwm_stop_us=stop_us,
        pwm_idle_us=_number("idle pulse", single["pwm"][1], stop_us, 20e3),
        channels=tuple(channels),
        channel_rates_Hz=tuple(rates_Hz),
        limits=limits,
        facts=facts,
        **read,
    )


def _check(single: Mapping[str, Sequence[str]], channels: Sequence[Channel]) -> None:
    """Refuse another version, lines that are missing, and channels that come twice."""
    _check_version(single.get("protocol", ("none",))[0])
    found = {*single, *(("channel",) if channels else ())}
    if missing := [key for key in _NEEDED if key not in found]:
        raise _wrong(f"it has no line {missing[0]!r}; it needs: {', '.join(_NEEDED)}")
    names = [channel.name for channel in channels]
    if twice := {name for name in names if names.count(name) > 1}:
        raise _wrong(f"channel {min(twice)!r} comes twice")


def _check_version(spoken: str) -> None:
    if spoken != str(PROTOCOL_VERSION):
        raise ProtocolError(
            f"the device speaks protocol version {spoken[:20]}, this program version "
            f"{PROTOCOL_VERSION}; update the older of the two"
        )


def _text(key: str, text: str) -> str:
    if not 0 < len(text) <= _LONGEST_TEXT:
        raise _wrong(f"{key} is {text[:20]!r}, not a text of 1 to {_LONGEST_TEXT} characters")
    return text


def _number(key: str, text: str, low: float, high: float, whole: bool = False) -> float:
    try:
        value = float(text)
    except ValueError:
        value = nan
    if not low <= value <= high:
        raise _wrong(f"{key} is {text[:20]!r}, not a number from {low:g} to {high:g}")
    if whole and value != int(value):
        raise _wrong(f"{key} is {text[:20]!r}, not a whole number")
    return value


def _wrong(what: str) -> ProtocolError:
    return ProtocolError(f"the device's hello makes no sense: {what}; update its firmware")


MAX_HELLO_LINES = 256  # More are not stored; a bench with 64 rotors says about 220


class HelloReader:
    """Put a hello together from its lines.

    Each line has its index, and the answer the count and a CRC over all lines: what was lost may
    come with a later try.
    """

    def __init__(self) -> None:
        self._indexed: dict[int, Fields] = {}

    def take(self, line: Fields) -> None:
        """Take the fields of one line; refuse a version that has lines without an index."""
        if line and line[0].isdecimal():
            if int(line[0]) < MAX_HELLO_LINES and len(line) > 1:
                self._indexed[int(line[0])] = line
        elif line[:1] == ("protocol",):
            _check_version("".join(line[1:2]))

    def hello(self, answer: Sequence[str]) -> Hello | None:
        """Return the hello when it is whole, None when it must be requested again.

        Args:
            answer: what the answer carries beyond the device time.

        Raises:
            ProtocolError: it is whole, and it makes no sense.
        """
        lines = [line for _, line in sorted(self._indexed.items())]
        if len(answer) < 2 or answer[0] != str(len(lines)):
            return None
        own = crc16(b"".join(parse_frame("H", line) + b"\n" for line in lines))
        if answer[1] != f"{own:04X}":
            self._indexed.clear()
            return None
        return parse_hello(line[1:] for line in lines)


def max_rate_Hz(frame_bytes: int, baud: int) -> float:
    """Return the fastest stream of frames of that length, in frames per second."""
    return baud / (BITS_PER_BYTE * frame_bytes)


def check_rate(rate_Hz: float, frame_bytes: int, baud: int) -> None:
    """Refuse a stream that does not fit the line, with the arithmetic; 0 baud has no limit."""
    if rate_Hz < 0.0 or rate_Hz != rate_Hz:
        raise InputError(f"a stream rate of {rate_Hz:g} Hz makes no sense; give 0 or more")
    needed = rate_Hz * frame_bytes * BITS_PER_BYTE
    if baud and needed > baud:
        raise InputError(
            f"{rate_Hz:g} frames/s x {frame_bytes} bytes x {BITS_PER_BYTE} bits = {needed:,.0f} "
            f"baud, but the link runs at {baud:,} baud; ask for at most "
            f"{int(max_rate_Hz(frame_bytes, baud))} Hz or raise baud on both ends"
        )
