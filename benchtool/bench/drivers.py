"""Addresses of benches, stages and served links, and the driver of each address scheme.

An address is parsed into typed values with ranges; nothing is opened and no file is read. Fields of
an `Address` with an `Input` are the options after the `?` of its text, with the declared names and
ranges.

Drivers are named by strings, so that none is imported before it is used and the simulator, in a
package above this one, can be listed. A missing port is an error: no scheme falls back to another.
"""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass, replace
from pathlib import Path
from pkgutil import resolve_name
from typing import Annotated, Any, ClassVar, Literal, Self, get_args
from urllib.parse import parse_qsl

from annotated_types import Ge, Le

from benchtool.bench.bench import Bench
from benchtool.bench.transport.ports import SerialPort, TcpSocket, UdpSocket
from benchtool.bench.transport.transport import Transport
from benchtool.core.choices import ArmedBy, BenchMode
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.inputs import Input, items
from benchtool.core.user_code import CodePermit, check_code_allowed

LOOPBACK = "127.0.0.1"
MAX_LENGTH = 1024  # characters: a path and some options; assumed
MAX_PORT = 65535
TELEMETRY_BAUD = 115_200  # default over USB; radios use 57600
DOWNWARD_ORIENTATION = 25  # MAV_SENSOR_ROTATION_PITCH_270: a distance sensor facing the plate
MIN_HZ, MAX_HZ = 10.0, 1000.0  # of outputs; a slower one shows a stop late; assumed
GROUND_STATION_PORT = 14550

