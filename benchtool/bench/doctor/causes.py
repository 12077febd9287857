"""What keeps a port from working: one finding per cause, judged from given surroundings. Pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from typing import Literal

from benchtool.bench.doctor.host_environment import UDEV_RULE, HostEnvironment
from benchtool.bench.transport.errors import Holder

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


@dataclass(frozen=True, slots=True)
class Finding:
    """Say how one thing stands.

    Attributes:
        name: what was looked at.
        verdict: ok, warning (may hurt), problem (does hurt), or not checked (and why).
        sentence: what was found.
        fix: what to do, empty when there is nothing to do.
    """

    name: str
    verdict: Verdict
    sentence: str
    fix: str = ""


def findings(around: HostEnvironment) -> tuple[Finding, ...]:
    """Return what was found for each cause, those that do not concern the port left out."""
    found = (check(around) for check in CHECKS)
    return tuple(finding for finding in found if finding is not None)


def udev_rule() -> str:
    """Return the text of the udev rule that benchtool ships."""
    return (resources.files("benchtool.bench.doctor") / UDEV_RULE.name).read_text(encoding="utf-8")


def _presence(around: HostEnvironment) -> Finding | None:
    name = "port"
    if not around.port:
        if around.ports:
            listed = ", ".join(port.name for port in around.ports)
            return Finding(name, "ok", f"this computer has {listed}", "name one to look closer")
        return Finding(
            name,
            "problem",
            "this computer has no serial port",
            "plug the bench in; some USB cables only charge; `benchtool bench serve` makes a "
            "virtual bench",
        )
    if around.system == "Darwin" and around.port.startswith("/dev/tty."):
        return Finding(
            name,
            "problem",
            f"{around.port} waits for a carrier signal that benches do not give",
            f"use {around.port.replace('/dev/tty.', '/dev/cu.')}",
        )
    if around.exists or around.hardware is not None:
        return Finding(name, "ok", f"{around.port} is there")
    known = ", ".join(port.name for port in around.ports) or "none"
    return Finding(
        name,
        "problem",
        f"{around.port} is not there; present: {known}",
        "plug it in; after a replug the number may have changed",
    )


def _permission(around: HostEnvironment) -> Finding | None:
    name = "permission"
    if around.system == "Windows":
        return Finding(name, "not checked", "Windows lets every user open a free port")
    if not around.port or not around.exists:
        return None
    if around.may_open:
        return Finding(name, "ok", f"{around.user} may open {around.port}")
    group = around.group or "dialout"
    if group in around.groups_on_file and group not in around.groups:
        return Finding(
            name,
            "problem",
            f"{around.user} was added to group {group}, but this session began before",
            "log out and in again",
        )
    fix = f"sudo usermod -aG {group} {around.user}, then log out and in again"
    if around.system == "Linux" and not around.rule_installed:
        fix += f"; or install the udev rule: {INSTALL_RULE}"
    return Finding(
        name,
        "problem",
        f"{around.user} may not open {around.port}, which belongs to group {group}",
        fix,
    )


def _rule(around: HostEnvironment) -> Finding | None:
    name = "udev rule"
    if around.rule_installed is None or around.is_terminal:
        return None
    if around.rule_installed:
        return Finding(name, "ok", f"{UDEV_RULE} is installed")
    return Finding(
        name,
        "warning",
        "benchtool's udev rule (access, ModemManager, FTDI latency) is not installed",
        INSTALL_RULE,
    )


def _holders(around: HostEnvironment) -> Finding | None:
    name = "other users"
    if not around.port:
        return None
    if around.holders is None:
        return Finding(
            name,
            "not checked",
            f"{around.system} does not tell which program has a port open",
            "close terminal programs, the Arduino serial monitor, slicers",
        )
    if len(around.holders) == 1 and around.holders[0].is_terminal:
        return Finding(name, "ok", f"the virtual bench behind it is {_listed(around.holders)}")
    if around.holders:
        return Finding(
            name,
            "problem",
            f"{around.port} is open in {_listed(around.holders)}",
            "end that program",
        )
    return Finding(name, "ok", "no program of this user has it open")


def _probing(around: HostEnvironment) -> Finding | None:
    name = "port grabbers"
    if around.is_terminal:
        return None
    if around.programs is None or around.system != "Linux":
        return Finding(
            name, "not checked", f"no program is known that grabs ports on {around.system}"
        )
    running = [program for program in PROBING if program in around.programs]
    if not running:
        return Finding(name, "ok", "neither ModemManager nor brltty runs")
    fixes = []
    if "modemmanager" in running and not around.rule_installed:
        fixes.append("install the udev rule, which makes ModemManager leave bench ports alone")
    if "brltty" in running:
        fixes.append("remove brltty (sudo apt remove brltty) unless braille is needed")
    return Finding(
        name,
        "warning" if fixes else "ok",
        "; ".join(PROBING[program] for program in running),
        "; ".join(fixes),
    )


def _lasting_name(around: HostEnvironment) -> Finding | None:
    """Say how the port is called after a replug."""
    name = "lasting name"
    port = around.hardware
    if port is None or not port.usb:
        return None
    twins = [other for other in around.ports if other.usb == port.usb and other is not port]
    if not port.serial_number:
        return Finding(
            name,
            "warning",
            f"its USB adapter ({port.usb}) has no serial number; after a replug it cannot be told "
            f"from others",
            "keep it in the same socket" + (", and other adapters out" if twins else ""),
        )
    if port.by_id and around.port != port.by_id:
        return Finding(
            name,
            "warning",
            f"{around.port} may be called otherwise after a replug",
            f"use serial:{port.by_id}; a run goes on only with the same serial number "
            f"({port.serial_number})",
        )
    return Finding(name, "ok", f"known by its serial number {port.serial_number}")


def _latency(around: HostEnvironment) -> Finding | None:
    name = "FTDI latency"
    port = around.hardware
    if around.latency_ms is not None:
        if around.latency_ms <= 2:
            return Finding(name, "ok", f"the latency timer is {around.latency_ms} ms")
        return Finding(
            name,
            "warning",
            f"the latency timer is {around.latency_ms} ms; samples arrive in bursts that late",
            f"install the udev rule: {INSTALL_RULE}",
        )
    if port is None or port.vendor != 0x0403:
        return None
    fix = (
        "Device Manager, Ports, Advanced: set Latency Timer to 1 ms"
        if around.system == "Windows"
        else "the driver's default is 16 ms; on macOS it follows the baud rate"
    )
    return Finding(name, "not checked", f"{around.system} does not tell it here", fix)


def _reset(around: HostEnvironment) -> Finding | None:
    port = around.hardware
    if port is None or port.vendor not in RESETTING:
        return None
    return Finding(
        "reset on open",
        "ok",
        f"boards with a {RESETTING[port.vendor]} adapter often reset when the port is opened; the "
        f"hello is repeated for 5 s",
    )


def _sleep(around: HostEnvironment) -> Finding | None:
    fix = {
        "Linux": "run it as: systemd-inhibit --what=sleep:idle benchtool sweep ...",
        "Darwin": "run it as: caffeinate -is benchtool sweep ...",
        "Windows": "set sleep to never while it runs (Settings, System, Power)",
    }.get(around.system, "switch sleep off while it runs")
    if around.on_battery:
        return Finding(
            "computer sleep",
            "warning",
            "the computer runs on its battery and may fall asleep during a run; the device's "
            "watchdog stops the motors then",
            fix,
        )
    return Finding(
        "computer sleep", "not checked", "whether this computer falls asleep by itself", fix
    )


def _listed(found: tuple[Holder, ...]) -> str:
    return " and ".join(f"{holder.name} (pid {holder.pid})" for holder in found)


CHECKS: tuple[Callable[[HostEnvironment], Finding | None], ...] = (
    _presence,
    _permission,
    _holders,
    _probing,
    _rule,
    _lasting_name,
    _latency,
    _reset,
    _sleep,
)
"""Every cause that is looked at, in the order of the report."""
