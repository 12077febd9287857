"""Links of virtual devices: pseudo-terminal, TCP port, UDP. Calls never block."""

from __future__ import annotations

import errno
import os
import socket
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from benchtool.bench.drivers import (
    GROUND_STATION_PORT,
    LOOPBACK,
    MAX_PORT,
    TELEMETRY_BAUD,
    parse_port,
)
from benchtool.bench.serial.commands import DeviceEvent
from benchtool.bench.serial.frames import frame_fields
from benchtool.core.errors import InputError, NoDevice, PortBusy


@dataclass(frozen=True, slots=True)
class ServedLink:
    """Link on which a virtual device listens or sends; port 0 means any free port."""

    protocol: str
    kind: str
    host: str = LOOPBACK
    port: int = 0

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the link of a `--link` option.

        `mavlink` is UDP to port 14550 of this computer; `mavlink:udpout:HOST:PORT` sends there,
        `mavlink:udpin:PORT` listens there. The others are `pty`, `tcp:PORT`, `tcp:HOST:PORT`, and
        the same after `mavlink:`.
        """
        protocol, _, after_protocol = text.partition(":")
        if protocol == "mavlink":
            kind, _, location = after_protocol.partition(":")
            kind, location = kind or "udpout", location or str(GROUND_STATION_PORT)
        else:
            protocol, kind, location = "bench", protocol, after_protocol
        if text in ("pty", "mavlink:pty"):
            return cls(protocol, "pty")
        host, _, digits = location.rpartition(":")
        kinds = {"bench": "tcp", "mavlink": "tcp udpin udpout"}[protocol]
        port = parse_port(digits, min_port=int(kind == "udpout"))
        if port is None or kind not in kinds.split():
            raise InputError(
                f"{text!r:.60} is not a link with a port of 0 (any) to {MAX_PORT}; allowed: pty, "
                f"tcp:PORT, tcp:HOST:PORT, mavlink, mavlink:pty, mavlink:tcp:PORT, "
                f"mavlink:udpout:HOST:PORT, mavlink:udpin:PORT"
            )
        return cls(protocol, kind, host or LOOPBACK, port)


def event_line(event: DeviceEvent) -> bytes:
    """Return the line of the bench protocol that reports an event."""
    return frame_fields("E", (event.kind, event.text))


class ServerLink(ABC):
    """Byte transport to the connected client."""

    @property
    @abstractmethod
    def address(self) -> str:
        """Address that a host uses to connect to this bench."""

    @abstractmethod
    def read(self) -> bytes:
        """Return the received bytes, possibly none, without waiting."""

    @abstractmethod
    def write(self, data: bytes) -> int:
        """Write as many bytes as fit and return their number."""

    @abstractmethod
    def unplug(self) -> None:
        """Disconnect like a pulled cable."""

    @abstractmethod
    def replug(self) -> None:
        """Reconnect, under the same address if possible."""

    def close(self) -> None:
        """Stop listening."""
        self.unplug()


class PtyLink(ServerLink):
    """Pseudo-terminal link; the symlink follows the current terminal, also after a replug."""

    def __init__(self, symlink: Path | None = None) -> None:
        if os.name != "posix":
            raise InputError(
                "pseudo-terminals are not available on this system; use --link tcp:5555"
            )
        self._symlink = symlink
        self._ends: tuple[int, int] | None = None
        self._path = ""
        if symlink is not None and symlink.exists() and not symlink.is_symlink():
            raise InputError(f"{symlink} is not a symbolic link; choose another --symlink")
        self.replug()

    @property
    def address(self) -> str:
        return f"serial:{self._symlink or self._path}"

    def read(self) -> bytes:
        if self._ends is None:
            return b""
        try:
            return os.read(self._ends[0], 65536)
        except OSError:  # no data or no client
            return b""

    def write(self, data: bytes) -> int:
        if self._ends is None:
            return len(data)
        try:
            return os.write(self._ends[0], data)
        except OSError:
            return 0

    def unplug(self) -> None:
        ends, self._ends = self._ends, None
        for end in ends or ():
            os.close(end)
        if self._symlink is not None:
            self._symlink.unlink(missing_ok=True)

    def replug(self) -> None:
        import pty
        import tty

        # The far end stays open, else its settings and its bytes are lost with every client.
        near, far = pty.openpty()
        tty.setraw(far)
        os.set_blocking(near, False)
        self._ends, self._path = (near, far), os.ttyname(far)
        if self._symlink is None:
            return
        try:
            self._symlink.unlink(missing_ok=True)
            self._symlink.symlink_to(self._path)
        except OSError as error:
            symlink, self._symlink = self._symlink, None
            self.unplug()
            raise InputError(
                f"--symlink {symlink} cannot be created ({error.strerror}); choose a path in an "
                f"existing, writable folder"
            ) from error


@contextmanager
def _new_socket(kind: socket.SocketKind, host: str, port: int) -> Iterator[socket.socket]:
    """Yield a new socket to bind, then make it non-blocking; close it on failure."""
    name = "TCP" if kind is socket.SOCK_STREAM else "UDP"
    sock = socket.socket(socket.AF_INET, kind)
    try:
        yield sock
        sock.setblocking(False)
    except (OSError, UnicodeError) as error:
        sock.close()
        where = f"{name} {host}:{port}"
        if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
            message = f"another program listens on {where}; choose another port"
            raise PortBusy(message) from error
        raise NoDevice(f"cannot use {where} ({error}); choose another host or port") from error


class TcpLink(ServerLink):
    """TCP link for one client at a time; a second client receives the name of the first."""

    def __init__(self, host: str, port: int) -> None:
        self._host = host
        self._port = port
        self._client: socket.socket | None = None
        self._client_name = ""
        self._listener: socket.socket | None = None
        self.replug()

    @property
    def address(self) -> str:
        return f"tcp:{self._host}:{self._port}"

    def read(self) -> bytes:
        # Read the old client to its end first: one that reconnects at once must not find itself.
        received = b""
        while self._client is not None:
            try:
                data = self._client.recv(65536)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            if not data:
                self._drop_client()
            received += data
        self._accept()
        return received

    def write(self, data: bytes) -> int:
        if self._client is None:
            return len(data)
        try:
            return self._client.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self._drop_client()
            return len(data)

    def unplug(self) -> None:
        self._drop_client()
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def replug(self) -> None:
        with _new_socket(socket.SOCK_STREAM, self._host, self._port) as listener:
            if os.name == "posix":
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((self._host, self._port))
            listener.listen()
        self._listener = listener
        self._port = listener.getsockname()[1]

    def _accept(self) -> None:
        if self._listener is None:
            return
        try:
            client, peer = self._listener.accept()
        except OSError:
            return
        if self._client is not None:
            with client, suppress(OSError):
                client.sendall(event_line(DeviceEvent("busy", self._client_name)))
            return
        try:
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except OSError:  # it disconnected at once
            client.close()
            return
        self._client, self._client_name = client, f"{peer[0]}:{peer[1]}"

    def _drop_client(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close()


FRAME_START = 0xFD
HEADER_BYTES, SIGNATURE_BYTES = 12, 13
DATAGRAM_BYTES = 1400  # maximum of whole frames, below 1500 of a network packet


def whole_frames(data: bytes, start: int) -> int:
    """Return the number of bytes from `start` that are whole MAVLink frames in one datagram."""
    end = start
    while end < len(data):
        size = 1
        if data[end] == FRAME_START and end + 2 < len(data):
            signed = data[end + 2] & 1
            size = HEADER_BYTES + data[end + 1] + SIGNATURE_BYTES * signed
        if end > start and end + size - start > DATAGRAM_BYTES:
            break
        end += size
    return min(end, len(data)) - start


class UdpLink(ServerLink):
    """UDP link with whole frames per datagram; unless it listens, it sends from the start."""

    def __init__(self, host: str, port: int, listen: bool) -> None:
        self._host, self._port, self._listen = host, port, listen
        self._socket: socket.socket | None = None
        self._peer: tuple[str, int] | None = None
        self.replug()

    @property
    def address(self) -> str:
        """Part after `mavlink:` of the address that a host uses."""
        return f"{'udpout' if self._listen else 'udpin'}:{self._host}:{self._port}"

    def read(self) -> bytes:
        parts = []
        while self._socket is not None:
            try:
                data, peer = self._socket.recvfrom(65536)
            except OSError:  # no data or no peer
                break
            parts.append(data)
            if self._listen:
                self._peer = peer
        return b"".join(parts)

    def write(self, data: bytes) -> int:
        if self._socket is None or self._peer is None:
            return len(data)
        sent = 0
        while sent < len(data):
            size = whole_frames(data, sent)
            try:
                self._socket.sendto(data[sent : sent + size], self._peer)
            except BlockingIOError:
                return sent
            except OSError:
                pass  # no listener: the datagram is lost
            sent += size
        return sent

    def unplug(self) -> None:
        old, self._socket = self._socket, None
        if old is not None:
            old.close()

    def replug(self) -> None:
        with _new_socket(socket.SOCK_DGRAM, self._host, self._port) as sock:
            if self._listen:
                sock.bind((self._host, self._port))
                self._port = sock.getsockname()[1]
            else:
                self._peer = (socket.gethostbyname(self._host), self._port)
        self._socket = sock


def open_link(text: str, symlink: Path | None = None) -> ServerLink:
    """Open and return the link of `--link`; see `ServedLink.parse`."""
    link = ServedLink.parse(text)
    if link.kind == "pty":
        return PtyLink(symlink)
    if symlink is not None:
        only = "mavlink:pty" if link.protocol == "mavlink" else "pty"
        raise InputError(f"--symlink needs --link {only}; remove it")
    if link.kind == "tcp":
        return TcpLink(link.host, link.port)
    return UdpLink(link.host, link.port, listen=link.kind == "udpin")


def host_address(link: ServerLink, n_rotors: int, options: str = "") -> str:
    """Return the address for a host: link and number of rotors of the autopilot."""
    path = link.address + (f":{TELEMETRY_BAUD}" if link.address.startswith("serial:") else "")
    return f"mavlink:{path}?rotors={n_rotors}{options}"
