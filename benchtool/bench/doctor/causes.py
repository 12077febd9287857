"""What keeps a port from working: one finding per cause, judged from a given environment. Pure."""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable
from importlib import resources
from typing import Literal, NamedTuple

from benchtool.bench.addresses import Endpoint
from benchtool.bench.doctor.ports import UDEV_RULE, HostEnvironment
from benchtool.bench.drivers import DRIVERS, parse_address
from benchtool.bench.transport.transport import Holder
from benchtool.core.errors import InputError

Verdict = Literal["ok", "warning", "problem", "not checked"]

INSTALL_RULE = (
    f"benchtool doctor --udev-rule | sudo tee {UDEV_RULE}, then sudo udevadm control --reload "
    f"and sudo udevadm trigger"
)

RESETTING: dict[int, str] = {
    0x2341: "Arduino",
    0x2A03: "Arduino",
    0x1A86: "CH340",
    0x10C4: "CP210x",
    0x0403: "FTDI",
    0x067B: "PL2303",
}
"""USB vendors whose adapters sit on boards that take DTR as reset, as the Arduino boards do."""

PROBING = {
    "modemmanager": "ModemManager talks to new serial ports to find modems",
    "brltty": "brltty takes CH340 and FTDI adapters for braille displays",
}

SLEEP_OFF = {
    "Linux": "run it as: systemd-inhibit --what=sleep:idle benchtool sweep ...",
    "Darwin": "run it as: caffeinate -is benchtool sweep ...",
    "Windows": "set sleep to never while it runs (Settings, System, Power)",
}

State = tuple[Verdict, str, str]
"""Verdict, sentence and fix of one cause."""


class PortFinding(NamedTuple):
    """Say how one thing stands; a warning may hurt, a problem does."""

    name: str
    verdict: Verdict
    sentence: str
    fix: str = ""


def findings(host: HostEnvironment) -> tuple[PortFinding, ...]:
    """Return what was found for each cause, those that do not concern the port left out."""
    states = ((name, judge(host)) for name, judge in CAUSES.items())
    return tuple(PortFinding(name, *state) for name, state in states if state is not None)


def udev_rule() -> str:
    """Return the text of the udev rule that benchtool ships."""
    return (resources.files("benchtool.bench.doctor") / UDEV_RULE.name).read_text(encoding="utf-8")


def _presence(host: HostEnvironment) -> State | None:
    if not host.port:
        if host.ports:
            listed = ", ".join(port.name for port in host.ports)
            return "ok", f"this computer has {listed}", "name one to look closer"
        fix = (
            "plug the bench in; some USB cables only charge; `benchtool bench serve` makes a "
            "virtual bench"
        )
        return "problem", "this computer has no serial port", fix
    if host.system == "Darwin" and host.port.startswith("/dev/tty."):
        fix = f"use {host.port.replace('/dev/tty.', '/dev/cu.')}"
        return "problem", f"{host.port} waits for a carrier signal that benches do not give", fix
    if host.exists or host.hardware is not None:
        return "ok", f"{host.port} is there", ""
    known = ", ".join(port.name for port in host.ports) or "none"
    fix = "plug it in; after a replug the number may have changed"
    return "problem", f"{host.port} is not there; present: {known}", fix


def _permission(host: HostEnvironment) -> State | None:
    if host.system == "Windows":
        return "not checked", "Windows lets every user open a free port", ""
    if not host.port or not host.exists:
        return None
    if host.may_open:
        return "ok", f"{host.user} may open {host.port}", ""
    group = host.group or "dialout"
    if group in host.groups_on_file and group not in host.groups:
        sentence = f"{host.user} was added to group {group}, but this session began before"
        return "problem", sentence, "log out and in again"
    fix = f"sudo usermod -aG {group} {host.user}, then log out and in again"
    if host.system == "Linux" and not host.rule_installed:
        fix += f"; or install the udev rule: {INSTALL_RULE}"
    return "problem", f"{host.user} may not open {host.port}, which belongs to group {group}", fix


def _rule(host: HostEnvironment) -> State | None:
    if host.rule_installed is None or host.is_terminal:
        return None
    if host.rule_installed:
        return "ok", f"{UDEV_RULE} is installed", ""
    sentence = "benchtool's udev rule (access, ModemManager, FTDI latency) is not installed"
    return "warning", sentence, INSTALL_RULE


def _holders(host: HostEnvironment) -> State | None:
    if not host.port:
        return None
    if host.holders is None:
        fix = "close terminal programs, the Arduino serial monitor, slicers"
        return "not checked", f"{host.system} does not report which program has a port open", fix
    if len(host.holders) == 1 and host.holders[0].is_terminal:
        return "ok", f"the virtual bench behind it is {_listed(host.holders)}", ""
    if host.holders:
        return "problem", f"{host.port} is open in {_listed(host.holders)}", "end that program"
    return "ok", "no program of this user has it open", ""


def _probing(host: HostEnvironment) -> State | None:
    if host.is_terminal:
        return None
    if host.programs is None or host.system != "Linux":
        return "not checked", f"no program is known that grabs ports on {host.system}", ""
    running = [program for program in PROBING if program in host.programs]
    if not running:
        return "ok", "neither ModemManager nor brltty runs", ""
    fixes = []
    if "modemmanager" in running and not host.rule_installed:
        fixes.append("install the udev rule, which makes ModemManager leave bench ports alone")
    if "brltty" in running:
        fixes.append("remove brltty (sudo apt remove brltty) unless braille is needed")
    sentence = "; ".join(PROBING[program] for program in running)
    return "warning" if fixes else "ok", sentence, "; ".join(fixes)


