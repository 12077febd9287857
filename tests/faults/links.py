"""Each link of a bench with a proxy in it: what the device speaks, what the host opens, and real
ports and sockets whose waiting is time of the test's clock.
"""

from __future__ import annotations

import select
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Protocol
from unittest import mock

from benchtool.bench.drivers import Address, TcpAddress, build_transport
from benchtool.bench.mavlink.bench import MavlinkBench
from benchtool.bench.mavlink.settings import parse_settings
from benchtool.bench.serial.bench import SerialBench
from benchtool.bench.stage.grbl import GrblStage
from benchtool.bench.transport.ports import SerialPort, TcpSocket
from benchtool.bench.transport.transport import Transport
from benchtool.core.errors import LinkLost
from benchtool.core.rig import Rig
from benchtool.virtual.autopilot import VirtualAutopilot
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.links import PtyLink, ServerLink, TcpLink
from benchtool.virtual.server import DeviceLink, ServedDevice
from tests.doubles.grbl import stage_option
from tests.faults.dialects import BenchLines, Dialect, MavlinkFrames
from tests.faults.proxy import Proxy

STEP_S = 0.004
ADDRESS = "tcp:127.0.0.1:1"
ARRIVES_S = 5.0
"""The kernel has so long to bring bytes from one end of a port of this process to the other."""


class Clocked(Protocol):
    """What a transport needs of a world."""

    now_s: float
    left_s: float | None

    def step(self) -> None: ...


class Far(ServerLink):
    """The proxy's far end, as the link that a virtual device listens on."""

    address = "loop"

    def __init__(self, proxy: Proxy) -> None:
        self._proxy = proxy

    def read(self) -> bytes:
        return self._proxy.far.outgoing.take()

    def write(self, data: bytes) -> int:
        self._proxy.far.incoming.waiting += data
        return len(data)

    def unplug(self) -> None:
        self._proxy.near.is_cut = True

    def replug(self) -> None:
        raise NotImplementedError


class Port:
    """The proxy's near end in the kernel: a terminal or a TCP port."""

    def __init__(self, proxy: Proxy, link: ServerLink) -> None:
        self.link, self.host = link, None
        self._proxy, self._is_cut = proxy, False

    def pump(self) -> None:
        """Carry between kernel and proxy; a cut pulls the plug."""
        near = self._proxy.near
        if near.is_cut and not self._is_cut:
            self._is_cut = True
            self.link.unplug()
        near.incoming.waiting += self.link.read()
        if data := near.outgoing.waiting:
            written = self.link.write(bytes(data))
            del data[:written]
            if written and not self._is_cut and self.host is not None:
                await_bytes(self.host._require_open())

    def await_host(self) -> None:
        """Wait until what the host has written is here."""
        link = self.link
        ours = link._ends[0] if isinstance(link, PtyLink) else (
            link._client if isinstance(link, TcpLink) else link._socket
        )  # fmt: skip
        if ours is not None and not self._is_cut:
            await_bytes(ours)


def await_bytes(handle: object) -> None:
    select.select([handle], [], [], ARRIVES_S)


class KernelTransport:
    """The host's own port or socket; its waits let the world run on.

    Args:
        real: the transport of the program.
        port: its other end.
    """

    baud = None

    def __init__(self, world: Clocked, proxy: Proxy, port: Port, real: Transport) -> None:
        self._world, self._proxy, self._port, self._real = world, proxy, port, real

    def open(self) -> None:
        self._proxy.connect()
        self._real.open()
        self._port.host = self._real

    def read(self, timeout_s: float) -> bytes:
        until_s = self._world.now_s + max(timeout_s, STEP_S)
        while self._world.now_s < until_s:
            self._world.step()
            if data := self._real.read(0.0):
                return data
        return b""

    def write(self, data: bytes) -> None:
        self._real.write(data)
        self._port.await_host()

    def close(self) -> None:
        self._world.step()
        self._port.host = None
        self._real.close()
        self._world.left_s = self._world.now_s


class MemoryTransport:
    """The host's end of a proxy without a port."""

    baud = None

    def __init__(self, world: Clocked, proxy: Proxy) -> None:
        self._world, self._proxy = world, proxy

    def open(self) -> None:
        self._proxy.connect()

    def _raise_if_cut(self) -> None:
        if self._proxy.near.is_cut:
            raise LinkLost(f"{ADDRESS} closed the connection; look at its power and cable")

    def read(self, timeout_s: float) -> bytes:
        until_s = self._world.now_s + max(timeout_s, STEP_S)
        while self._world.now_s < until_s:
            self._world.step()
            if data := self._proxy.near.outgoing.take():
                return data
            self._raise_if_cut()
        return b""

    def write(self, data: bytes) -> None:
        self._raise_if_cut()
        self._proxy.near.incoming.waiting += data

    def close(self) -> None:
        self._world.step()
        self._world.left_s = self._world.now_s


def _tcp() -> ServerLink:
    return TcpLink("127.0.0.1", 0)


@dataclass(frozen=True)
class Link:
    """One link: its port (None is memory), the device's protocol and the proxy's, the address."""

    port: Callable[[], ServerLink] | None = _tcp
    protocol: Callable[[Firmware], ServedDevice] = DeviceLink
    dialect: type[Dialect] = BenchLines
    address: Callable[[ServerLink], str] = lambda port: port.address
    has_stage: bool = False


LINKS = {
    "memory": Link(port=None),
    "tcp": Link(),
    "pty": Link(port=PtyLink),
    "mavlink": Link(
        protocol=VirtualAutopilot,
        dialect=MavlinkFrames,
        address=lambda port: f"mavlink:{port.address}?rotors=1",
    ),
    "grbl": Link(has_stage=True),
}


def stage_words(port: ServerLink, rig: Rig) -> list[str]:
    """Return what a host adds for a stage at a port."""
    return ["--stage", stage_option(port.address.removeprefix("serial:"), rig.plate)]


@contextmanager
def on_the_clock(  # type: ignore[no-untyped-def]
    world, wrapped: Callable[[object], object], staged: Callable[[object], object]
) -> Iterator[None]:
    """Let every driver of this process wait on a world's clock.

    Args:
        wrapped, staged: put a bench's transport, and that of a stage, on that clock.
    """

    def lines(real: object, address: Address) -> SerialBench:
        return SerialBench(wrapped(real), address.text, world.clock)

    openers = {
        "serial.bench.open_serial": lambda a: lines(
            TcpSocket(a.host, a.port) if isinstance(a, TcpAddress) else SerialPort(a.port, a.baud),
            a,
        ),
        "mavlink.bench.open_mavlink": lambda a: MavlinkBench(
            wrapped(build_transport(a)), a.text, parse_settings(a), clock=world.clock
        ),
        "stage.grbl.GrblStage": partial(GrblStage, clock=world.clock),
        "transport.ports.SerialPort": lambda *given: staged(SerialPort(*given)),
    }
    with ExitStack() as patched:
        for name, opener in openers.items():
            patched.enter_context(mock.patch(f"benchtool.bench.{name}", opener))
        yield
