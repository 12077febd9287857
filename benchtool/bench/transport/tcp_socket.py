"""A TCP connection as a transport."""

from __future__ import annotations

import socket
from contextlib import ExitStack, suppress

from benchtool.bench.transport.link_errors import lost_error, opening_error
from benchtool.bench.transport.transport import first_bytes
from benchtool.core.errors import LinkLost, NoDevice

CONNECT_S = 3.0
WRITE_TIMEOUT_S = 0.2


class TcpSocket:
    """Carry bytes over one TCP connection.

    Args:
        host: name or number of the machine.
        port: TCP port.
    """

    baud: int | None = None

    def __init__(self, host: str, port: int) -> None:
        self.host = host
        self.port = port
        self._socket: socket.socket | None = None

    def open(self) -> None:
        where = f"{self.host}:{self.port}"
        try:
            with ExitStack() as on_failure:
                opened = socket.create_connection((self.host, self.port), timeout=CONNECT_S)
                on_failure.enter_context(opened)
                opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                opened.setblocking(False)
                on_failure.pop_all()
        except TimeoutError as error:
            raise NoDevice(
                f"{where} did not answer within {CONNECT_S:g} s; check the address and the network"
            ) from error
        except (OSError, OverflowError, UnicodeError) as error:
            raise opening_error(error, where) from error
        self._socket = opened

    def read(self, timeout_s: float) -> bytes:
        return first_bytes(self._take, timeout_s)

    def write(self, data: bytes) -> None:
        opened = self._opened()
        try:
            # As a rule the system takes it all at once, and nothing about the socket changes that
            # another thread would see in the middle of a read.
            with suppress(BlockingIOError):
                data = data[opened.send(data) :]
            if not data:
                return
            opened.settimeout(WRITE_TIMEOUT_S)
            try:
                opened.sendall(data)
            finally:
                opened.setblocking(False)
        except OSError as error:
            raise lost_error(error, f"{self.host}:{self.port}") from error

    def close(self) -> None:
        opened, self._socket = self._socket, None
        if opened is not None:
            opened.close()

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise LinkLost(f"{self.host}:{self.port} is closed; open it first")
        return self._socket

    def _take(self) -> bytes:
        try:
            data = self._opened().recv(65536)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise lost_error(error, f"{self.host}:{self.port}") from error
        if not data:
            raise LinkLost(
                f"{self.host}:{self.port} closed the connection; check the bench there and reopen"
            )
        return data
