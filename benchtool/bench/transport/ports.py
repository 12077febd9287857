"""Transports: serial port (the only user of pyserial on the data path), TCP and UDP."""

from __future__ import annotations

import errno
import os
import socket
from abc import ABC, abstractmethod
from contextlib import suppress

import serial

from benchtool.bench.transport.transport import lost_error, opening_error, poll_bytes
from benchtool.core.errors import InputError, LinkLost, NoDevice, PortBusy

CONNECT_TIMEOUT_S = 3.0
WRITE_TIMEOUT_S = 0.2  # then the link is lost: a watchdog of 250 ms has nearly expired
_MAX_READS = 16


class SerialPort:
    """Serial port that is opened exclusively, where the system supports that."""

    def __init__(self, port: str, baud: int = 115_200) -> None:
        self.port = port
        self._baud = baud
        self._serial: serial.Serial | None = None

    @property
    def baud(self) -> int | None:
        return self._baud

    def open(self) -> None:
        # Windows opens COM10 and above only by the long name, which works for every port.
        port = rf"\\.\{self.port}" if os.name == "nt" and "\\" not in self.port else self.port
        try:
            device = serial.Serial(
                port,
                self._baud,
                timeout=0.0,
                write_timeout=WRITE_TIMEOUT_S,
                exclusive=True if os.name == "posix" else None,
            )
        except ValueError as error:
            raise InputError(f"{self.port} rejects baud rate {self._baud}: {error}") from error
        except Exception as error:
            # pyserial does not convert termios.error, which is no OSError.
            raise opening_error(error, self.port, windows=os.name == "nt") from error
        self._serial = device
        try:
            device.reset_input_buffer()
        except Exception as error:
            self.close()
            raise opening_error(error, self.port) from error

    def read(self, timeout_s: float) -> bytes:
        return poll_bytes(self._read_available, timeout_s)

    def write(self, data: bytes) -> None:
        try:
            self._require_open().write(data)
        except serial.SerialTimeoutException as error:
            raise LinkLost(
                f"{self.port} accepted no data for {WRITE_TIMEOUT_S:g} s; check that the device "
                f"runs"
            ) from error
        except Exception as error:
            raise lost_error(error, self.port) from error

    def close(self) -> None:
        device, self._serial = self._serial, None
        if device is not None:
            # Closing a disconnected port may fail.
            with suppress(Exception):
                device.close()

    def _require_open(self) -> serial.Serial:
        if self._serial is None:
            raise LinkLost(f"{self.port} is closed; call open() first")
        return self._serial

    def _read_available(self) -> bytes:
        device = self._require_open()
        try:
            if os.name != "posix":
                return bytes(device.read(device.in_waiting))
            parts = []
            # A terminal returns at most 4 KiB per read.
            for _ in range(_MAX_READS):
                try:
                    part = os.read(device.fileno(), 65536)
                except BlockingIOError:
                    break
                parts.append(part)
                if len(part) < 2048:
                    break
            if not any(parts):
                _ = device.in_waiting  # raises for a disconnected port, whose reads are empty
            return b"".join(parts)
        except Exception as error:
            raise lost_error(error, self.port) from error


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
