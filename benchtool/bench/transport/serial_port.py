"""Serial port transport; the only user of pyserial on the data path."""

from __future__ import annotations

import os
from contextlib import suppress

import serial

from benchtool.bench.transport.transport import lost_error, opening_error, poll_bytes
from benchtool.core.errors import InputError, LinkLost

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
