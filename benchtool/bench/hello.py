"""What a device says of itself when it is asked: the hello, as a value and as text lines."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from benchtool.bench.bench import Identity
from benchtool.bench.commands import PROTOCOL_VERSION
from benchtool.core.channel import Channel
from benchtool.errors import InputError, ProtocolError

Fields = tuple[str, ...]

UNLIMITED_BAUD = 0
"""The baud rate of a link that has none: USB CDC, TCP, a pseudo-terminal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hello:
    """Say who the device is and what it streams.

    Attributes:
        device_id: the device's own unchanging name (serial number).
        firmware: name and version in the device's words.
        n_rotors: how many motors can be commanded.
        channels: (c,) what a sample carries, in order.
        channel_rates_Hz: (c,) how often each channel has a new value.
        rate_Hz: stream rate that the device proposes.
        limits: device-side limits by name (`thrust_N`, `rpm`, `voltage_min_V` ...).
        pwm_stop_us: pulse at which the motors stand still.
        pwm_idle_us: longest pulse at which the plate may move.
        watchdog_s: the motors stop after so long without a valid line, wall time.
        moves_plate: whether the device moves the plate itself.
        simulated: True when no physical motor turns.
        frame_bytes: longest sample frame, for the arithmetic of rate against baud.
        baud: what the device's serial port runs at, 0 where the link has no baud rate.
        speed: device seconds per wall second; 1 on every physical device.
        has_loop: a control loop on the device makes the pulses once it is armed.
        facts: anything else worth keeping with a run.
        version: protocol version.
    """

    device_id: str
    firmware: str
    n_rotors: int
    channels: tuple[Channel, ...]
    channel_rates_Hz: tuple[float, ...]
    rate_Hz: float
    limits: Mapping[str, float]
    pwm_stop_us: float
    pwm_idle_us: float
    watchdog_s: float = 0.25
    moves_plate: bool = True
    simulated: bool = False
    frame_bytes: int = 128
    baud: int = UNLIMITED_BAUD
    speed: float = 1.0
    has_loop: bool = False
    facts: Mapping[str, str] = field(default_factory=dict)
    version: int = PROTOCOL_VERSION

    def identity(self, address: str, rate_Hz: float) -> Identity:
        """Return the identity of a bench that was opened at `address`."""
        facts = dict(self.facts)
        if self.speed != 1.0:
            facts["speed"] = f"{self.speed:g}"
        facts["pwm_stop_us"] = f"{self.pwm_stop_us:g}"
        facts["pwm_idle_us"] = f"{self.pwm_idle_us:g}"
        return Identity(
            address=address,
            device_id=self.device_id,
            firmware=self.firmware,
            protocol=f"benchtool-{self.version}",
            channels=self.channels,
            rate_Hz=rate_Hz,
            n_rotors=self.n_rotors,
            simulated=self.simulated,
            moves_plate=self.moves_plate,
            limits=dict(self.limits),
            watchdog_s=self.watchdog_s,
            has_loop=self.has_loop,
            pwm_idle_us=self.pwm_idle_us,
            speed=self.speed,
            facts=facts,
        )


def hello_lines(hello: Hello) -> tuple[Fields, ...]:
    """Return the hello as lines of fields, in the order in which they are sent."""
    lines: list[Fields] = [
        ("protocol", str(hello.version)),
        ("device", hello.device_id),
        ("firmware", hello.firmware),
        ("rotors", str(hello.n_rotors)),
        ("pwm", f"{hello.pwm_stop_us:g}", f"{hello.pwm_idle_us:g}"),
        ("rate", f"{hello.rate_Hz:g}"),
        ("watchdog", f"{1000.0 * hello.watchdog_s:g}"),
        ("plate", str(int(hello.moves_plate))),
        ("simulated", str(int(hello.simulated))),
        ("frame", str(hello.frame_bytes)),
        ("baud", str(hello.baud)),
        ("speed", f"{hello.speed:g}"),
    ]
    if hello.has_loop:
        lines.append(("loop", "1"))
    for channel, rate_Hz in zip(hello.channels, hello.channel_rates_Hz, strict=True):
        lines.append(("channel", channel.name, channel.unit, f"{rate_Hz:g}"))
    lines += [("limit", name, f"{value:.9g}") for name, value in hello.limits.items()]
    lines += [("fact", name, text) for name, text in hello.facts.items()]
    return tuple(lines)


_COUNTS = {"channel": 3, "limit": 2, "fact": 2, "pwm": 2}
_NEEDED = ("protocol", "device", "firmware", "rotors", "pwm", "rate", "channel")


def hello_from(lines: Iterable[Sequence[str]]) -> Hello:
    """Read a hello from its lines; unknown keys are skipped, so that later versions can add some.

    Raises:
        ProtocolError: another protocol version, a line that is missing, or one that makes no sense.
    """
    single: dict[str, Sequence[str]] = {}
    channels: list[tuple[Channel, float]] = []
    limits: dict[str, float] = {}
    facts: dict[str, str] = {}
    try:
        for line in lines:
            key, fields = line[0], line[1:]
            if len(fields) < _COUNTS.get(key, 1):
                raise ProtocolError(f"the hello line {','.join(line)!r} has too few fields")
            if key == "channel":
                channels.append((Channel(fields[0], fields[1]), float(fields[2])))
            elif key == "limit":
                limits[fields[0]] = float(fields[1])
            elif key == "fact":
                facts[fields[0]] = fields[1]
            else:
                single[key] = fields
        found = {*single, *(("channel",) if channels else ())}
        _check_version(single)
        missing = [key for key in _NEEDED if key not in found]
        if missing:
            raise ProtocolError(
                f"the device's hello has no line {missing[0]!r}; it needs: {', '.join(_NEEDED)}"
            )
        return Hello(
            version=int(single["protocol"][0]),
            device_id=single["device"][0],
            firmware=single["firmware"][0],
            n_rotors=int(single["rotors"][0]),
            pwm_stop_us=float(single["pwm"][0]),
            pwm_idle_us=float(single["pwm"][1]),
            rate_Hz=float(single["rate"][0]),
            watchdog_s=float(single.get("watchdog", ("250",))[0]) / 1000.0,
            moves_plate=single.get("plate", ("0",))[0] == "1",
            simulated=single.get("simulated", ("0",))[0] == "1",
            frame_bytes=int(single.get("frame", ("128",))[0]),
            baud=int(single.get("baud", (str(UNLIMITED_BAUD),))[0]),
            speed=float(single.get("speed", ("1",))[0]),
            has_loop=single.get("loop", ("0",))[0] == "1",
            channels=tuple(channel for channel, _ in channels),
            channel_rates_Hz=tuple(rate_Hz for _, rate_Hz in channels),
            limits=limits,
            facts=facts,
        )
    except (ValueError, InputError) as error:
        raise ProtocolError(
            f"the device's hello makes no sense: {error}; update its firmware"
        ) from (error)


def _check_version(single: Mapping[str, Sequence[str]]) -> None:
    spoken = single.get("protocol", ("none",))[0]
    if spoken != str(PROTOCOL_VERSION):
        raise ProtocolError(
            f"the device speaks protocol version {spoken}, this program version "
            f"{PROTOCOL_VERSION}; update the older of the two"
        )
