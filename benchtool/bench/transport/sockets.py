"""TCP and UDP as transports."""

from __future__ import annotations

import errno
import socket
from abc import ABC, abstractmethod
from contextlib import suppress

from benchtool.bench.transport.transport import lost_error, opening_error, poll_bytes
from benchtool.core.errors import LinkLost, NoDevice, PortBusy

CONNECT_TIMEOUT_S = 3.0
WRITE_TIMEOUT_S = 0.2


class SocketTransport(ABC):
    """Base class of transports with one socket."""

    baud: int | None = None

    def __init__(self, host: str, port: int) -> None:
        self.host, self.port = host, port
        self.where = f"{host}:{port}"
        self._socket: socket.socket | None = None

    @abstractmethod
    def _read_available(self) -> bytes:
        """Return the received bytes without waiting."""

    def read(self, timeout_s: float) -> bytes:
        return poll_bytes(self._read_available, timeout_s)

    def close(self) -> None:
        sock, self._socket = self._socket, None
        if sock is not None:
            sock.close()

    def _require_open(self) -> socket.socket:
        if self._socket is None:
            raise LinkLost(f"{self.where} is closed; call open() first")
        return self._socket


class TcpSocket(SocketTransport):
    """TCP connection as a transport."""

    def open(self) -> None:
        try:
            sock = socket.create_connection((self.host, self.port), timeout=CONNECT_TIMEOUT_S)
        except TimeoutError as error:
            raise NoDevice(
                f"{self.where} did not accept a connection within {CONNECT_TIMEOUT_S:g} s; check "
                f"the address and the network"
            ) from error
        except (OSError, OverflowError, UnicodeError) as error:
            raise opening_error(error, self.where) from error
        try:
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            sock.setblocking(False)
        except OSError as error:
            sock.close()
            raise opening_error(error, self.where) from error
        self._socket = sock

    def write(self, data: bytes) -> None:
        sock = self._require_open()
        try:
            # Usually one call sends all data, and the socket stays non-blocking, which matters to
            # another thread that is reading.
            with suppress(BlockingIOError):
                data = data[sock.send(data) :]
            if not data:
                return
            sock.settimeout(WRITE_TIMEOUT_S)
            try:
                sock.sendall(data)
            finally:
                sock.setblocking(False)
        except OSError as error:
            raise lost_error(error, self.where) from error

    def _read_available(self) -> bytes:
        try:
            data = self._require_open().recv(65536)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise lost_error(error, self.where) from error
        if not data:
            raise LinkLost(f"{self.where} closed the connection; check the bench and reopen")
        return data


MAX_PEERS = 8  # senders that get replies, the newest; assumed
DATAGRAM_BYTES = 65536
BUFFER_BYTES = 1 << 20  # system buffer: seconds of telemetry


class UdpSocket(SocketTransport):
    """UDP transport: binds and replies to senders (`listen`), or sends to `host` alone."""

    def __init__(self, host: str, port: int, listen: bool) -> None:
        super().__init__(host, port)
        self.where = f"UDP {host}:{port}"
        self.listens = listen
        self._peers: list[tuple[str, int]] = []

    def open(self) -> None:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            if self.listens:
                sock.bind((self.host, self.port))
                self._peers = []
            else:
                peer = socket.gethostbyname(self.host)
                self._peers = [(peer, self.port)]
                # The system drops datagrams from any other address or port.
                sock.connect((peer, self.port))
            sock.setblocking(False)
        except (OSError, OverflowError, UnicodeError) as error:
            sock.close()
            if getattr(error, "errno", None) == errno.EADDRINUSE:
                raise PortBusy(
                    f"another program listens on {self.where} (a ground station, another run?); "
                    f"end it, or use another port on both sides"
                ) from error
            raise opening_error(error, self.where) from error
        self._socket = sock

    def write(self, data: bytes) -> None:
        sock = self._require_open()
        for peer in self._peers:
            try:
                if self.listens:
                    sock.sendto(data, peer)
                else:
                    sock.send(data)
            except ConnectionError:
                pass  # no listener at present; the reader detects the silence
            except OSError as error:
                raise lost_error(error, f"UDP {peer[0]}:{peer[1]}") from error

    def _read_available(self) -> bytes:
        sock = self._require_open()
        parts: list[bytes] = []
        size_bytes = 0
        while size_bytes < BUFFER_BYTES:  # a flood of datagrams must not block the caller
            try:
                data, peer = sock.recvfrom(DATAGRAM_BYTES)
            except (BlockingIOError, ConnectionError):
                break
            except OSError as error:
                raise lost_error(error, self.where) from error
            parts.append(data)
            size_bytes += len(data) + 1
            if self.listens and peer not in self._peers:
                self._peers = [*self._peers, peer][-MAX_PEERS:]
        return b"".join(parts)
