"""What a `mavlink:` address says: the link, the target, and which messages carry which channel."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from benchtool.bench.mavlink.motor_map import MotorMap, read_motor_map
from benchtool.bench.mavlink.wiring import DOWN, THRUST, ThrustSource
from benchtool.bench.transport.tcp_socket import TcpSocket
from benchtool.bench.transport.transport import Transport
from benchtool.bench.transport.udp_socket import UdpSocket
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.user_file import read_file

if TYPE_CHECKING:
    from benchtool.bench.transport.parsed_address import Address

LINKS = ("udpin", "udpout", "tcp", "serial")
EXAMPLE = "mavlink:udpin:127.0.0.1:14550"
LOOPBACK = "127.0.0.1"
DEFAULT_BAUD = 115_200
"""Usual rate of a telemetry port over USB; radios have 57600."""

KEY_BYTES = 32
MOST_KEY_BYTES = 4096
"""Longest pass phrase; a choice."""

LEAST_HZ, MOST_HZ = 10.0, 1000.0
"""Rates at which outputs are asked for: too rarely, and nobody sees soon what they do."""

RATE_HZ, PITCH_HZ = 50.0, 250.0
"""Unless told otherwise. A loop on board moves its outputs some hundred times a second; what is not
told of them turns the beam and looks like a disturbance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MavlinkSettings:
    """Say how to talk to an autopilot and what to take from it.

    Attributes:
        system: number of the autopilot; None takes the only one there is.
        rotors: how many rotors; None asks the map or the autopilot.
        motor_map: of the rig; None takes rotors for motors 1, 2, ... with outputs not known.
        mode: "plate" (motor tests under a load cell) or "pitch" (the autopilot's own loop).
        arm: whose task arming is in a pitch experiment.
        rate_Hz: of outputs and attitude.
        key: 32 bytes for MAVLink 2 signing; None signs nothing.
        thrust: message of the load cell.
        thrust_scale_N: newtons per unit of that message.
        speeds: whether speed messages are taken.
        distance: whether the distance sensor gives the plate's distance.
        orientation: of that sensor (MAV_SENSOR_ORIENTATION), others are left aside.
        cell: port and baud rate of a load cell beside the autopilot; None where there is none.
        warning: what must be said aloud before it is opened, or nothing.
    """

    system: int | None = None
    rotors: int | None = None
    motor_map: MotorMap | None = None
    mode: Literal["plate", "pitch"] = "plate"
    arm: Literal["operator", "host"] = "operator"
    rate_Hz: float = RATE_HZ
    key: bytes | None = None
    thrust: ThrustSource = THRUST
    thrust_scale_N: float = 1.0
    speeds: bool = True
    distance: bool = False
    orientation: int = DOWN
    cell: tuple[str, int] | None = None
    warning: str = ""

    @property
    def cell_name(self) -> str:
        """Port of the load cell beside the autopilot, for messages."""
        return self.cell[0] if self.cell else "its port"


def settings_of(address: Address) -> MavlinkSettings:
    """Return what the options of an address say.

    Raises:
        InputError, UnknownChoice, FileFormatError: an option that makes no sense, with its choices.
    """
    mode = _choice(address, "mode", "plate", ("plate", "pitch"))
    pitch = mode == "pitch"
    seen = _choice(address, "distance", "on" if pitch else "off", ("on", "off"))
    options = address.options
    return MavlinkSettings(
        system=address.whole("system", 1, 1, 255) if "system" in options else None,
        rotors=address.whole("rotors", 4, 1, 12) if "rotors" in options else None,
        motor_map=read_motor_map(Path(options["map"])) if "map" in options else None,
        mode="pitch" if pitch else "plate",
        arm="host" if _choice(address, "arm", "operator", ("operator", "host")) == "host"
        else "operator",
        rate_Hz=address.number("rate", PITCH_HZ if pitch else RATE_HZ, LEAST_HZ, MOST_HZ),
        key=read_key(Path(options["key"])) if "key" in options else None,
        thrust=ThrustSource.named(options.get("thrust", "thrust")),
        thrust_scale_N=address.number("thrust_scale", 1.0, -1e6, 1e6),
        speeds=_choice(address, "rpm", "auto", ("auto", "none")) == "auto",
        distance=seen == "on",
        orientation=address.whole("orientation", DOWN, 0, 100),
        cell=_port_and_baud(options["cell"]) if "cell" in options else None,
        warning=_wide(address.place),
    )  # fmt: skip


def transport_of(address: Address) -> Transport:
    """Return the link that the place of an address names, not opened yet.

    Raises:
        InputError, UnknownChoice: it names none.
    """
    kind, _, rest = address.place.partition(":")
    if kind not in LINKS:
        raise UnknownChoice(f"link of address {address.text!r}", kind, LINKS)
    if kind == "serial":
        from benchtool.bench.transport.serial_port import SerialPort

        if not rest:
            raise InputError(
                f"address {address.text!r} names no port; write for example "
                f"mavlink:serial:/dev/ttyACM0:{DEFAULT_BAUD}"
            )
        port, baud = _port_and_baud(rest)
        return SerialPort(port, baud)
    host, port_number = _host_and_port(address, rest)
    if kind == "tcp":
        return TcpSocket(host, port_number)
    return UdpSocket(host, port_number, listen=kind == "udpin")


def read_key(path: Path) -> bytes:
    """Read a signing key: 32 bytes, 64 hexadecimal digits, or a pass phrase (its SHA-256).

    Raises:
        FileFormatError: the file cannot be read.
        InputError: it is empty.
    """
    data = read_file(path, MOST_KEY_BYTES)
    if len(data) == KEY_BYTES:
        return data
    text = data.strip()
    if not text:
        raise InputError(f"the key {path} is empty; give 32 bytes, 64 hexadecimal digits or a "
                         f"pass phrase")  # fmt: skip
    if re.fullmatch(rb"[0-9A-Fa-f]{64}", text):
        return bytes.fromhex(text.decode())
    return sha256(text).digest()


def _choice(address: Address, name: str, default: str, known: tuple[str, ...]) -> str:
    given = address.options.get(name, default)
    if given not in known:
        raise UnknownChoice(f"{name} of address {address.text!r}", given, known)
    return given


def _host_and_port(address: Address, rest: str) -> tuple[str, int]:
    host, _, port = rest.rpartition(":")
    if not port.isdecimal() or not 0 < int(port) < 65536:
        raise InputError(
            f"address {address.text!r} needs host and port; write for example {EXAMPLE}"
        )
    return host.strip("[]") or LOOPBACK, int(port)


def _port_and_baud(text: str) -> tuple[str, int]:
    """Split `/dev/ttyACM0:57600`; Windows and macOS ports have no colon of their own."""
    port, _, baud = text.rpartition(":")
    return (port, int(baud)) if port and baud.isdecimal() else (text, DEFAULT_BAUD)


def _wide(place: str) -> str:
    """Return what must be said of an address that listens beyond this computer."""
    kind, _, rest = place.partition(":")
    host = rest.rpartition(":")[0] or LOOPBACK
    if kind != "udpin" or host == "localhost":
        return ""
    try:
        if ipaddress.ip_address(host).is_loopback:
            return ""
    except ValueError:
        pass
    return (
        f"listening on {host}: any computer that reaches this one can send, and MAVLink believes "
        f"whoever sends unless key= signs it; mavlink:udpin:{LOOPBACK} listens to this one alone"
    )
