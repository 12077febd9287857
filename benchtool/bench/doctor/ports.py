"""Serial ports: which there are, and what answers on them."""

from __future__ import annotations

import os
import platform
import re
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import psutil

from benchtool.bench.serial.conversation import Conversation
from benchtool.bench.transport.transport import Holder, Transport, holders
from benchtool.core.counted import counted
from benchtool.core.errors import NoDevice, PortBusy, PortDenied, ProtocolError

BY_ID = Path("/dev/serial/by-id")


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """Describe one serial port.

    Attributes:
        vendor, product: USB numbers, None for a port that is not on USB.
        by_id: a name that stays the same after a replug, empty where there is none (Linux only).
    """

    name: str
    description: str = ""
    serial_number: str = ""
    vendor: int | None = None
    product: int | None = None
    by_id: str = ""

    @property
    def usb(self) -> str:
        if self.vendor is None or self.product is None:
            return ""
        return f"{self.vendor:04x}:{self.product:04x}"


@dataclass(frozen=True, slots=True)
class PortAnswer:
    """Say what answered a hello on a port."""

    kind: Literal["bench", "other", "silent", "busy", "denied"]
    text: str


def serial_ports() -> tuple[Port, ...]:
    """Return the serial ports behind which there is hardware, in natural order."""
    from serial.tools import list_ports

    names = by_id_names()
    found = [
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
    return tuple(sorted(found, key=lambda port: _natural(port.name)))


def by_id_names(folder: Path = BY_ID) -> dict[str, str]:
    """Return the lasting name of each port by the port it leads to now."""
    if not folder.is_dir():
        return {}
    return {os.path.realpath(link): str(link) for link in sorted(folder.iterdir())}


def identify_port(
    transport: Transport, name: str, clock: Callable[[], float] = time.monotonic
) -> PortAnswer:
    """Open a port and ask who is there; opening resets many boards, and motors stay untouched."""
    talk = Conversation(transport, f"serial:{name}", clock)
    try:
        hello = talk.open()
    except PortBusy as error:
        return PortAnswer("busy", str(error))
    except PortDenied as error:
        return PortAnswer("denied", str(error))
    except NoDevice as error:
        return PortAnswer("silent", str(error))
    except ProtocolError as error:
        return PortAnswer("other", str(error))
    finally:
        talk.close()
    rotors = counted(hello.n_rotors, "rotor")
    virtual = ", virtual" if hello.simulated else ""
    return PortAnswer("bench", f"{hello.device_id}, {hello.firmware}, {rotors}{virtual}")


def _natural(name: str) -> list[str | int]:
    """Sort COM9 before COM10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


UDEV_RULE = Path("/etc/udev/rules.d/60-benchtool.rules")

_USB_SERIAL = Path("/sys/bus/usb-serial/devices")


@dataclass(frozen=True, slots=True, kw_only=True)
class HostEnvironment:
    """Hold what was found; None wherever this platform does not say.

    Attributes:
        system: "Linux", "Darwin" or "Windows".
        port: as the user named it, empty when no port was named.
        is_terminal: whether it is a pseudo-terminal, which no hardware question concerns.
        may_open: whether this user may read and write it.
        groups_on_file: that the user would have after logging in again.
        programs: names of all running programs, lower case.
    """

    system: str
    port: str = ""
    ports: tuple[Port, ...] = ()
    exists: bool | None = None
    is_terminal: bool = False
    may_open: bool | None = None
    group: str | None = None
    user: str = ""
    groups: frozenset[str] = frozenset()
    groups_on_file: frozenset[str] = frozenset()
    holders: tuple[Holder, ...] | None = None
    programs: frozenset[str] | None = None
    latency_ms: int | None = None
    rule_installed: bool | None = None
    on_battery: bool | None = None

    @property
    def hardware(self) -> Port | None:
        real = os.path.realpath(self.port) if self.system == "Linux" else self.port
        short = real.removeprefix("\\\\.\\").upper() if self.system == "Windows" else real
        listed = {
            port.name.upper() if self.system == "Windows" else port.name: port
            for port in self.ports
        }
        return listed.get(short)


def probe_environment(port: str = "") -> HostEnvironment:
    """Return what surrounds a port, or the computer's ports when none is named."""
    system = platform.system()
    linux = system == "Linux"
    group, user, groups, on_file = _names(port) if os.name == "posix" else (None, "", (), ())
    there = os.path.exists(port) if port and os.name == "posix" else None
    short = os.path.basename(os.path.realpath(port)) if port else ""
    return HostEnvironment(
        system=system,
        port=port,
        ports=serial_ports(),
        exists=there,
        is_terminal=linux and os.path.realpath(port).startswith("/dev/pts/") if port else False,
        may_open=os.access(port, os.R_OK | os.W_OK) if there else None,
        group=group,
        user=user,
        groups=frozenset(groups),
        groups_on_file=frozenset(on_file),
        holders=holders(port) if linux and there else None,
        programs=_programs(),
        latency_ms=_number(_USB_SERIAL / short / "latency_timer") if linux and port else None,
        rule_installed=UDEV_RULE.exists() if linux else None,
        on_battery=_on_battery(),
    )


def _names(port: str) -> tuple[str | None, str, Iterable[str], Iterable[str]]:
    import grp
    import pwd

    def group_name(number: int) -> str:
        try:
            return grp.getgrgid(number).gr_name
        except KeyError:
            return str(number)

    owner = None
    with suppress(OSError):
        owner = group_name(os.stat(port).st_gid) if port else None
    try:
        user = pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        user = str(os.geteuid())
    session = {group_name(number) for number in {*os.getgroups(), os.getegid()}}
    on_file = {entry.gr_name for entry in grp.getgrall() if user in entry.gr_mem}
    return owner, user, session, on_file


def _programs() -> frozenset[str]:
    names = (process.info["name"] for process in psutil.process_iter(["name"]))
    return frozenset(name.lower() for name in names if name)


def _number(path: Path) -> int | None:
    try:
        return int(path.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def _on_battery() -> bool | None:
    try:
        battery = psutil.sensors_battery()
    except (AttributeError, OSError, RuntimeError):
        return None
    return None if battery is None or battery.power_plugged is None else not battery.power_plugged
