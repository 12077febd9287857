"""A virtual device, its links with random faults, and one clock: that of its own, or the wall's.

Every link carries pieces, each what one end wrote at once. A fault takes the next few pieces of one
direction, or all of them for a while; when it begins is drawn, so that faults come at a stated mean
rate. Nothing here knows a protocol.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from benchtool.core.errors import LinkLost
from benchtool.core.rig_file import rig_named
from benchtool.physics.model_file import load_model
from benchtool.virtual.autopilot import VirtualAutopilot
from benchtool.virtual.devices import CarriedPlate, standard_truth, virtual_server
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.links import PtyLink, ServerLink, TcpLink
from benchtool.virtual.protocol import DeviceLink
from benchtool.virtual.server import ServedDevice
from tests.system.served import DeviceTime

STEP_S = 0.005
TURNING_US = 1051.0
"""A pulse from here on turns a rotor of the virtual bench (idle 1050 us)."""

WATCHDOG_S = 0.25
"""A device that heard nothing for so long stops its motors; that of a motor test, too."""

OLDEST_S = 0.5
"""An order of the bench protocol that is older turns nothing."""

ALLOWED_S = 0.03
"""What the steps of host, links and device add to those times."""

NAP_S = 0.001

LONGEST_S = 900.0
"""Time of the world after which a run hangs."""

WAYS = ("host", "device")
"""Where pieces go."""

FAULTS = {
    "drop": 4, "corrupt": 4, "duplicate": 3, "reorder": 3, "truncate": 3, "stall": 4, "hush": 1,
    "cut": 1,
}  # fmt: skip
"""What can go wrong, with weights: the last three hold pieces back for a while and deliver them at
once, lose all of both directions for good, and pull the cable."""

PIECES = 20
"""Most pieces that one fault takes; a choice, as are the weights and the longest stall."""

LONGEST_STALL_S = 1.5


PORTS: dict[str, Callable[[], ServerLink]] = {
    "pty": PtyLink,
    "tcp": lambda: TcpLink("127.0.0.1", 0),
}


class Hangs(BaseException):
    """The run did not end in LONGEST_S."""


@dataclass
class OneWay:
    """One direction of a link: what waits to be taken, and the fault that is at work."""

    waiting: bytearray = field(default_factory=bytearray)
    stalled: list[tuple[float, bytes]] = field(default_factory=list)
    kind: str = ""
    left: int = 0
    until_s: float = 0.0
    back: tuple[float, bytes] | None = None


class FaultyLink:
    """Carry pieces between a host and a device; it is also the link that the device listens on.

    Attributes:
        heard_s, written_s: when a whole piece of the host last reached the device, and when the
            host had written it.
        delivered: all that reached the host, where `keep` says so.
        faults: how many faults of each kind began here.
    """

    address = "soak"

    def __init__(self, clock: Callable[[], float], rng: random.Random, keep: bool = False) -> None:
        self.clock, self._rng, self._keep = clock, rng, keep
        self.ways = {way: OneWay() for way in WAYS}
        self.cut = self.hushed = False
        self.heard_s = self.written_s = -1e9
        self.delivered = bytearray()
        self.faults = dict.fromkeys(FAULTS, 0)

    def strike(self) -> None:
        """Begin a fault."""
        kind = self._rng.choices(list(FAULTS), list(FAULTS.values()))[0]
        self.faults[kind] += 1
        if kind == "cut":
            self.cut = True
        elif kind == "hush":
            self.hushed = True
        else:
            way = self.ways[self._rng.choice(WAYS)]
            way.kind, way.left = kind, self._rng.randint(1, PIECES)
            if kind == "stall":
                way.left = 1 << 30
                way.until_s = self.clock() + self._rng.uniform(0.05, LONGEST_STALL_S)

    def put(self, name: str, data: bytes) -> None:
        """Send a piece one way."""
        way, now_s = self.ways[name], self.clock()
        if not data or self.cut or self.hushed:
            return
        way.left -= 1
        if way.left < 0:
            way.left = 0
            self._deliver(name, data, now_s, whole=True)
        elif way.kind == "corrupt":
            bad = bytearray(data)
            bad[self._rng.randrange(len(bad))] ^= 1 << self._rng.randrange(8)
            self._deliver(name, bytes(bad), now_s, whole=False)
        elif way.kind == "duplicate":
            self._deliver(name, data + data, now_s, whole=True)
        elif way.kind == "truncate":
            self._deliver(name, data[: len(data) // 2], now_s, whole=False)
        elif way.kind == "stall":
            way.stalled.append((now_s, data))
        elif way.kind == "reorder":
            if way.back is None and way.left > 0:
                way.back = (now_s, data)
            else:
                self._deliver(name, data, now_s, whole=True)
                self._release_back(name)

    def _release_back(self, name: str) -> None:
        back, self.ways[name].back = self.ways[name].back, None
        if back is not None:
            self._deliver(name, back[1], back[0], whole=True)

    def step(self) -> None:
        """Deliver what was held back long enough."""
        for name, way in self.ways.items():
            if way.kind == "stall" and self.clock() >= way.until_s:
                way.kind, way.left, waiting = "", 0, way.stalled
                way.stalled = []
                for written_s, data in waiting:
                    self._deliver(name, data, written_s, whole=True)

    def _deliver(self, name: str, data: bytes, written_s: float, whole: bool) -> None:
        self.ways[name].waiting += data
        if name == "host" and self._keep:
            self.delivered += data
        if name == "device" and whole:
            self.heard_s, self.written_s = self.clock(), written_s

    def take(self, name: str) -> bytes:
        data = bytes(self.ways[name].waiting)
        self.ways[name].waiting.clear()
        return data

    def read(self) -> bytes:
        """Return what reached the device."""
        return self.take("device")

    def write(self, data: bytes) -> int:
        """Send from the device."""
        self.put("host", data)
        return len(data)

    def unplug(self) -> None:
        self.cut = True

    close = replug = unplug


class PortLink(FaultyLink):
    """Be such a link on a real port, whose other end a host opens."""

    def __init__(self, port: ServerLink, clock: Callable[[], float], rng: random.Random) -> None:
        super().__init__(clock, rng, keep=True)
        self._port = port
        self.address = port.address

    def read(self) -> bytes:
        self.put("device", self._port.read())
        return super().read()

    def step(self) -> None:
        super().step()
        out = self.ways["host"].waiting
        del out[: self._port.write(bytes(out))]
        if self.cut:
            self._port.unplug()

    def close(self) -> None:
        self._port.close()


class World:
    """One device on links with faults, on a clock that goes on only while the host waits.

    Args:
        kind: bench, autopilot, stage (a bench whose plate hangs on a G-code stage), or a bench on
            a real port: pty, tcp. The clock of those is the wall's, see `serving`.
        every_s: mean time between two faults; inf for none.

    Attributes:
        unsafe: moments at which motors turned without a live host, with why.
        turned_s: how long motors turned.
    """

    def __init__(self, kind: str, seed: int, every_s: float, speed: float = 5.0) -> None:
        self.kind, self.every_s = kind, every_s
        self._rng = random.Random(seed)
        names = ("bench", "stage") if kind == "stage" else ("bench",)
        self.is_real, self._device_time = kind in PORTS, DeviceTime()
        self.now_s = self._device_time()
        self.links = {
            name: PortLink(PORTS[kind](), self.clock, self._rng)
            if self.is_real
            else FaultyLink(self.clock, self._rng, keep=kind != "autopilot")
            for name in names
        }
        self.unsafe: list[str] = []
        self.turned_s = 0.0
        self.left_s: float | None = None
        self._end_s = self.now_s + (60.0 if self.is_real else LONGEST_S)
        self._strike_s = self.now_s + self._wait()
        rig = rig_named("pquad_single")
        truth = load_model(standard_truth(rig), rig).model

        def speak(firmware: Firmware) -> ServedDevice:
            self.firmware = firmware
            if kind == "autopilot":
                return VirtualAutopilot(firmware)
            device = DeviceLink(firmware)
            if kind == "stage":
                return CarriedPlate(device, firmware, self.links["stage"], rig.plate)
            return device

        self._server = virtual_server(
            rig, truth, self.links["bench"], seed=seed, speed=speed, speak=speak, clock=self.clock
        )

    def clock(self) -> float:
        return self.now_s

    @property
    def struck(self) -> dict[str, int]:
        """How many faults of each kind began."""
        return {k: sum(link.faults[k] for link in self.links.values()) for k in FAULTS}

    def _wait(self) -> float:
        return self.every_s * self._rng.expovariate(1.0)

    def step(self) -> None:
        before_s = self.now_s
        self.now_s = before_s + STEP_S if not self.is_real else self._device_time()
        if self.now_s > self._end_s:
            raise Hangs
        if self.now_s >= self._strike_s and self.left_s is None:
            self._rng.choice(list(self.links.values())).strike()
            self._strike_s += self._wait()
        for link in self.links.values():
            link.step()
        self._server.step()
        if max(self.firmware.pwm_us) >= TURNING_US:
            self.turned_s += self.now_s - before_s
            self._judge()

    def _judge(self) -> None:
        """Note motors that turn although no live host wants it."""
        link, now_s = self.links["bench"], self.now_s
        unheard_s, age_s = now_s - link.heard_s, now_s - link.written_s
        oldest_s = WATCHDOG_S + (LONGEST_STALL_S if self.kind == "autopilot" else OLDEST_S)
        if unheard_s > WATCHDOG_S + ALLOWED_S:
            self.unsafe.append(f"{now_s:.3f}: turning, nothing heard for {unheard_s:.3f} s")
        elif age_s > oldest_s + ALLOWED_S:
            self.unsafe.append(f"{now_s:.3f}: turning on what is {age_s:.3f} s old")
        elif self.left_s is not None and now_s > self.left_s + oldest_s + ALLOWED_S:
            self.unsafe.append(f"{now_s:.3f}: turning after the host left at {self.left_s:.3f}")

    def wait(self, seconds: float) -> None:
        """Let time pass while the host does nothing."""
        until_s = self.now_s + seconds
        while self.now_s < until_s:
            if self.is_real:
                time.sleep(NAP_S)
            else:
                self.step()

    @contextmanager
    def serving(self) -> Iterator[None]:
        """Let a device on a real port live in a thread until the end of the block."""
        ended = threading.Event()

        def live() -> None:
            try:
                while not ended.wait(NAP_S):
                    self.step()
            except Hangs:
                self.unsafe.append("the run hangs")
            self.links["bench"].close()

        thread = threading.Thread(target=live)
        if self.is_real:
            thread.start()
        try:
            yield
        finally:
            ended.set()
            if self.is_real:
                thread.join()


class HostEnd:
    """The host's port."""

    baud = None

    def __init__(self, world: World, name: str) -> None:
        self._world, self._link, self._name = world, world.links[name], name

    def open(self) -> None:
        self._link.take("host")

    def _raise_if_cut(self) -> None:
        if self._link.cut:
            raise LinkLost(f"{self._name} closed the connection; look at its power and cable")

    def read(self, timeout_s: float) -> bytes:
        until_s = self._world.now_s + max(timeout_s, STEP_S)
        while self._world.now_s < until_s:
            self._world.step()
            if data := self._link.take("host"):
                return data
            self._raise_if_cut()
        return b""

    def write(self, data: bytes) -> None:
        self._raise_if_cut()
        self._link.put("device", data)

    def close(self) -> None:
        self._world.step()
        if self._name == "bench":
            self._world.left_s = self._world.now_s
