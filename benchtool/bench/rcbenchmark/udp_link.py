"""UDP as the link of a virtual device: sending to one host, or answering whoever sends."""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable
from contextlib import ExitStack

from benchtool.core.errors import InputError, NoDevice, PortBusy

FRAME_START = 0xFD
HEADER_BYTES, SIGNATURE_BYTES = 12, 13
DATAGRAM_BYTES = 1400
"""Most bytes of whole frames in one datagram: below the usual 1500 of a network's packets."""


class UdpLink:
    """Carry frames in datagrams, whole ones only.

    Args:
        host: to send to, or to listen on.
        port: UDP port.
        listen: True waits for a host; False sends to it from the start, as autopilots do.
        fitting: how many bytes of data, from a place in it, go into one datagram; those of whole
            MAVLink frames when left out.
    """

    def __init__(
        self,
        host: str,
        port: int,
        listen: bool,
        fitting: Callable[[bytes, int], int] | None = None,
    ) -> None:
        self._host, self._port, self._listen = host, port, listen
        self._fitting = fitting or _whole_frames
        self._socket: socket.socket | None = None
        self._peer: tuple[str, int] | None = None
        self.replug()

    @property
    def place(self) -> str:
        """Host and port."""
        return f"{self._host}:{self._port}"

    @property
    def address(self) -> str:
        """What follows `mavlink:` in the address of a host."""
        return f"{'udpout' if self._listen else 'udpin'}:{self._host}:{self._port}"

    def read(self) -> bytes:
        parts = []
        while self._socket is not None:
            try:
                data, peer = self._socket.recvfrom(65536)
            except OSError:  # nothing there, or nobody
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
            size = self._fitting(data, sent)
            try:
                self._socket.sendto(data[sent : sent + size], self._peer)
            except BlockingIOError:
                return sent
            except OSError:
                pass  # Nobody listens: datagrams get lost.
            sent += size
        return sent

    def unplug(self) -> None:
        opened, self._socket = self._socket, None
        if opened is not None:
            opened.close()

    def replug(self) -> None:
        try:
            with ExitStack() as on_failure:
                opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                on_failure.enter_context(opened)
                if self._listen:
                    opened.bind((self._host, self._port))
                    self._port = opened.getsockname()[1]
                else:
                    self._peer = (socket.gethostbyname(self._host), self._port)
                opened.setblocking(False)
                on_failure.pop_all()
        except OverflowError as error:
            raise InputError(
                f"UDP port {self._port} is outside 0 to 65535; choose one in it"
            ) from error
        except (OSError, UnicodeError) as error:
            where = f"UDP {self._host}:{self._port}"
            if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
                raise PortBusy(
                    f"another program listens on {where}; choose another port"
                ) from error
            raise NoDevice(f"cannot use {where} ({error}); choose another host or port") from error
        self._socket = opened

    def close(self) -> None:
        self.unplug()


def _whole_frames(data: bytes, start: int) -> int:
    """Return how many bytes from `start` make whole frames that fit one datagram."""
    at = start
    while at < len(data):
        size = 1
        if data[at] == FRAME_START and at + 2 < len(data):
            signed = data[at + 2] & 1
            size = HEADER_BYTES + data[at + 1] + SIGNATURE_BYTES * signed
        if at > start and at + size - start > DATAGRAM_BYTES:
            break
        at += size
    return min(at, len(data)) - start


def one_line(data: bytes, start: int) -> int:
    """Return how many bytes from `start` make one line, whatever its length."""
    end = data.find(b"\n", start)
    return (len(data) if end < 0 else end + 1) - start
