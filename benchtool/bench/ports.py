"""Serial ports of this computer: list, identification by hello, and diagnosis of causes."""

from __future__ import annotations

import os
import platform
import re
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

from benchtool.bench.drivers import DRIVERS, build_transport, parse_address
from benchtool.bench.serial.command_channel import CommandChannel
from benchtool.bench.transport.ports import SerialPort, TcpSocket, UdpSocket
from benchtool.bench.transport.transport import PortOwner, Transport, port_owners
from benchtool.core.errors import (
    BenchError,
    LinkError,
    NoDevice,
    PortBusy,
    PortDenied,
    ProtocolError,
)
from benchtool.core.text import pluralize

BY_ID = Path("/dev/serial/by-id")


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """Serial port."""

    name: str
    description: str = ""
    serial_number: str = ""
    # vendor, product: uSB numbers; None for a port that is not on USB
    vendor: int | None = None
    product: int | None = None
    by_id: str = ""  # name that stays the same after a replug; empty if there is none (Linux only)

    @property
    def usb(self) -> str:
        if self.vendor is None or self.product is None:
            return ""
        return f"{self.vendor:04x}:{self.product:04x}"


AnswerKind = Literal["bench", "other", "silent", "busy", "denied"]


class PortAnswer(NamedTuple):
    """Answer to a hello on a port."""

    kind: AnswerKind
    text: str


_ANSWER_KINDS: dict[type[BenchError], AnswerKind] = {
    PortBusy: "busy", PortDenied: "denied", NoDevice: "silent", ProtocolError: "other",
}  # fmt: skip


def serial_ports() -> tuple[Port, ...]:
    """Return the serial ports with hardware, in natural order."""
    from serial.tools import list_ports

    links = sorted(BY_ID.iterdir()) if BY_ID.is_dir() else ()
    names = {os.path.realpath(link): str(link) for link in links}
    ports = [
        Port(
            name=item.device,
            description=item.description if item.description != "n/a" else "",
            serial_number=item.serial_number or "",
            vendor=item.vid,
            product=item.pid,
            by_id=names.get(os.path.realpath(item.device), ""),
        )
        for item in list_ports.comports()
        if item.hwid != "n/a" or item.vid is not None
    ]
    # COM9 before COM10.
    parts = {port: re.split(r"(\d+)", port.name) for port in ports}
    return tuple(
        sorted(ports, key=lambda port: [int(p) if p.isdigit() else p for p in parts[port]])
    )


def identify_port(
    transport: Transport, name: str, clock: Callable[[], float] = time.monotonic
) -> PortAnswer:
    """Open a port and request a hello; opening resets many boards, no motor turns."""
    channel = CommandChannel(transport, f"serial:{name}", clock)
    try:
        hello = channel.open()
    except tuple(_ANSWER_KINDS) as error:
        return PortAnswer(_ANSWER_KINDS[type(error)], str(error))
    finally:
        channel.close()
    rotors = pluralize(hello.n_rotors, "rotor")
    virtual = ", virtual" if hello.simulated else ""
    return PortAnswer("bench", f"{hello.device_id}, {hello.firmware}, {rotors}{virtual}")


@dataclass(frozen=True, slots=True, kw_only=True)
class HostEnvironment:
    """Facts about a port and its user; None if the platform does not report them."""

    system: str  # "Linux", "Darwin" or "Windows"
    port: str = ""  # as typed by the user; empty if none was given
    ports: tuple[Port, ...] = ()
    exists: bool | None = None
    can_open: bool | None = None  # this user has read and write permission
    group: str | None = None
    user: str = ""
    groups: frozenset[str] = frozenset()
    groups_on_file: frozenset[str] = frozenset()  # groups that the user has after the next login
    owners: tuple[PortOwner, ...] | None = None

    @property
    def is_listed(self) -> bool:
        real_path = os.path.realpath(self.port) if self.system == "Linux" else self.port
        if self.system == "Windows":
            return real_path.removeprefix("\\\\.\\").upper() in [
                port.name.upper() for port in self.ports
            ]
        return real_path in [port.name for port in self.ports]


def probe_environment(port: str = "") -> HostEnvironment:
    """Return the facts about a port, or about all ports of the computer if it is empty."""
    system = platform.system()
    exists = os.path.exists(port) if port and os.name == "posix" else None
    return HostEnvironment(
        system=system,
        port=port,
        ports=serial_ports(),
        exists=exists,
        can_open=os.access(port, os.R_OK | os.W_OK) if exists else None,
        owners=port_owners(port) if system == "Linux" and exists else None,
        **(_read_groups(port) if os.name == "posix" else {}),
    )


