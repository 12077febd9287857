"""What around a serial port may keep it from working, probed once: the only impure part."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

from benchtool.bench.doctor.ports import Port, serial_ports
from benchtool.bench.transport.transport import Holder, holders

UDEV_RULE = Path("/etc/udev/rules.d/60-benchtool.rules")

_USB_SERIAL = Path("/sys/bus/usb-serial/devices")

_TTY = Path("/sys/class/tty")


@dataclass(frozen=True, slots=True, kw_only=True)
class HostEnvironment:
    """Hold what was found; None wherever this platform does not say.

    Attributes:
        system: "Linux", "Darwin" or "Windows".
        port: as the user named it, empty when no port was named.
        is_terminal: whether it is a pseudo-terminal, which no hardware question concerns.
        may_open: whether this user may read and write it.
        group: that owns the port.
        groups_on_file: that the user would have after logging in again.
        holders: processes that have the port open.
        programs: names of all running programs, lower case.
        latency_ms: of an FTDI adapter.
        rule_installed: whether benchtool's udev rule is.
        on_battery: whether the computer runs on its battery.
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
    driver: str | None = None
    latency_ms: int | None = None
    rule_installed: bool | None = None
    on_battery: bool | None = None

    @property
    def hardware(self) -> Port | None:
        """The named port as the system lists it, None when it does not."""
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
        driver=_driver(short) if linux and port else None,
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


def _driver(short: str) -> str | None:
    link = _TTY / short / "device" / "driver"
    return os.path.basename(os.path.realpath(link)) if os.path.exists(link) else None


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
