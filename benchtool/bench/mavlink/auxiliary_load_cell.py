"""Auxiliary load cell on a separate port: text lines to readings in the autopilot's time."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.clocks import DeviceClock
from benchtool.bench.identify import identify_device
from benchtool.bench.transport.transport import Transport
from benchtool.core.errors import NoDevice, ProtocolError
from benchtool.core.units import Array

FIRST_LINE_TIMEOUT_S = 5.0  # boot time of a board that resets when its port is opened, as a hello

MAX_LINE_LENGTH = 512
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


class LoadCellDecoder:
    r"""Decoder of readings: the first number after a colon, else the first of its line.

    It accepts both examples of the HX711 library for Arduino: ``HX711 reading: 124006`` and
    ``one reading:\t16.1\t| average:\t4.2``. Incomplete lines are buffered; lines without a number
    are ignored.
    """

    def __init__(self) -> None:
        self._partial_line = b""
        self._is_synchronised = False

    def feed(self, data: bytes) -> list[float]:
        """Return the readings that `data` completes."""
        *lines, self._partial_line = (self._partial_line + data).split(b"\n")
        self._partial_line = self._partial_line[-MAX_LINE_LENGTH:]
        if lines and not self._is_synchronised:
            # A link starts in the middle of a line, whose number may be incomplete.
            self._is_synchronised, lines = True, lines[1:]
        readings = []
        for line in lines:
            _, colon, value_text = line.partition(b":")
            match = _NUMBER.search(value_text if colon else line)
            if match is not None:
                readings.append(float(match[0]))
        return readings


class AuxiliaryLoadCell:
    """Load cell that sends text; its readings are stamped in the autopilot's time.

    The time of a reading is the arrival of its line. The earlier delay of amplifier and link (for
    an HX711 about 15 ms at 80 Hz, 100 ms at 10 Hz) is unknown and not subtracted.
    """

    def __init__(self, transport: Transport, name: str, clock: Callable[[], float]) -> None:
        self._transport, self._name, self._clock = transport, name, clock
        self._decoder = LoadCellDecoder()
        self._buffered: list[tuple[float, float]] = []
        self._last_us = 0
        self._received = b""

    def open(self) -> None:
        """Open the port and wait for the first reading; the port's owner closes it."""
        self._decoder, self._buffered, self._last_us = LoadCellDecoder(), [], 0
        self._transport.open()
        deadline_s = self._clock() + FIRST_LINE_TIMEOUT_S
        self._received = b""
        while not self._buffered:
            if self._clock() >= deadline_s:
                raise self._missing_data_error()
            self.poll(0.02)

    def poll(self, timeout_s: float = 0.0) -> None:
        data = self._transport.read(timeout_s)
        arrived_s = self._clock()
        if not self._buffered and len(self._received) < MAX_LINE_LENGTH:
            self._received += data
        self._buffered += [(arrived_s, value) for value in self._decoder.feed(data)]

    def _missing_data_error(self) -> NoDevice | ProtocolError:
        if not self._received:
            return NoDevice(
                f"the load cell on {self._name} sent nothing for {FIRST_LINE_TIMEOUT_S:g} s; "
                f"check its power, its program and the port's name"
            )
        if identify_device(self._received) in ("noise", "frames"):
            return ProtocolError(
                f"the load cell on {self._name} sends bytes that are no text "
                f"({bytes(self._received[:40])!r}); the baud rate is wrong: append it to the "
                f"port's name, as cell=/dev/ttyUSB1:57600"
            )
        return ProtocolError(
            f"the device on {self._name} sends text without a number "
            f"({bytes(self._received[:40])!r}); it is no load cell, or runs another program"
        )

    def rows(
        self, host_s: Callable[[float], float], clock: DeviceClock, width: int, columns: list[int]
    ) -> tuple[NDArray[np.int64], Array]:
        """Return device times (m,): us and rows (m, width) of the readings since the last call."""
        buffered, self._buffered = self._buffered, []
        offset_s = float(clock.host_time_s(np.zeros(1, np.int64))[0])
        values = np.full((len(buffered), width), np.nan)
        times_us = np.empty(len(buffered), np.int64)
        for row, (arrived_s, value) in enumerate(buffered):
            values[row, columns] = value
            time_us = round(1e6 * (host_s(arrived_s) - offset_s))
            times_us[row] = self._last_us = max(time_us, self._last_us + 1)
        return times_us, values


def merge_in_order(
    first: tuple[NDArray[np.int64], Array], second: tuple[NDArray[np.int64], Array], after_us: int
) -> tuple[NDArray[np.int64], Array]:
    """Return rows of two sources (times (m,): us, values (m, c)) as one, in order of time.

    Times are strictly increasing and above `after_us`; a late row moves behind the rows that were
    already returned.
    """
    times_us = np.concatenate([first[0], second[0]])
    values = np.concatenate([first[1], second[1]])
    order = np.argsort(times_us, kind="stable")
    times_us, values = times_us[order], values[order]
    steps = np.arange(len(times_us))
    return np.maximum.accumulate(np.maximum(times_us, after_us + 1) - steps) + steps, values
