"""What keeps a network address from working: ports that are taken, hosts that are not found."""

from __future__ import annotations

import errno
import socket
from dataclasses import dataclass
from typing import Literal

from benchtool.bench.address import Address
from benchtool.bench.doctor.causes import Finding
from benchtool.bench.drivers import SCHEMES, parse_address
from benchtool.bench.mavlink.settings import transport_of
from benchtool.bench.rcbenchmark.link import rcb_settings_of
from benchtool.bench.transport.serial_port import SerialPort
from benchtool.bench.transport.sockets import TcpSocket, UdpSocket
from benchtool.core.errors import InputError

CONNECT_S = 2.0


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Name one end of a link.

    Attributes:
        kind: "listens" (a UDP port of ours), "sends" (a UDP port of theirs), "connects" (TCP).
    """

    kind: Literal["listens", "sends", "connects"]
    host: str
    port: int


def serial_port_of(text: str) -> str | None:
    """Return the serial port that a port's name or an address names, None for a network address.

    Raises:
        InputError: an address without a port to look at, or one that cannot be read.
    """
    scheme = text.partition(":")[0]
    if scheme not in SCHEMES:
        return text.partition("?")[0]
    parsed = parse_address(text)
    if scheme == "serial":
        return parsed.place
    if scheme == "mavlink":
        port = transport_of(parsed)
        return port.port if isinstance(port, SerialPort) else None
    if scheme in ("tcp", "rcbudp"):
        return None
    raise InputError(f"{text!r} has no port to look at; name a serial port or a network address")


def network_findings(text: str) -> tuple[Finding, ...]:
    """Return what was found for each end of a network address.

    Raises:
        InputError: the address cannot be read.
    """
    return tuple(_look_at(place) for place in _places(parse_address(text)))


def _places(address: Address) -> tuple[Endpoint, ...]:
    if address.scheme == "rcbudp":
        settings = rcb_settings_of(address)
        ours = Endpoint("listens", "", settings.listen)
        return (ours, Endpoint("sends", settings.host, settings.port))
    if address.scheme == "mavlink":
        link = transport_of(address)
        if isinstance(link, UdpSocket):
            kind: Literal["listens", "sends"] = "listens" if link.listens else "sends"
            return (Endpoint(kind, link.host, link.port),)
        assert isinstance(link, TcpSocket)
        return (Endpoint("connects", link.host, link.port),)
    host, _, port = address.place.rpartition(":")
    if not host or not port.isdecimal():
        raise InputError(
            f"address {address.text!r} needs host and port; write for example tcp:127.0.0.1:5555"
        )
    return (Endpoint("connects", host.strip("[]"), int(port)),)


def _look_at(place: Endpoint) -> Finding:
    where = f"{place.host}:{place.port}" if place.host else f"port {place.port}"
    try:
        if place.kind == "listens":
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind((place.host, place.port))
            return Finding("listening", "ok", f"UDP {where} is free")
        address = socket.gethostbyname(place.host)
        if place.kind == "sends":
            return Finding(
                "other end",
                "not checked",
                f"whether anybody listens on UDP {where} shows only when it answers",
                "name the address to benchtool bench check",
            )
        socket.create_connection((address, place.port), CONNECT_S).close()
        return Finding("other end", "ok", f"something listens at TCP {where}")
    except (OSError, OverflowError, UnicodeError) as error:
        return _problem(place, where, error)


def _problem(place: Endpoint, where: str, error: Exception) -> Finding:
    if place.kind == "listens":
        if getattr(error, "errno", None) == errno.EADDRINUSE:
            return Finding(
                "listening",
                "problem",
                f"another program listens on UDP {where} (a ground station, another run?)",
                "end it, or choose another port at both ends",
            )
        return Finding(
            "listening",
            "problem",
            f"this computer cannot listen on UDP {where} ({error})",
            "listen on 127.0.0.1 or on an address of this computer",
        )
    if isinstance(error, socket.gaierror | UnicodeError):
        return Finding(
            "other end", "problem", f"the host {place.host!r} is not known", "correct its name"
        )
    return Finding(
        "other end",
        "problem",
        f"nobody answers at TCP {where} ({error})",
        "start the bench there, or correct the address",
    )
