"""A transport that ends in a device of the same process, on a clock that only reading moves."""

from __future__ import annotations

from collections.abc import Callable

from benchtool.virtual.faults import LinkFaults
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.server import DeviceLink, ServedDevice

STEP_S = 0.005


class LoopbackLink:
    """Wire a host to a `Firmware` without a port, a process or a wait.

    Args:
        firmware: the device, or what speaks for it on the wire.
        tick_Hz: ticks of its plant per second, at present.
        faults: what goes wrong on the way to the host.
        baud: what the port was opened with.
    """

    def __init__(
        self,
        firmware: Firmware | ServedDevice,
        tick_Hz: Callable[[], float],
        faults: LinkFaults | None = None,
        baud: int | None = None,
    ) -> None:
        self.now_s = 0.0
        self.device: ServedDevice = (
            DeviceLink(firmware) if isinstance(firmware, Firmware) else firmware
        )
        self.sent: list[bytes] = []
        self._tick_Hz = tick_Hz
        self._faults = faults or LinkFaults()
        self._baud = baud
        self._owed = 0.0
        self._answer = b""

    @property
    def baud(self) -> int | None:
        return self._baud

    def clock(self) -> float:
        """Return the common time of host and device in seconds."""
        return self.now_s

    def pass_time(self, time_s: float) -> None:
        """Let time pass in the device while the host does something else."""
        steps = max(1, round(time_s / STEP_S))
        for _ in range(steps):
            self.now_s += time_s / steps
            self._owed += time_s / steps * self.device.speed * self._tick_Hz()
            # A hair, so that a sum of small steps that should be 1 is not just below it.
            n = int(self._owed + 1e-9)
            self._owed -= n
            if n:
                events, samples = self.device.tick(n, self.now_s)
                self._answer += self._faults.carry(events + b"".join(samples), self._since_s())

    def open(self) -> None:
        self._answer = b""

    def read(self, timeout_s: float) -> bytes:
        self.pass_time(max(min(timeout_s, STEP_S), 1e-6))
        data, self._answer = self._answer, b""
        return data

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        answer = self.device.receive(data, self.now_s)
        self._answer += self._faults.carry(answer, self._since_s())

    def close(self) -> None:
        """Leave the device to its watchdog."""

    def _since_s(self) -> float:
        host_since_s = self.device.host_since_s
        return 0.0 if host_since_s is None else self.now_s - host_since_s
