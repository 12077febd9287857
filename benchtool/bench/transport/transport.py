"""Transport interface for bytes, the host's endpoint of a link, and link errors."""

from __future__ import annotations

import errno
import os
import re
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol, TypeVar

import psutil

from benchtool.bench.clocks import HostGapDetector
from benchtool.core.errors import LinkError, LinkLost, NoDevice, PortBusy, PortDenied

Result = TypeVar("Result")
POLL_INTERVAL_S = 0.005  # longest sleep between reads, see tests/proof/benchmarks/bench_link.py


def poll_bytes(read_available: Callable[[], bytes], timeout_s: float) -> bytes:
    """Poll `read_available` with short sleeps for at most `timeout_s`; return its first bytes."""
    deadline_s = time.monotonic() + timeout_s
    while True:
        left_s = deadline_s - time.monotonic()
        time.sleep(min(POLL_INTERVAL_S, max(left_s, 0.0)))
        data = read_available()
        if data or left_s <= POLL_INTERVAL_S:
            return data


class Transport(Protocol):
    """Byte transport; every foreign exception is converted to a LinkError."""

    @property
    def baud(self) -> int | None:
        """Bits per second of the host's port; None for a transport without a baud rate."""

    def open(self) -> None:
        """Open the port exclusively and drop old input; PortBusy, PortDenied, NoDevice."""

    def read(self, timeout_s: float) -> bytes:
        """Return received bytes, perhaps none; wait `timeout_s` for the first. LinkLost."""

    def write(self, data: bytes) -> None:
        """Send all of `data`; LinkLost if the peer closed the link or accepts no data."""

    def close(self) -> None:
        """Close the port; safe to call twice, never raises."""


BITS_PER_BYTE = 10  # start bit, eight data bits, stop bit (8N1)
MAX_WAIT_S = 0.02  # longest wait of one read, and so the longest delay of a due heartbeat
MAX_STORED_BYTES = 200


class LinkEndpoint(ABC):
    """The host's endpoint of a protocol session over a transport."""

    def __init__(self, transport: Transport, address: str, clock: Callable[[], float]) -> None:
        self.transport, self.address, self.clock = transport, address, clock
        self.received = b""  # first bytes, for the identification of an unknown protocol
        self.gaps = HostGapDetector()  # detects pauses between and during calls of `pump`

    @abstractmethod
    def _send_due_heartbeat(self, now_s: float) -> None:
        """Send a heartbeat if one is due."""

    @abstractmethod
    def _process(self, data: bytes) -> None:
        """Process received bytes."""

    def pump(self, timeout_s: float) -> bool:
        """Send a due heartbeat; return whether anything is received within a short wait."""
        now_s = self.clock()
        self.gaps.update(now_s)
        self._send_due_heartbeat(now_s)
        data = self.receive(timeout_s)
        self.gaps.update(self.clock())
        if data:
            self._process(data)
        return bool(data)

    def close(self) -> None:
        self.transport.close()

    def receive(self, timeout_s: float) -> bytes:
        """Return the bytes received within a short wait."""
        data = self.transport.read(min(timeout_s, MAX_WAIT_S))
        if len(self.received) < MAX_STORED_BYTES:
            self.received = (self.received + data)[:MAX_STORED_BYTES]
        return data

    def wait(self, timeout_s: float, poll: Callable[[], Result | None]) -> Result | None:
        """Call `pump` until `poll` returns a result; return it, or None after the timeout."""
        deadline_s = self.clock() + timeout_s
        while (result := poll()) is None and (left_s := deadline_s - self.clock()) > 0.0:
            self.pump(left_s)
        return result


_BUSY = {errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK}
_DENIED = {errno.EACCES, errno.EPERM}


def opening_error(error: Exception, where: str, windows: bool = False) -> LinkError:
    """Return the error for an exception raised while opening."""
    number = _error_number(error)
    text = _error_text(error)
    if number in _BUSY or "exclusively lock" in text or (windows and _is_denied(number, text)):
        return PortBusy(
            f"{where} is in use by {format_port_owners(where)}; end that program and try again"
        )
    if _is_denied(number, text):
        return PortDenied(
            f"no permission to open {where}; `benchtool ports PORT` names the missing group"
        )
    if isinstance(error, socket.gaierror | UnicodeError):
        return NoDevice(f"the host of {where} is unknown; correct its name in the address")
    if isinstance(error, OverflowError):
        return NoDevice(f"{where} is not a port; allowed: 1 to 65535")
    if isinstance(error, ConnectionRefusedError) or number == errno.ECONNREFUSED:
        return NoDevice(
            f"connection to {where} refused; start the bench there or correct the address"
        )
    if number == errno.ENOTTY or "Inappropriate ioctl" in text:
        return NoDevice(f"{where} is not a serial port; `benchtool ports` lists the serial ports")
    return NoDevice(f"{where} cannot be opened ({text}); `benchtool ports` lists all ports")


def lost_error(error: Exception, where: str) -> LinkLost:
    """Return the error for an exception raised by an open port."""
    return LinkLost(
        f"the link to {where} broke ({_error_text(error)}); check cable and power, then open it "
        f"again"
    )


def _error_text(error: Exception) -> str:
    """Return an exception's message; of a nested error only the inner one's."""
    text = " ".join(str(error).split())
    inner_texts = re.findall(r"\[Errno \d+\] ([^:\[]+)", text)
    return str(inner_texts[-1]).strip() if len(inner_texts) > 1 else text


def _error_number(error: Exception) -> int | None:
    number = getattr(error, "errno", None)
    if isinstance(number, int):
        return number
    # pyserial and termios leave the number in the text: "(25, 'Inappropriate ioctl for device')".
    match = re.search(r"\(?(?:Errno )?(\d+)[,\]]", str(error))
    return int(match[1]) if match else None


def _is_denied(number: int | None, text: str) -> bool:
    return number in _DENIED or "PermissionError" in text or "Permission denied" in text


_PTY_MASTERS = ("/dev/ptmx", "/dev/pts/ptmx")


@dataclass(frozen=True, slots=True)
class PortOwner:
    """One process that has a port open."""

    pid: int
    name: str
    is_terminal: bool = False  # it also has a master end open, as a virtual bench does


def port_owners(port: str) -> tuple[PortOwner, ...]:
    """Return the processes that have `port` open; a pseudo-terminal's owner only if alone."""
    target = os.path.realpath(port)
    users: list[PortOwner] = []
    terminals: list[PortOwner] = []
    for process in psutil.process_iter(["pid", "name"]):
        paths = _open_paths(process.pid)
        if target in paths:
            is_terminal = bool(paths.intersection(_PTY_MASTERS))
            owner = PortOwner(process.pid, process.info["name"] or "unnamed", is_terminal)
            (terminals if is_terminal else users).append(owner)
    return tuple(users or terminals)


def format_port_owners(port: str) -> str:
    """Return the processes that have `port` open, for a message."""
    owners = port_owners(port)
    if not owners:
        return "another program (the system does not report which)"
    return " and ".join(
        f"{owner.name} (pid {owner.pid}{', this program' if owner.pid == os.getpid() else ''})"
        for owner in owners
    )


def _open_paths(pid: int) -> set[str]:
    folder = f"/proc/{pid}/fd"
    paths: set[str] = set()
    with suppress(OSError):
        for number in os.listdir(folder):
            with suppress(OSError):
                paths.add(os.readlink(f"{folder}/{number}"))
    return paths
