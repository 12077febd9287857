"""A device of protocol version 1 is driven on, and is named as unprotected."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.bench.serial.bench import SerialBench
from benchtool.bench.serial.frames import messages_in
from benchtool.core.errors import HostPaused, ProtocolError
from benchtool.testing.loopback_link import LoopbackLink
from benchtool.virtual.faults import LinkFaults, fault_from
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.protocol import DeviceLink
from tests.wire.still_plant import StillPlant, still_hello
from tests.wire.version_1 import VersionOne


def wired(
    drop: float = 0.0, seed: int = 1, refuses: bool = False
) -> tuple[SerialBench, LoopbackLink, Firmware]:
    plant = StillPlant(200.0)
    firmware = Firmware(plant, still_hello(rate_Hz=200.0))
    faults = LinkFaults([fault_from(f"drop:p={drop}")], np.random.default_rng(seed))
    link = LoopbackLink(VersionOne(firmware, refuses), lambda: plant.rate_Hz, faults)
    return SerialBench(link, "serial:loop", clock=link.clock), link, firmware


def commands(link: LoopbackLink) -> list[tuple[str, ...]]:
    messages = messages_in(b"".join(link.sent))
    return [message.fields[1:] for message in messages if message.letter == "C"]


@pytest.mark.parametrize("refuses", [False, True])
def test_it_is_asked_twice_and_driven(refuses: bool) -> None:
    bench, link, firmware = wired(refuses=refuses)
    with bench:
        hellos = [("hello", "2"), ("hello", "1"), ("hello", "1")][0 if refuses else 1 :]
        assert [fields for fields in commands(link) if fields[0] == "hello"] == (
            hellos if refuses else [("hello", "2")] * 2
        )
        identity = bench.identity
        assert (identity.protocol, identity.orders_protected) == ("benchtool-1", False)
        assert "unprotected against late orders" in identity.facts["warning"]
        bench.move_plate(0.11)
        bench.set_pwm(np.array([1300.0, 1300.0]))
        assert firmware.pwm_us[0] == 1300.0
        assert len(bench.read(0.5))
        bench.stop()
        assert firmware.pwm_us[0] == 1000.0
    assert commands(link)[-2:] == [("stop",), ("rate", "0")]
    assert ("arm",) not in commands(link)


def test_a_stop_from_another_thread_is_obeyed() -> None:
    bench, _, firmware = wired()
    with bench:
        bench.set_pwm(np.array([1300.0, 1300.0]))
        bench.halt()
        assert firmware.pwm_us[0] == 1000.0


def test_numbers_start_over() -> None:
    bench, _, firmware = wired()
    with bench:
        bench._conversation._number = 65_533
        for step in range(6):
            bench.set_pwm(np.array([1300.0 + step, 1300.0]))
            assert firmware.pwm_us[0] == 1300.0 + step


def test_a_device_of_version_2_needs_no_second_hello() -> None:
    _, link, firmware = wired()
    link.device = DeviceLink(firmware)
    with SerialBench(link, "serial:loop", clock=link.clock) as bench:
        assert commands(link).count(("hello", "2")) == 1
        assert (bench.identity.protocol, bench.identity.orders_protected) == ("benchtool-2", True)
        assert "warning" not in bench.identity.facts
        assert bench.identity.channel_hash == still_hello().channel_hash


def test_bytes_lost_in_the_hello_never_exchange_channels() -> None:
    opened = 0
    for seed in range(30):
        bench, _, _ = wired(drop=0.001, seed=seed)
        try:
            bench.open()
        except ProtocolError:
            continue
        opened += 1
        assert bench.identity.channels == StillPlant.channels
        assert bench.identity.limits == still_hello().limits
    assert opened > 10


def test_no_order_to_turn_is_sent_again_after_a_pause_of_the_host() -> None:
    bench, link, firmware = wired()
    with bench:
        send = link.write

        def lose_and_stand_still(data: bytes) -> None:
            """Lose the first try; the computer is suspended while its answer is waited for."""
            if b",pwm," in data:
                link.write = send  # type: ignore[method-assign]
                link.pass_time(2.0)
            else:
                send(data)

        link.write = lose_and_stand_still  # type: ignore[method-assign]
        with pytest.raises(HostPaused, match=r"did not run benchtool for 2\.0 s"):
            bench.set_pwm(np.array([1300.0, 1300.0]))
        assert firmware.pwm_us.max() == 1000.0
        assert not [fields for fields in commands(link) if fields[0] == "pwm"]
