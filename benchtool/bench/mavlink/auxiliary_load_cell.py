"""A load cell with its own port beside an autopilot: lines to readings on the autopilot's time."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.clocks import DeviceClock
from benchtool.bench.identify import identify_device
from benchtool.bench.transport.transport import Transport
from benchtool.core.array_type import Array
from benchtool.core.errors import NoDevice, ProtocolError

FIRST_LINE_TIMEOUT_S = 5.0  # boot time of a board that resets when its port opens, as for a hello

MAX_LINE_LENGTH = 512
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


class LoadCellDecoder:
    r"""Turn bytes into readings: the first number behind a colon, else the first of its line.

    Both examples of the HX711 library for Arduino read so: ``HX711 reading: 124006`` and
    ``one reading:\t16.1\t| average:\t4.2``. Half a line waits for its end; one without a number
    is passed over.
    """

    def __init__(self) -> None:
        self._rest = b""
        self._begun = False

    def feed(self, data: bytes) -> list[float]:
        """Return the readings that `data` completes."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        self._rest = self._rest[-MAX_LINE_LENGTH:]
        if lines and not self._begun:
            # A link begins in the middle of a line, whose number may be cut.
            self._begun, lines = True, lines[1:]
        readings = []
        for line in lines:
            _, colon, after = line.partition(b":")
            found = _NUMBER.search(after if colon else line)
            if found is not None:
                readings.append(float(found[0]))
        return readings


class AuxiliaryLoadCell:
    """Read a load cell that sends text, and lay its readings on an autopilot's time.

    A reading counts from the arrival of its line; what the amplifier and the wire take before (an
    HX711 at 80 Hz about 15 ms, at 10 Hz 100 ms) is not known and not taken off.
    """

    def __init__(self, transport: Transport, name: str, clock: Callable[[], float]) -> None:
        self._transport, self._name, self._clock = transport, name, clock
        self._lines = LoadCellDecoder()
        self._waiting: list[tuple[float, float]] = []
        self._last_us = 0
        self._received = b""

    def open(self) -> None:
        """Open the port and wait for the first reading; whoever owns the port closes it."""
        self._lines, self._waiting, self._last_us = LoadCellDecoder(), [], 0
        self._transport.open()
        until_s = self._clock() + FIRST_LINE_TIMEOUT_S
        self._received = b""
        while not self._waiting:
            if self._clock() >= until_s:
                raise self._silence()
            self.poll(0.02)

    def poll(self, timeout_s: float = 0.0) -> None:
        data = self._transport.read(timeout_s)
        arrived_s = self._clock()
        if not self._waiting and len(self._received) < MAX_LINE_LENGTH:
            self._received += data
        self._waiting += [(arrived_s, value) for value in self._lines.feed(data)]

    def _silence(self) -> NoDevice | ProtocolError:
        if not self._received:
            return NoDevice(
                f"the load cell on {self._name} sent nothing for {FIRST_LINE_TIMEOUT_S:g} s; "
                f"check its power, its program and the port's name"
            )
        if identify_device(self._received) in ("noise", "frames"):
            return ProtocolError(
                f"the load cell on {self._name} sends bytes that are no text "
                f"({bytes(self._received[:40])!r}); the baud rate is wrong: write it behind the "
                f"port's name, as cell=/dev/ttyUSB1:57600"
            )
        return ProtocolError(
            f"what hangs on {self._name} sends text without a number "
            f"({bytes(self._received[:40])!r}); it is no load cell, or another program runs on it"
        )

    def rows(
        self, host_s: Callable[[float], float], clock: DeviceClock, width: int, columns: list[int]
    ) -> tuple[NDArray[np.int64], Array]:
        """Return device times (m,): us and rows (m, width) of the readings since the last call.

        Args:
            host_s: turns wall time into the bench's.
            clock: has learnt how the autopilot's time lies on that.
            columns: where the reading goes.
        """
        waiting, self._waiting = self._waiting, []
        offset_s = float(clock.host_time_s(np.zeros(1, np.int64))[0])
        values = np.full((len(waiting), width), np.nan)
        times_us = np.empty(len(waiting), np.int64)
        for row, (arrived_s, value) in enumerate(waiting):
            values[row, columns] = value
            at_us = round(1e6 * (host_s(arrived_s) - offset_s))
            times_us[row] = self._last_us = max(at_us, self._last_us + 1)
        return times_us, values


def merge_in_order(
    first: tuple[NDArray[np.int64], Array],
    second: tuple[NDArray[np.int64], Array],
    after_us: int,
) -> tuple[NDArray[np.int64], Array]:
    """Return rows of two sources (times (m,): us, values (m, c)) as one, in order of time.

    Every row comes later than `after_us` and than the row before: one that came late moves behind
    what was handed out already.
    """
    times_us = np.concatenate([first[0], second[0]])
    values = np.concatenate([first[1], second[1]])
    order = np.argsort(times_us, kind="stable")
    times_us, values = times_us[order], values[order]
    steps = np.arange(len(times_us))
    return np.maximum.accumulate(np.maximum(times_us, after_us + 1) - steps) + steps, values
