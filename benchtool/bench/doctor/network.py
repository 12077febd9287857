"""What keeps a network address from working: ports that are taken, hosts that are not found."""

from __future__ import annotations

import errno
import socket

from benchtool.bench.doctor.causes import PortFinding, State
from benchtool.bench.drivers import DRIVERS, Endpoint, ends_of, parse_address
from benchtool.core.errors import InputError

CONNECT_S = 2.0


def serial_port_of(text: str) -> str | None:
    """Return the serial port that a port's name or an address names, None for a network address.

    Raises:
        InputError: an address without a port to look at, or one that cannot be read.
    """
    if text.partition(":")[0] not in DRIVERS:
        return text.partition("?")[0]
    ends = ends_of(parse_address(text))
    if not ends:
        raise InputError(
            f"{text!r} has no port to look at; name a serial port or a network address"
        )
    return ends[0].place if ends[0].kind == "serial" else None


def network_findings(text: str) -> tuple[PortFinding, ...]:
    """Return what was found for each end of a network address.

    Raises:
        InputError: the address cannot be read.
    """
    ends = ends_of(parse_address(text))
    names = ("listening" if end.kind == "listens" else "other end" for end in ends)
    return tuple(PortFinding(name, *_state(end)) for name, end in zip(names, ends, strict=True))


def _state(end: Endpoint) -> State:
    where = f"{end.place}:{end.port}" if end.place else f"port {end.port}"
    try:
        if end.kind == "listens":
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind((end.place, end.port))
            return "ok", f"UDP {where} is free", ""
        address = socket.gethostbyname(end.place)
        if end.kind == "sends":
            said = f"whether anybody listens on UDP {where} shows only when it answers"
            return "not checked", said, "name the address to benchtool bench check"
        socket.create_connection((address, end.port), CONNECT_S).close()
        return "ok", f"something listens at TCP {where}", ""
    except (OSError, OverflowError, UnicodeError) as error:
        said, fix = _problem(end, where, error)
        return "problem", said, fix


def _problem(end: Endpoint, where: str, error: Exception) -> tuple[str, str]:
    if end.kind == "listens":
        if getattr(error, "errno", None) == errno.EADDRINUSE:
            said = f"another program listens on UDP {where} (a ground station, another run?)"
            return said, "end it, or choose another port at both ends"
        said = f"this computer cannot listen on UDP {where} ({error})"
        return said, "listen on 127.0.0.1 or on an address of this computer"
    if isinstance(error, socket.gaierror | UnicodeError):
        return f"the host {end.place!r} is not known", "correct its name"
    said = f"nobody answers at TCP {where} ({error})"
    return said, "start the bench there, or correct the address"