Baud = Annotated[int, Ge(1200), Le(12_000_000), Input("Baud rate of the port.")]
Scale = Annotated[float, Ge(-1e6), Le(1e6), Input("Factor on thrust.", option="thrust_scale")]
Millimetres = Annotated[float, Ge(-1e5), Le(1e5), Input("Plate coordinate at machine position 0.")]
StageAxis = Literal["X", "Y", "Z"]
MavlinkKind = Literal["udpin", "udpout", "tcp", "serial"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Address:
    """Address of one scheme."""

    TITLE: ClassVar[str] = ""
    EXAMPLE: ClassVar[str] = ""
    LOCATION: ClassVar[str] = "port"
    text: str = ""  # as typed by a user or stored in data
    permit: CodePermit = check_code_allowed

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the parsed address.

        Raises:
            InputError: no location; an option that is unknown, empty, repeated or out of range.
        """
        if len(text) > MAX_LENGTH:
            raise InputError(
                f"address {text[:40]!r}... is too long: {len(text):,} characters; allowed: up to "
                f"{MAX_LENGTH:,}; example: {cls.EXAMPLE}"
            )
        scheme, _, after_scheme = text.strip().partition(":")
        # Windows device paths (\\?\...) contain a question mark before any option.
        device_prefix = after_scheme[:4] if after_scheme.startswith("\\\\?\\") else ""
        location, _, query = after_scheme[len(device_prefix) :].partition("?")
        if not device_prefix + location:
            raise InputError(f"address {text!r} is incomplete; example: {cls.EXAMPLE}")
        try:
            pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True) if query else []
        except ValueError:
            raise InputError(
                f"the options of address {text!r} cannot be parsed; write them as name=value "
                f"joined by &"
            ) from None
        if not all(map(str.isprintable, (location, *(value for _, value in pairs)))):
            raise InputError(f"address {text!r} has non-printable characters; type it again")
        options, values = {item.name: item for item in items(cls)}, dict[str, Any]()
        for name, value in pairs:
            label = f"{name} of address {text!r}"
            if name not in options:
                raise UnknownChoice(f"option of {scheme}: addresses", name, options)
            if options[name].key in values or not value.strip():
                problem = "twice" if options[name].key in values else "without a value"
                raise InputError(f"{label} is given {problem}; write {name}=VALUE once")
            values[options[name].key] = options[name].read(value, label)
        address = cls(text=text, **cls.parse_location(device_prefix + location, text), **values)
        address.check()
        return address

    @classmethod
    def parse_location(cls, location: str, text: str) -> dict[str, Any]:
        """Return the fields of the location; errors contain the whole text."""
        return {cls.LOCATION: location}

    def check(self) -> None:
        """Raise if options contradict each other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimAddress(Address):
    """Virtual bench in this process; the pitch options are empty by default."""

    EXAMPLE: ClassVar[str] = "sim:pquad?seed=3"
    LOCATION: ClassVar[str] = "rig"
    rig: str
    truth: Annotated[str, Input("Model whose thrust the load cell shows.")] = ""
    seed: Annotated[int, Ge(0), Le(2**32 - 1), Input("Seed of noise.")] = 0
    rate_Hz: Annotated[float, Ge(1.0), Le(5000.0), Input("Rate.", option="rate")] | None = None
    mode: Annotated[BenchMode, Input("A load cell, or a pitch hinge.")] = "plate"
    schedule: Annotated[str, Input("Pitch: schedule.")] = ""
    controller: Annotated[str, Input("Pitch: controller.")] = ""
    gains: Annotated[str, Input("Pitch: gain set.")] = ""
    hidden: Annotated[str, Input("Pitch: hidden truth.")] = ""

    def check(self) -> None:
        for name in ("schedule", "controller", "gains", "hidden"):
            if getattr(self, name) and self.mode != "pitch":
                raise InputError(
                    f"option {name} of address {self.text!r} is for mode=pitch; add &mode=pitch"
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialAddress(Address):
    """Bench on a serial port; the default is the rate that the protocol recommends."""

    EXAMPLE: ClassVar[str] = "serial:/dev/ttyUSB0?baud=2000000"
    port: str
    baud: Baud = 2_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class TcpAddress(Address):
    """Bench behind a TCP port."""

    EXAMPLE: ClassVar[str] = "tcp:127.0.0.1:5555"
    host: str
    port: int

    @classmethod
    def parse_location(cls, location: str, text: str) -> dict[str, Any]:
        return parse_host_and_port(location, text, cls.EXAMPLE)


@dataclass(frozen=True, slots=True, kw_only=True)
class MavlinkAddress(Address):
    """Flight controller; see `MavlinkSettings` for the options."""

    EXAMPLE: ClassVar[str] = "mavlink:udpin:127.0.0.1:14550"
    link: MavlinkKind
    host: str = ""
    port: int = 0
    serial_port: str = ""
    baud: int = TELEMETRY_BAUD
    system: Annotated[int, Ge(1), Le(255), Input("Number of the autopilot.")] | None = None
    rotors: Annotated[int, Ge(1), Le(12), Input("Number of rotors.")] | None = None
    map: Annotated[Path, Input("Map of motors.")] | None = None
    mode: Annotated[BenchMode, Input("Motor tests, or its own loop.")] = "plate"
    arm: Annotated[ArmedBy, Input("Who arms.")] = "operator"
    rate_Hz: Annotated[float, Ge(MIN_HZ), Le(MAX_HZ), Input("", option="rate")] | None = None
    key: Annotated[Path, Input("Signing key.")] | None = None
    thrust: Annotated[str, Input("Name of the thrust value.")] = "thrust"
    thrust_scale_N: Scale = 1.0
    rpm: Annotated[Literal["auto", "none"], Input("Speeds.")] = "auto"
    distance: Annotated[Literal["on", "off"], Input("Distance sensor.")] | None = None
    orientation: Annotated[int, Ge(0), Le(100), Input("Of that sensor.")] = DOWNWARD_ORIENTATION
    cell: Annotated[str, Input("Port of a load cell.")] = ""

    @classmethod
    def parse_location(cls, location: str, text: str) -> dict[str, Any]:
        kind, _, kind_location = location.partition(":")
        if kind not in get_args(MavlinkKind):
            raise UnknownChoice(f"link of address {text!r}", kind, get_args(MavlinkKind))
        if kind != "serial":
            return {"link": kind, **parse_host_and_port(kind_location, text, cls.EXAMPLE, LOOPBACK)}
        port, baud = parse_port_and_baud(kind_location, text)
        return {"link": kind, "serial_port": port, "baud": baud}

    @property
    def warning(self) -> str:
        """Warning if the address accepts data from other computers, else ""."""
        if self.link != "udpin" or is_loopback(self.host):
            return ""
        return (
            f"listening on {self.host}: any computer that reaches this one can send, and MAVLink "
            f"accepts every sender unless key= signs it; mavlink:udpin:{LOOPBACK} accepts only "
            f"this computer"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayAddress(Address):
    """Run that is replayed."""

    EXAMPLE: ClassVar[str] = "replay:runs/2026-01-31-first"
    LOCATION: ClassVar[str] = "run"
    run: str


@dataclass(frozen=True, slots=True, kw_only=True)
class GrblAddress(Address):
    """G-code stage that moves the plate."""

    EXAMPLE: ClassVar[str] = "grbl:/dev/ttyACM0?axis=Z&zero_mm=1500&direction=1"
    port: str
    baud: Baud = 115_200
    # axis, lateral: axes of the plate distance and of the lateral position, if there is one
    axis: Annotated[StageAxis, Input("Axis of the distance.")] = "Z"
    # Plate distance at machine position 0; default: the rig's parking distance
    zero_mm: Millimetres | None = None
    # +1 if the distance increases with machine position, -1 if it decreases
    direction: Annotated[int, Ge(-1), Le(1), Input("Sign.")] = 1
    lateral: Annotated[StageAxis, Input("Axis of the lateral position.")] | None = None
    lateral_zero_mm: Millimetres = 0.0

    def check(self) -> None:
        if not self.direction:
            raise InputError(f"direction of address {self.text!r} is 0; write 1 or -1")
        if self.lateral == self.axis:
            raise InputError(
                f"axis and lateral of address {self.text!r} are both {self.axis}; use two "
                f"different axes"
            )


def parse_port(digits: str, min_port: int = 1) -> int | None:
    """Return a TCP or UDP port number, or None for invalid text."""
    port = int(digits) if digits.isdecimal() and len(digits) < 10 else -1
    return port if min_port <= port <= MAX_PORT else None


def parse_host_and_port(target: str, text: str, example: str, default: str = "") -> dict[str, Any]:
    """Return host and port of `HOST:PORT`; errors contain the whole text."""
    host, _, digits = target.rpartition(":")
    host, port = host.strip("[]") or default, parse_port(digits)
    if not host or port is None:
        raise InputError(
            f"address {text!r} needs host and port, 1 to {MAX_PORT}; example: {example}"
        )
    return {"host": host, "port": port}


def parse_port_and_baud(location: str, text: str) -> tuple[str, int]:
    """Split `/dev/ttyACM0:57600`; port names of Windows and macOS contain no colon."""
    port, _, digits = location.rpartition(":")
    if not port or not digits.isdecimal():
        port, digits = location, str(TELEMETRY_BAUD)
    if not port:
        raise InputError(
            f"address {text!r} has no port; example: mavlink:serial:/dev/ttyACM0:{TELEMETRY_BAUD}"
        )
    baud = next(item for item in items(SerialAddress) if item.name == "baud")
    return port, baud.read(digits, f"baud rate of address {text!r}")


def is_loopback(host: str) -> bool:
    """Return whether a host is this computer."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def parse_stage(option: str) -> GrblAddress | str:
    """Return the value of `--stage`: `device`, `hand`, `none`, or the address of a stage."""
    if option in ("device", "hand", "none"):
        return option
    if option.partition(":")[0] != "grbl":
        raise UnknownChoice("stage", option[:60], ("device", "hand", "grbl:PORT", "none"))
    return GrblAddress.parse(option)


@dataclass(frozen=True, slots=True, kw_only=True)
class Driver:
    """Driver of one address scheme."""

    address: type[Address]
    opener: str  # "module:function" that builds an unopened bench from an address
    description: str  # in the table of addresses


DRIVERS: dict[str, Driver] = {  # by address scheme
    "sim": Driver(
        address=SimAddress,
        opener="benchtool.virtual.simulated_bench:open_simulated",
        description="virtual bench in the same process, with a virtual clock; options: "
        "`truth=FILE`, `rate=200`",
    ),
    "serial": Driver(
        address=SerialAddress,
        opener="benchtool.bench.serial.bench:open_serial",
        description="serial port, on Windows `serial:COM12`; default 2,000,000 baud",
    ),
    "tcp": Driver(
        address=TcpAddress,
        opener="benchtool.bench.serial.bench:open_serial",
        description="TCP socket",
    ),
    "mavlink": Driver(
        address=MavlinkAddress,
        opener="benchtool.bench.mavlink.bench:open_mavlink",
        description="flight controller ([ArduPilot](#ardupilot), [PX4](#px4))",
    ),
    "replay": Driver(
        address=ReplayAddress,
        opener="benchtool.bench.replay:open_replay",
        description="playback of a run; rejects every command",
    ),
}


def parse_address(text: str) -> Address:
    """Return the parsed address; no link is opened and no file is read."""
    scheme, colon, _ = text.strip().partition(":")
    if not colon:
        examples = ", ".join(driver.address.EXAMPLE for driver in DRIVERS.values())
        raise InputError(f"{text!r:.60} has no address scheme; use one of: {examples}")
    if scheme not in DRIVERS:
        raise UnknownChoice("address scheme", scheme[:60], DRIVERS)
    return DRIVERS[scheme].address.parse(text)


def open_bench(address: str, permit: CodePermit = check_code_allowed) -> Bench:
    """Return the bench of an address, not opened; enter it with `with`, or call `open()`.

    Args:
        address: as typed by a user or stored in data.
        permit: called with the file of user-defined effects in the address before the file is run;
            it must raise unless a user typed the address.
    """
    parsed_address = replace(parse_address(address), permit=permit)
    bench: Bench = resolve_name(DRIVERS[address.strip().partition(":")[0]].opener)(parsed_address)
    return bench


def build_transport(address: Address) -> Transport:
    """Return the link of an address, not opened yet."""
    match address:
        case SerialAddress():
            return SerialPort(address.port, address.baud)
        case MavlinkAddress(link="serial"):
            return SerialPort(address.serial_port, address.baud)
        case TcpAddress() | MavlinkAddress(link="tcp"):
            return TcpSocket(address.host, address.port)
        case MavlinkAddress():
            return UdpSocket(address.host, address.port, listen=address.link == "udpin")
    raise InputError(
        f"{address.text!r} has no port to check; give a serial port or a network address"
    )
