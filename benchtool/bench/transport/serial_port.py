"""A serial port as a transport: the only owner of pyserial on the data path."""

from __future__ import annotations

import os
from contextlib import suppress

import serial

from benchtool.bench.transport.transport import first_bytes, lost_error, opening_error
from benchtool.core.errors import InputError, LinkLost

WRITE_TIMEOUT_S = 0.2  # a blocked device is lost: a watchdog of 250 ms has nearly expired
_MOST_READS = 16


class SerialPort:
    """Carry bytes over a serial port that no second program can open the same way."""

    def __init__(self, port: str, baud: int = 115_200) -> None:
        self.port = port
        self._baud = baud
        self._serial: serial.Serial | None = None

    @property
    def baud(self) -> int | None:
        return self._baud

    def open(self) -> None:
        # Windows opens COM10 and above only by its long name; the short ones take it as well.
        port = rf"\\.\{self.port}" if os.name == "nt" and "\\" not in self.port else self.port
        try:
            opened = serial.Serial(
                port,
                self._baud,
                timeout=0.0,
                write_timeout=WRITE_TIMEOUT_S,
                exclusive=True if os.name == "posix" else None,
            )
        except ValueError as error:
            raise InputError(f"{self.port} takes no baud rate of {self._baud}: {error}") from error
        except Exception as error:
            # pyserial lets termios.error through, which is no OSError.
            raise opening_error(error, self.port, windows=os.name == "nt") from error
        self._serial = opened
        try:
            opened.reset_input_buffer()
        except Exception as error:
            self.close()
            raise opening_error(error, self.port) from error

    def read(self, timeout_s: float) -> bytes:
        return first_bytes(self._take, timeout_s)

    def write(self, data: bytes) -> None:
        try:
            self._opened().write(data)
        except serial.SerialTimeoutException as error:
            raise LinkLost(
                f"{self.port} took nothing for {WRITE_TIMEOUT_S:g} s; check that the device runs"
            ) from error
        except Exception as error:
            raise lost_error(error, self.port) from error

    def close(self) -> None:
        opened, self._serial = self._serial, None
        if opened is not None:
            # A port that is gone needs no closing.
            with suppress(Exception):
                opened.close()

    def _opened(self) -> serial.Serial:
        if self._serial is None:
            raise LinkLost(f"{self.port} is closed; open it first")
        return self._serial

    def _take(self) -> bytes:
        opened = self._opened()
        try:
            if os.name != "posix":
                return bytes(opened.read(opened.in_waiting))
            parts = []
            # A terminal hands out at most 4 KiB per read.
            for _ in range(_MOST_READS):
                try:
                    part = os.read(opened.fileno(), 65536)
                except BlockingIOError:
                    break
                parts.append(part)
                if len(part) < 2048:
                    break
            if not any(parts):
                _ = opened.in_waiting  # a port that is gone reads as empty, but says so here
            return b"".join(parts)
        except Exception as error:
            raise lost_error(error, self.port) from error
