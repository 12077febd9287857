"""The seam between a virtual device and the link that it is served on: bytes in, bytes out."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable

from benchtool.core.errors import BenchtoolError
from benchtool.virtual.faults import LinkFaults
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.links import ServerLink


class ServedDevice(ABC):
    """Be a device without a port, around a guarded plant; wall time is handed in."""

    def __init__(self, firmware: Firmware) -> None:
        self.firmware, self.speed = firmware, firmware.hello.speed
        self.host_since_s: float | None = None  # wall time; None before any

    @abstractmethod
    def receive(self, data: bytes, now_s: float) -> bytes:
        """Take what arrived and return the answers."""

    @abstractmethod
    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        """Run n ticks; return what must get through, and frames that may be dropped."""

    def report(self, kind: str, text: str) -> bytes:
        """Return an event for the host."""
        return b""


POLL_INTERVAL_S = 0.004
MAX_CATCH_UP_S = 0.5  # maximum wall time that the physics catches up with
FAILURE_S = 1.0  # a failed program is reported for so long; assumed
OUTBOX_BYTES = 65536  # buffer on top of the link's; 0.6 s of 12 channels at 1 kHz; assumed


class ServerOutbox:
    """Hold what is to be sent: answers always, samples only while there is room."""

    def __init__(self, room_bytes: int = OUTBOX_BYTES) -> None:
        self.dropped = 0
        self._room_bytes = room_bytes
        self._waiting = bytearray()

    def add(self, data: bytes) -> None:
        self._waiting += data

    def add_sample(self, line: bytes) -> None:
        """Add a sample, or drop and count it when there is no room."""
        if len(self._waiting) + len(line) > self._room_bytes:
            self.dropped += 1
        else:
            self._waiting += line

    def flush(self, write: Callable[[bytes], int]) -> None:
        """Hand over as much as `write` takes."""
        if self._waiting:
            del self._waiting[: write(bytes(self._waiting))]

    def clear(self) -> None:
        self._waiting.clear()


class BenchServer:
    """Serve one device over one link, to one host after another."""

    def __init__(
        self,
        device: ServedDevice,
        link: ServerLink,
        tick_Hz: Callable[[], float],  # per second of device time, at present
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
        self._stood_s, self._report_stood_s = 0.0, 0.0
        self._owed = 0.0
        self._last_s = clock()
        self._host_since_s: float | None = None

    def run(
        self, running: Callable[[], bool] = lambda: True, nap_s: float = POLL_INTERVAL_S
    ) -> None:
        """Serve until `running` returns False; report an error of the device, then raise it."""
        while running():
            try:
                self.step()
            except BenchtoolError:
                until_s = self._clock() + FAILURE_S
                while self._clock() < until_s:
                    self.step()
                    time.sleep(nap_s)
                raise
            time.sleep(nap_s)

    def step(self) -> None:
        """Read, let the time that has passed pass in the plant, and write."""
        now_s = self._clock()
        answers = self._device.receive(self._link.read(), now_s)
        self._greet()
        since_s = 0.0 if self._host_since_s is None else now_s - self._host_since_s
        self._plug(since_s)
        self.outbox.add(self._faults.carry(answers, since_s))
        passed_s = min(now_s - self._last_s, MAX_CATCH_UP_S)
        self._stood_s += now_s - self._last_s - passed_s
        self._last_s = now_s
        self._owed += passed_s * self._device.speed * self._tick_Hz()
        n, self._owed = int(self._owed), self._owed % 1.0
        # Without a tick due the watchdog still looks at the time.
        events, samples = self._device.tick(n, now_s)
        self.outbox.add(self._faults.carry(events, since_s))
        for line in samples:
            self.outbox.add_sample(self._faults.carry(line, since_s))
        self._report_troubles()
        self.outbox.flush(self._link.write)

    def _greet(self) -> None:
        """Start the count of what goes wrong anew with every hello."""
        if self._device.host_since_s != self._host_since_s:
            self._host_since_s = self._device.host_since_s
            self._dropped_before, self._report_from = self.outbox.dropped, 1
            self._stood_s, self._report_stood_s = 0.0, 0.0
            self._on_hello()

    def _plug(self, since_s: float) -> None:
        change = self._faults.plugged(since_s)
        if change is False:
            self.outbox.clear()
            self._link.unplug()
        elif change is True:
            self._host_since_s = None
            self._link.replug()

    def _report_troubles(self) -> None:
        """Report at every doubling, so that the events do not fill a line that is already full."""
        if self._host_since_s is None:
            return
        count = self.outbox.dropped - self._dropped_before
        if count >= self._report_from:
            text = f"{count} samples dropped by the device since the hello; read faster"
            self.outbox.add(self._device.report("dropped", text))
            self._report_from = 2 * count
        if self._stood_s > self._report_stood_s:
            speed = self._device.speed
            text = (
                f"the virtual bench stood still for {self._stood_s * speed:.1f} s of its time: its "
                f"computer is busy or too slow for --speed {speed:g}"
            )
            self.outbox.add(self._device.report("stood_still", text))
            self._report_stood_s = 2.0 * self._stood_s
