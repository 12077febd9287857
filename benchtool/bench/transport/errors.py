"""Foreign exceptions of ports and sockets, distinguished once and turned into ours."""

from __future__ import annotations

import errno
import os
import re
import socket
from dataclasses import dataclass

import psutil

from benchtool.core.errors import LinkError, LinkLost, NoDevice, PortBusy, PortDenied

_BUSY = {errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK}

_DENIED = {errno.EACCES, errno.EPERM}


def opening_error(error: Exception, where: str, windows: bool = False) -> LinkError:
    """Return what an exception on opening means.

    Args:
        error: an OSError (pyserial's SerialException is one), termios.error or socket error.
        where: port or host as the user gave it.
        windows: on Windows an access denied on a port means that somebody else has it open.
    """
    number = _number(error)
    text = _text(error)
    if number in _BUSY or "exclusively lock" in text or (windows and _denied(number, text)):
        return PortBusy(
            f"{where} is in use by {holders_text(where)}; end that program and try again"
        )
    if _denied(number, text):
        return PortDenied(
            f"{where} may not be opened by this user; `benchtool doctor` says which group or rule "
            f"is missing"
        )
    if isinstance(error, socket.gaierror | UnicodeError):
        return NoDevice(f"the host of {where} is not known; correct its name in the address")
    if isinstance(error, OverflowError):
        return NoDevice(f"{where} is no port; choose one from 1 to 65535")
    if isinstance(error, ConnectionRefusedError) or number == errno.ECONNREFUSED:
        return NoDevice(f"nobody listens at {where}; start the bench there or correct the address")
    if number == errno.ENOTTY or "Inappropriate ioctl" in text:
        return NoDevice(f"{where} is not a serial port; `benchtool ports` lists the serial ports")
    return NoDevice(f"{where} cannot be opened ({text}); `benchtool ports` lists what is there")


def lost_error(error: Exception, where: str) -> LinkLost:
    """Return what an exception on a port that was open means."""
    text = _text(error)
    return LinkLost(
        f"the link to {where} broke ({text}); check cable and power, then open it again"
    )


def _text(error: Exception) -> str:
    """Return an exception's words; of an error within an error only the inner one's.

    pyserial says "[Errno 2] could not open port X: [Errno 2] No such file or directory: 'X'".
    """
    text = " ".join(str(error).split())
    said = re.findall(r"\[Errno \d+\] ([^:\[]+)", text)
    return str(said[-1]).strip() if len(said) > 1 else text


def _number(error: Exception) -> int | None:
    number = getattr(error, "errno", None)
    if isinstance(number, int):
        return number
    # pyserial and termios leave the number in the text: "(25, 'Inappropriate ioctl for device')".
    found = re.search(r"\(?(?:Errno )?(\d+)[,\]]", str(error))
    return int(found[1]) if found else None


def _denied(number: int | None, text: str) -> bool:
    return number in _DENIED or "PermissionError" in text or "Permission denied" in text


_MASTERS = ("/dev/ptmx", "/dev/pts/ptmx")


@dataclass(frozen=True, slots=True)
class Holder:
    """Name one process that has a port open.

    Attributes:
        pid, name: of the process.
        is_terminal: whether it also holds the master end of pseudo-terminals, as a virtual bench.
    """

    pid: int
    name: str
    is_terminal: bool = False


def holders(port: str) -> tuple[Holder, ...]:
    """Return the processes that have `port` open; empty where the system does not say.

    Linux has it in /proc for one's own processes. A process that also holds a pseudo-terminal's
    master is the terminal itself, not a user of it, and counts only when nobody else is found.
    """
    target = os.path.realpath(port)
    users: list[Holder] = []
    terminals: list[Holder] = []
    for process in psutil.process_iter(["pid", "name"]):
        paths = _open_paths(process.pid)
        if target in paths:
            is_terminal = bool(paths.intersection(_MASTERS))
            found = Holder(process.pid, process.info["name"] or "unnamed", is_terminal)
            (terminals if is_terminal else users).append(found)
    return tuple(users or terminals)


def holders_text(port: str) -> str:
    """Return the holders as words for a message."""
    found = holders(port)
    if not found:
        return "another program (the system does not say which)"
    return " and ".join(
        f"{holder.name} (pid {holder.pid}{', this program' if holder.pid == os.getpid() else ''})"
        for holder in found
    )


def _open_paths(pid: int) -> set[str]:
    folder = f"/proc/{pid}/fd"
    paths: set[str] = set()
    try:
        numbers = os.listdir(folder)
    except OSError:
        return paths
    for number in numbers:
        try:
            paths.add(os.readlink(f"{folder}/{number}"))
        except OSError:
            continue
    return paths
