"""A bench behind a virtual autopilot on a virtual clock, and the time of both."""

from __future__ import annotations

import numpy as np

from benchtool.bench.mavlink.bench import MavlinkBench
from benchtool.bench.mavlink.settings import MavlinkSettings, MotorMap
from benchtool.virtual.autopilot import VirtualAutopilot
from benchtool.virtual.firmware import Firmware
from tests.doubles.loopback_link import LoopbackLink
from tests.wire.still_plant import StillPlant, still_hello

PLUS = MotorMap(rig="two", autopilot="ArduPilot", motors=(1, 2), outputs=(3, 1), escs=(3, 1))


KEY = bytes(range(32))


class Cell:
    """A load cell on a port of its own: ten counts for every second of the common clock."""

    baud = None

    def __init__(self, link: LoopbackLink) -> None:
        self._link, self._reported = link, 0

    def open(self) -> None:
        self._reported = 0

    def read(self, timeout_s: float) -> bytes:
        self._link.pass_time(timeout_s) if timeout_s else None
        told, self._reported = self._reported, int(self._link.now_s * 50)
        return b"HX711 reading: %d\n" % (10 * self._link.now_s) if told != self._reported else b""

    def close(self) -> None:
        """Do nothing."""


class Bench:
    """Give a bench, the virtual autopilot behind it, and the time of both."""

    def __init__(self, kind: str = "ardupilot", plant: StillPlant | None = None, **given) -> None:
        self.kind = kind
        key = given.pop("device_key", None)
        self.autopilot = self.booted(plant or StillPlant(), key)
        self.link = LoopbackLink(self.autopilot, lambda: 100.0, baud=given.pop("baud", None))
        settings = MavlinkSettings(**{"system": 1, **given})
        cell = Cell(self.link) if settings.cell else None
        self.bench = MavlinkBench(
            self.link,
            "mavlink:loop",
            settings,
            clock=self.link.clock,
            since_1970_s=lambda: 1.7e9,
            cell=cell,
        )

    def booted(self, plant: StillPlant, key: bytes | None = None) -> VirtualAutopilot:
        hello = still_hello(simulated=True)
        return VirtualAutopilot(Firmware(plant, hello), self.kind, key=key, now_s=1.7e9)

    def read(self, seconds: float) -> tuple[np.ndarray, list[str]]:
        """Read for so long; return values (m, c) and messages."""
        parts, messages = [], []
        until_s = self.bench.now_s() + seconds
        while (left_s := until_s - self.bench.now_s()) > 1e-9:
            readings = self.bench.read(min(left_s, 0.05))
            parts.append(readings.values)
            messages.extend(readings.messages)
        return np.concatenate(parts), messages

    def last(self, values: np.ndarray, name: str) -> float:
        names = [channel.name for channel in self.bench.identity.channels]
        column = values[:, names.index(name)]
        return float(column[np.isfinite(column)][-1])


def pulses(*given: float) -> np.ndarray:
    return np.array(given)


def make_real(made: Bench) -> None:
    """Let the heartbeat not say any more that no motor turns."""
    beat = made.autopilot._heartbeat

    def real() -> object:
        message = beat()
        message.base_mode &= ~32
        return message

    made.autopilot._heartbeat = real
