"""TCP and UDP as transports."""

from __future__ import annotations

import errno
import socket
from abc import ABC, abstractmethod
from contextlib import suppress

from benchtool.bench.transport.transport import first_bytes, lost_error, opening_error
from benchtool.core.errors import LinkLost, NoDevice, PortBusy

CONNECT_TIMEOUT_S = 3.0
WRITE_TIMEOUT_S = 0.2


class SocketTransport(ABC):
    """Own one socket."""

    baud: int | None = None

    def __init__(self, host: str, port: int) -> None:
        self.host, self.port = host, port
        self.where = f"{host}:{port}"
        self._socket: socket.socket | None = None

    @abstractmethod
    def _take(self) -> bytes:
        """Return what has arrived, without waiting."""

    def read(self, timeout_s: float) -> bytes:
        return first_bytes(self._take, timeout_s)

    def close(self) -> None:
        opened, self._socket = self._socket, None
        if opened is not None:
            opened.close()

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise LinkLost(f"{self.where} is closed; open it first")
        return self._socket


class TcpSocket(SocketTransport):
    """Carry bytes over one TCP connection."""

    def open(self) -> None:
        try:
            opened = socket.create_connection((self.host, self.port), timeout=CONNECT_TIMEOUT_S)
        except TimeoutError as error:
            raise NoDevice(
                f"{self.where} did not answer within {CONNECT_TIMEOUT_S:g} s; check the address "
                f"and the network"
            ) from error
        except (OSError, OverflowError, UnicodeError) as error:
            raise opening_error(error, self.where) from error
        try:
            opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            opened.setblocking(False)
        except OSError as error:
            opened.close()
            raise opening_error(error, self.where) from error
        self._socket = opened

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
            raise lost_error(error, self.where) from error

    def _take(self) -> bytes:
        try:
            data = self._opened().recv(65536)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise lost_error(error, self.where) from error
        if not data:
            raise LinkLost(f"{self.where} closed the connection; check the bench there and reopen")
        return data


MAX_PEERS = 8  # Senders that are answered; a choice. Beyond it the oldest is forgotten
DATAGRAM_BYTES = 65536
BUFFER_BYTES = 1 << 20  # system buffer: seconds of telemetry


class UdpSocket(SocketTransport):
    """Datagrams: binds and answers the last sender (`listen`), else sends first to `host` alone."""

    def __init__(self, host: str, port: int, listen: bool) -> None:
        super().__init__(host, port)
        self.where = f"UDP {host}:{port}"
        self.listens = listen
        self._peers: list[tuple[str, int]] = []

    def open(self) -> None:
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            if self.listens:
                opened.bind((self.host, self.port))
                self._peers = []
            else:
                peer = socket.gethostbyname(self.host)
                self._peers = [(peer, self.port)]
                # The system drops what comes from any other address or port.
                opened.connect((peer, self.port))
            opened.setblocking(False)
        except (OSError, OverflowError, UnicodeError) as error:
            opened.close()
            if getattr(error, "errno", None) == errno.EADDRINUSE:
                raise PortBusy(
                    f"another program listens on {self.where} (a ground station, another run?); "
                    f"end it, or choose another port at both ends"
                ) from error
            raise opening_error(error, self.where) from error
        self._socket = opened

    def write(self, data: bytes) -> None:
        opened = self._opened()
        for peer in self._peers:
            try:
                if self.listens:
                    opened.sendto(data, peer)
                else:
                    opened.send(data)
            except ConnectionError:
                pass  # Nobody there at the moment: silence is judged by whoever reads.
            except OSError as error:
                raise lost_error(error, f"UDP {peer[0]}:{peer[1]}") from error

    def _take(self) -> bytes:
        opened = self._opened()
        parts: list[bytes] = []
        taken = 0
        while taken < BUFFER_BYTES:  # a flood of datagrams must not hold the caller
            try:
                data, peer = opened.recvfrom(DATAGRAM_BYTES)
            except (BlockingIOError, ConnectionError):
                break
            except OSError as error:
                raise lost_error(error, self.where) from error
            parts.append(data)
            taken += len(data) + 1
            if self.listens and peer not in self._peers:
                self._peers = [*self._peers, peer][-MAX_PEERS:]
        return b"".join(parts)
