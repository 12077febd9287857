"""The seam below the protocol: something that carries bytes, the host's end of it, its errors."""

from __future__ import annotations

import errno
import os
import re
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import psutil

from benchtool.core.errors import LinkError, LinkLost, NoDevice, PortBusy, PortDenied

Answer = TypeVar("Answer")
POLL_INTERVAL_S = 0.005  # longest sleep between reads, see tests/proof/benchmarks/bench_link.py


def first_bytes(take: Callable[[], bytes], timeout_s: float) -> bytes:
    """Return what `take` finds, looking again after short sleeps for at most `timeout_s`."""
    deadline_s = time.monotonic() + timeout_s
    while True:
        left_s = deadline_s - time.monotonic()
        time.sleep(min(POLL_INTERVAL_S, max(left_s, 0.0)))
        data = take()
        if data or left_s <= POLL_INTERVAL_S:
            return data


class Transport(Protocol):
    """Carry bytes; every foreign exception leaves as one of our link errors."""

    @property
    def baud(self) -> int | None:
        """Bits per second that the host's end was opened with, None where there is none."""

    def open(self) -> None:
        """Open the port for this process alone, drop old input; PortBusy, PortDenied, NoDevice."""

    def read(self, timeout_s: float) -> bytes:
        """Return what arrives, waiting `timeout_s` for the first byte; maybe nothing. LinkLost."""

    def write(self, data: bytes) -> None:
        """Send all of `data`; LinkLost where the other end went away or takes nothing."""

    def close(self) -> None:
        """Give the port back; safe to call twice, never raises."""


BITS_PER_BYTE = 10  # start bit, eight data bits, stop bit (8N1)
MAX_WAIT_S = 0.02  # longest wait of one read: a heartbeat that is due is sent at most that late
SHOWN_BYTES = 200


class LinkEndpoint(ABC):
    """Be the host's end of a conversation over a transport."""

    def __init__(self, transport: Transport, address: str, clock: Callable[[], float]) -> None:
        self.transport, self.address, self.clock = transport, address, clock
        self.received = b""  # first bytes, to name an unknown protocol

    @abstractmethod
    def pump(self, timeout_s: float) -> bool:
        """Send a heartbeat when one is due; return whether anything arrives within a short wait."""

    def close(self) -> None:
        self.transport.close()

    def take(self, timeout_s: float) -> bytes:
        """Return what arrives within a short wait."""
        data = self.transport.read(min(timeout_s, MAX_WAIT_S))
        if len(self.received) < SHOWN_BYTES:
            self.received = (self.received + data)[:SHOWN_BYTES]
        return data

    def wait(self, longest_s: float, found: Callable[[], Answer | None]) -> Answer | None:
        """Pump until `found` returns something; return that, or None after `longest_s`."""
        deadline_s = self.clock() + longest_s
        while (answer := found()) is None and (left_s := deadline_s - self.clock()) > 0.0:
            self.pump(left_s)
        return answer


_BUSY = {errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK}
_DENIED = {errno.EACCES, errno.EPERM}


def opening_error(error: Exception, where: str, windows: bool = False) -> LinkError:
    """Return what an exception on opening means."""
    number = _number(error)
    text = _text(error)
    if number in _BUSY or "exclusively lock" in text or (windows and _denied(number, text)):
        return PortBusy(
            f"{where} is in use by {format_port_owners(where)}; end that program and try again"
        )
    if _denied(number, text):
        return PortDenied(
            f"{where} may not be opened by this user; `benchtool ports PORT` names its group"
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
    """Return an exception's message; of an error within an error only the inner one's."""
    text = " ".join(str(error).split())
    inner = re.findall(r"\[Errno \d+\] ([^:\[]+)", text)
    return str(inner[-1]).strip() if len(inner) > 1 else text


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
class PortOwner:
    """Name one process that has a port open."""

    pid: int
    name: str
    is_terminal: bool = False  # also holds a master end, as a virtual bench does


def port_owners(port: str) -> tuple[PortOwner, ...]:
    """Return the processes that have `port` open, a pseudo-terminal itself only if no other has."""
    target = os.path.realpath(port)
    users: list[PortOwner] = []
    terminals: list[PortOwner] = []
    for process in psutil.process_iter(["pid", "name"]):
        paths = _open_paths(process.pid)
        if target in paths:
            is_terminal = bool(paths.intersection(_MASTERS))
            found = PortOwner(process.pid, process.info["name"] or "unnamed", is_terminal)
            (terminals if is_terminal else users).append(found)
    return tuple(users or terminals)


def format_port_owners(port: str) -> str:
    """Return the processes that have `port` open, for a message."""
    found = port_owners(port)
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
