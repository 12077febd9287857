"""Server of a virtual device on a link."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable

from benchtool.core.errors import BenchtoolError
from benchtool.virtual.faults import LinkFaults
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.links import ServerLink


class ServedDevice(ABC):
    """Device without a port, around a guarded plant; wall time is passed in."""

    def __init__(self, firmware: Firmware) -> None:
        self.firmware, self.speed = firmware, firmware.hello.speed
        self.host_since_s: float | None = None  # wall time of the hello; None before the first

    @abstractmethod
    def receive(self, data: bytes, now_s: float) -> bytes:
        """Process received bytes and return the replies."""

    @abstractmethod
    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        """Run n ticks; return bytes that must be sent, and frames that may be dropped."""

    @abstractmethod
    def report(self, kind: str, text: str) -> bytes:
        """Return an event for the host."""


POLL_INTERVAL_S = 0.004
MAX_CATCH_UP_S = 0.5  # maximum wall time that the physics catches up with
FAILURE_REPORT_S = 1.0  # duration of the report of a failure; assumed
OUTBOX_BYTES = 65536  # buffer on top of the link's; 0.6 s of 12 channels at 1 kHz; assumed


class ServerOutbox:
    """Send buffer: replies are always added, samples only while there is room."""

    def __init__(self, room_bytes: int = OUTBOX_BYTES) -> None:
        self.dropped = 0
        self._room_bytes = room_bytes
        self._waiting = bytearray()

    def add(self, data: bytes) -> None:
        self._waiting += data

    def add_sample(self, line: bytes) -> None:
        """Add a sample, or drop and count it if there is no room."""
        if len(self._waiting) + len(line) > self._room_bytes:
            self.dropped += 1
        else:
            self._waiting += line

    def flush(self, write: Callable[[bytes], int]) -> None:
        """Write as many bytes as `write` accepts."""
        if self._waiting:
            del self._waiting[: write(bytes(self._waiting))]

    def clear(self) -> None:
        self._waiting.clear()


class BenchServer:
    """Server of one device on one link, for one host at a time."""

    def __init__(
        self,
        device: ServedDevice,
        link: ServerLink,
        tick_Hz: Callable[[], float],  # current ticks per second of device time
        faults: LinkFaults | None = None,
        on_hello: Callable[[], None] = lambda: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.outbox = ServerOutbox()
        self._device = device
        self._link = link
        self._tick_Hz = tick_Hz
        self._faults = faults or LinkFaults()
        self._on_hello = on_hello
        self._clock = clock
        self._dropped_before = 0
        self._report_from = 1
        self._stalled_s, self._reported_stall_s = 0.0, 0.0
        self._owed = 0.0
        self._last_s = clock()
        self._host_since_s: float | None = None

    def run(
        self, running: Callable[[], bool] = lambda: True, interval_s: float = POLL_INTERVAL_S
    ) -> None:
        """Serve until `running` returns False; report an error of the device, then raise it."""
        while running():
            try:
                self.step()
            except BenchtoolError:
                until_s = self._clock() + FAILURE_REPORT_S
                while self._clock() < until_s:
                    self.step()
                    time.sleep(interval_s)
                raise
            time.sleep(interval_s)

    def step(self) -> None:
        """Read, advance the plant by the elapsed time, and write."""
        now_s = self._clock()
        answers = self._device.receive(self._link.read(), now_s)
        self._greet()
        since_s = 0.0 if self._host_since_s is None else now_s - self._host_since_s
        self._plug(since_s)
        self.outbox.add(self._faults.carry(answers, since_s))
        elapsed_s = min(now_s - self._last_s, MAX_CATCH_UP_S)
        self._stalled_s += now_s - self._last_s - elapsed_s
        self._last_s = now_s
        self._owed += elapsed_s * self._device.speed * self._tick_Hz()
        n, self._owed = int(self._owed), self._owed % 1.0
        # The watchdog is checked even if no tick is due.
        events, samples = self._device.tick(n, now_s)
        self.outbox.add(self._faults.carry(events, since_s))
        for line in samples:
            self.outbox.add_sample(self._faults.carry(line, since_s))
        self._report_problems()
        self.outbox.flush(self._link.write)

    def _greet(self) -> None:
        """Reset the problem counters if the host has sent a new hello."""
        if self._device.host_since_s != self._host_since_s:
            self._host_since_s = self._device.host_since_s
            self._dropped_before, self._report_from = self.outbox.dropped, 1
            self._stalled_s, self._reported_stall_s = 0.0, 0.0
            self._on_hello()

    def _plug(self, since_s: float) -> None:
        change = self._faults.plugged(since_s)
        if change is False:
            self.outbox.clear()
            self._link.unplug()
        elif change is True:
            self._host_since_s = None
            self._link.replug()

    def _report_problems(self) -> None:
        """Report at every doubling, so that reports do not fill a link that is already full."""
        if self._host_since_s is None:
            return
        count = self.outbox.dropped - self._dropped_before
        if count >= self._report_from:
            text = f"{count} samples dropped by the device since the hello; read faster"
            self.outbox.add(self._device.report("dropped", text))
            self._report_from = 2 * count
        if self._stalled_s > self._reported_stall_s:
            speed = self._device.speed
            text = (
                f"virtual bench stalled for {self._stalled_s * speed:.1f} s of device time; its "
                f"computer is busy or too slow for --speed {speed:g}"
            )
            self.outbox.add(self._device.report("stood_still", text))
            self._reported_stall_s = 2.0 * self._stalled_s
