"""Addresses of the RCbenchmark bridge, and what is told apart when one is opened."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from benchtool.bench.addresses import RcbAddress
from benchtool.bench.drivers import open_bench, parse_address
from benchtool.bench.rcbenchmark import link as rcb_talk
from benchtool.bench.rcbenchmark.bench import RcbBench
from benchtool.core.errors import NoDevice, PortBusy, ProtocolError
from benchtool.core.rig_file import rig_named
from benchtool.physics.model_file import load_model
from benchtool.testing.loopback_link import LoopbackLink
from benchtool.virtual.bridge import VirtualBridge
from benchtool.virtual.devices import hello_of, virtual_plant
from benchtool.virtual.firmware import Firmware


def test_an_address_says_both_ports() -> None:
    text = "rcbudp:127.0.0.1:55047"
    found = parse_address(text)
    assert found == RcbAddress(text=text, host="127.0.0.1", port=55047, listen=64126)
    assert found.warning == ""
    other = parse_address("rcbudp:192.168.1.7:5000?listen=5001&thrust_scale=-1")
    assert isinstance(other, RcbAddress)
    assert (other.port, other.listen, other.thrust_scale) == (5000, 5001, -1.0)
    assert "listening on UDP port 5001 of every network" in other.warning


@contextmanager
def saying(data: bytes) -> Iterator[int]:
    """Answer everything that comes to a UDP port with the same bytes."""
    ended = threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        own.settimeout(0.02)

        def answer() -> None:
            while not ended.is_set():
                try:
                    _, peer = own.recvfrom(2048)
                    own.sendto(data, peer)
                except TimeoutError:
                    continue

        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        try:
            yield own.getsockname()[1]
        finally:
            ended.set()
            thread.join(2.0)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b'{"thrust": {"workingValue": 1}}', "not through benchtool's bridge script"),
        (b"<Idle|MPos:0.000|FS:0,0>\r\n", "which no bridge script says"),
        (b'{"benchtool": {"bridge": 4}}\n', "has version 4, this program needs 1"),
    ],
)
def test_what_answers_instead_is_told_apart(
    data: bytes, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rcb_talk, "HELLO_S", 0.3)
    with saying(data) as port, pytest.raises(ProtocolError, match=said) as caught:
        open_bench(f"rcbudp:127.0.0.1:{port}?listen=0").open()
    assert "\n" not in str(caught.value)


def test_silence_says_what_to_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rcb_talk, "HELLO_S", 0.2)
    with pytest.raises(NoDevice, match="start the bridge script in the GUI"):
        open_bench("rcbudp:127.0.0.1:9?listen=0").open()


def test_a_port_in_use_is_named() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        taken = own.getsockname()[1]
        with pytest.raises(PortBusy, match=f"another program listens on UDP port {taken}"):
            open_bench(f"rcbudp:127.0.0.1:55047?listen={taken}").open()


class LateReadings(VirtualBridge):
    """Hand out readings half a second after they were made; answers come at once."""

    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        _, made = super().tick(n, now_s)
        self.made = [*getattr(self, "made", []), *((now_s, line) for line in made)]
        ready = [line for made_s, line in self.made if made_s <= now_s - 0.5]
        self.made = self.made[len(ready) :]
        return b"", ready


def test_a_reading_from_before_the_order_does_not_end_the_wait_for_the_plate() -> None:
    rig = rig_named("pquad_single")
    truth = load_model("single", rig).model
    plant = virtual_plant(rig, truth, 2)
    device = LateReadings(Firmware(plant, hello_of(plant, truth, 2)))
    link = LoopbackLink(device, lambda: plant.rate_Hz)
    with RcbBench(link, "rcbudp:loop", clock=link.clock) as bench:
        for z_m in (0.1, 0.3):
            bench.move_plate(z_m)
            assert not plant.plate_moving
