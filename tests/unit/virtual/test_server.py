"""The loop that serves a virtual device, on a clock that is handed in."""

from __future__ import annotations

from benchtool.bench.serial.commands import RequestHello
from benchtool.bench.serial.frames import frame_command, messages_in
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.links import ServerLink
from benchtool.virtual.protocol import DeviceLink
from benchtool.virtual.server import BenchServer
from tests.wire.still_plant import StillPlant, still_hello


class Wire(ServerLink):
    """Carry one hello to the device, and hold what it sends."""

    address = "wire:"

    def __init__(self) -> None:
        self.waiting, self.sent = [frame_command(1, RequestHello())], b""

    def read(self) -> bytes:
        return self.waiting.pop() if self.waiting else b""

    def write(self, data: bytes) -> int:
        self.sent += data
        return len(data)

    def unplug(self) -> None:
        """Do nothing."""

    replug = unplug


def test_a_bench_that_cannot_keep_its_speed_says_so() -> None:
    now_s, wire = [0.0], Wire()
    device = DeviceLink(Firmware(StillPlant(), still_hello(speed=20.0)))
    server = BenchServer(device, wire, lambda: 100.0, clock=lambda: now_s[0])
    reports = []
    for step_s in (0.01, 0.4, 0.7, 0.01, 0.6, 0.01, 0.7):
        now_s[0] += step_s
        server.step()
        sent, wire.sent = wire.sent, b""
        fields = [message.fields for message in messages_in(sent)]
        reports.append([each[1] for each in fields if each[0] == "stood_still"])
    text = "the virtual bench stood still for {} s of its time: its computer is busy or too slow "
    said = text + "for --speed 20"
    # At every doubling: 0.2, 0.3 and 0.5 s of wall time were left out so far.
    assert reports == [[], [], [said.format(4.0)], [], [], [], [said.format(10.0)]]