def _lasting_name(host: HostEnvironment) -> State | None:
    port = host.hardware
    if port is None or not port.usb:
        return None
    twins = [other for other in host.ports if other.usb == port.usb and other is not port]
    if not port.serial_number:
        sentence = (
            f"its USB adapter ({port.usb}) has no serial number; after a replug it cannot be known "
            f"from others"
        )
        others = ", and other adapters out" if twins else ""
        return "warning", sentence, f"leave it in the same socket{others}"
    if port.by_id and host.port != port.by_id:
        fix = (
            f"use serial:{port.by_id}; a run goes on only with the same serial number "
            f"({port.serial_number})"
        )
        return "warning", f"{host.port} may be called otherwise after a replug", fix
    return "ok", f"known by its serial number {port.serial_number}", ""


def _latency(host: HostEnvironment) -> State | None:
    port = host.hardware
    if host.latency_ms is not None:
        if host.latency_ms <= 2:
            return "ok", f"the latency timer is {host.latency_ms} ms", ""
        sentence = f"the latency timer is {host.latency_ms} ms; samples arrive in bursts that late"
        return "warning", sentence, f"install the udev rule: {INSTALL_RULE}"
    if port is None or port.vendor != 0x0403:
        return None
    fix = (
        "Device Manager, Ports, Advanced: set Latency Timer to 1 ms"
        if host.system == "Windows"
        else "the driver's default is 16 ms; on macOS it follows the baud rate"
    )
    return "not checked", f"{host.system} does not report it here", fix


def _reset(host: HostEnvironment) -> State | None:
    port = host.hardware
    if port is None or port.vendor not in RESETTING:
        return None
    sentence = (
        f"boards with a {RESETTING[port.vendor]} adapter often reset when the port is opened; the "
        f"hello is repeated for 5 s"
    )
    return "ok", sentence, ""


def _sleep(host: HostEnvironment) -> State | None:
    fix = SLEEP_OFF.get(host.system, "switch sleep off while it runs")
    if not host.on_battery:
        return "not checked", "whether this computer falls asleep by itself", fix
    sentence = (
        "the computer runs on its battery and may fall asleep during a run; the device's "
        "watchdog stops the motors then"
    )
    return "warning", sentence, fix


def _listed(found: tuple[Holder, ...]) -> str:
    return " and ".join(f"{holder.name} (pid {holder.pid})" for holder in found)


CAUSES: dict[str, Callable[[HostEnvironment], State | None]] = {
    "port": _presence,
    "permission": _permission,
    "other users": _holders,
    "port grabbers": _probing,
    "udev rule": _rule,
    "lasting name": _lasting_name,
    "FTDI latency": _latency,
    "reset on open": _reset,
    "computer sleep": _sleep,
}
"""Every cause that is looked at, in the order of the report; None where it does not apply."""


CONNECT_S = 2.0


def serial_port_of(text: str) -> str | None:
    """Return the serial port that a port's name or an address names, None for a network address."""
    if text.partition(":")[0] not in DRIVERS:
        return text.partition("?")[0]
    ends = parse_address(text).ends
    if not ends:
        raise InputError(
            f"{text!r} has no port to look at; name a serial port or a network address"
        )
    return ends[0].place if ends[0].kind == "serial" else None


def network_findings(text: str) -> tuple[PortFinding, ...]:
    """Return what was found for each end of a network address."""
    ends = parse_address(text).ends
    names = ("listening" if end.kind == "listens" else "other end" for end in ends)
    return tuple(PortFinding(name, *_state(end)) for name, end in zip(names, ends, strict=True))


def _state(end: Endpoint) -> State:
    where = f"{end.place}:{end.port}"
    try:
        if end.kind == "listens":
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind((end.place, end.port))
            return "ok", f"UDP {where} is free", ""
        address = socket.gethostbyname(end.place)
        if end.kind == "sends":
            sentence = f"whether anybody listens on UDP {where} shows only when it answers"
            return "not checked", sentence, "name the address to benchtool bench check"
        socket.create_connection((address, end.port), CONNECT_S).close()
        return "ok", f"something listens at TCP {where}", ""
    except (OSError, OverflowError, UnicodeError) as error:
        sentence, fix = _problem(end, where, error)
        return "problem", sentence, fix


def _problem(end: Endpoint, where: str, error: Exception) -> tuple[str, str]:
    if end.kind == "listens":
        if getattr(error, "errno", None) == errno.EADDRINUSE:
            sentence = f"another program listens on UDP {where} (a ground station, another run?)"
            return sentence, "end it, or choose another port at both ends"
        sentence = f"this computer cannot listen on UDP {where} ({error})"
        return sentence, "listen on 127.0.0.1 or on an address of this computer"
    if isinstance(error, socket.gaierror | UnicodeError):
        return f"the host {end.place!r} is not known", "correct its name"
    sentence = f"nobody answers at TCP {where} ({error})"
    return sentence, "start the bench there, or correct the address"