def _read_groups(port: str) -> dict[str, Any]:
    """Return the fields of a `HostEnvironment` about the user and the groups."""
    import grp
    import pwd

    def group_name(number: int) -> str:
        try:
            return grp.getgrgid(number).gr_name
        except KeyError:
            return str(number)

    group = None
    with suppress(OSError):
        group = group_name(os.stat(port).st_gid) if port else None
    try:
        user = pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        user = str(os.geteuid())
    groups = frozenset(group_name(number) for number in {*os.getgroups(), os.getegid()})
    on_file = frozenset(entry.gr_name for entry in grp.getgrall() if user in entry.gr_mem)
    return {"group": group, "user": user, "groups": groups, "groups_on_file": on_file}


class PortFinding(NamedTuple):
    """Result for one possible cause, with its remedy."""

    name: str
    verdict: Literal["ok", "problem", "not checked"]
    sentence: str
    fix: str = ""


def diagnose_port(host: HostEnvironment) -> tuple[PortFinding, ...]:
    """Return the result for each cause that concerns the port."""
    causes = (_find_presence(host), _find_permission(host), _find_other_users(host))
    return tuple(finding for finding in causes if finding is not None)


def _find_presence(host: HostEnvironment) -> PortFinding:
    listed = ", ".join(port.name for port in host.ports)
    if not host.port:
        if listed:
            return PortFinding("port", "ok", f"this computer has {listed}", "use one of them")
        fix = (
            "connect the bench; some USB cables only charge; `benchtool bench serve` makes a "
            "virtual bench"
        )
        return PortFinding("port", "problem", "this computer has no serial port", fix)
    if host.system == "Darwin" and host.port.startswith("/dev/tty."):
        sentence = f"{host.port} waits for a carrier signal that benches do not send"
        fix = f"use {host.port.replace('/dev/tty.', '/dev/cu.')}"
        return PortFinding("port", "problem", sentence, fix)
    if host.exists or host.is_listed:
        return PortFinding("port", "ok", f"{host.port} is present")
    fix = "connect it; after a replug the number may have changed"
    sentence = f"{host.port} is not present; present: {listed or 'none'}"
    return PortFinding("port", "problem", sentence, fix)


def _find_permission(host: HostEnvironment) -> PortFinding | None:
    name = "permission"
    if host.system == "Windows":
        return PortFinding(name, "not checked", "Windows lets every user open a free port")
    if not host.port or not host.exists:
        return None
    if host.can_open:
        return PortFinding(name, "ok", f"{host.user} may open {host.port}")
    group = host.group or "dialout"
    if group in host.groups_on_file and group not in host.groups:
        sentence = f"{host.user} was added to group {group}, but this session began before"
        return PortFinding(name, "problem", sentence, "log out and in again")
    sentence = f"{host.user} may not open {host.port}, which belongs to group {group}"
    fix = f"sudo usermod -aG {group} {host.user}, then log out and in again"
    return PortFinding(name, "problem", sentence, fix)


def _find_other_users(host: HostEnvironment) -> PortFinding | None:
    name = "other users"
    if not host.port:
        return None
    if host.owners is None:
        sentence = f"{host.system} does not report which program has a port open"
        fix = "close terminal programs, the Arduino serial monitor, slicers"
        return PortFinding(name, "not checked", sentence, fix)
    listed = " and ".join(f"{holder.name} (pid {holder.pid})" for holder in host.owners)
    if len(host.owners) == 1 and host.owners[0].is_terminal:
        return PortFinding(name, "ok", f"the virtual bench behind it is {listed}")
    if host.owners:
        sentence = f"{host.port} is open in {listed}"
        return PortFinding(name, "problem", sentence, "end that program")
    return PortFinding(name, "ok", "no program of this user has it open")


def diagnose_address(text: str) -> tuple[PortFinding, ...]:
    """Return the result for each cause that concerns a serial port or the link of an address."""
    if text.partition(":")[0] not in DRIVERS:
        return diagnose_port(probe_environment(text.partition("?")[0]))
    link = build_transport(parse_address(text))
    if isinstance(link, SerialPort):
        return diagnose_port(probe_environment(link.port))
    assert isinstance(link, TcpSocket | UdpSocket)
    listens = isinstance(link, UdpSocket) and link.listens
    name = "listening" if listens else "other end"
    try:
        link.open()
    except LinkError as error:
        return (PortFinding(name, "problem", str(error)),)
    finally:
        link.close()
    if isinstance(link, UdpSocket) and not listens:
        sentence = f"a listener on {link.where} cannot be detected before it replies"
        return (PortFinding(name, "not checked", sentence, "run benchtool bench check"),)
    state = "is free" if listens else "accepts connections"
    return (PortFinding(name, "ok", f"{link.where} {state}"),)
