"""The device's end of the wire: each command number is carried out once."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.bench.serial import commands as wire
from benchtool.bench.serial.frames import HEARTBEAT, crc16, frame, frame_command, messages_in
from benchtool.bench.serial.hello import hello_from
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.protocol import DeviceLink
from tests.wire.still_plant import StillPlant, still_hello


@pytest.fixture
def plant() -> StillPlant:
    return StillPlant()


@pytest.fixture
def device(plant: StillPlant) -> DeviceLink:
    return DeviceLink(Firmware(plant, still_hello()))


def fields(answer: bytes) -> list[tuple[str, ...]]:
    return [(message.letter, *message.fields) for message in messages_in(answer)]


SPIN = wire.SetPwm((1100.0, 1100.0))


def say(device: DeviceLink, number: int, command: wire.Command, time_us: int | None = None) -> str:
    """Return the answer to a command that repeats the present device time."""
    present_us = device.firmware.device_time_us
    line = frame_command(number, command, present_us if time_us is None else time_us)
    (answer,) = fields(device.receive(line, 1e-6 * present_us))
    return ",".join((answer[0], *answer[3:])) if answer[0] == "A" else ",".join(answer)


def test_a_repeated_number_is_answered_again_but_not_carried_out(
    device: DeviceLink, plant: StillPlant
) -> None:
    say(device, 3, wire.ArmDevice())
    spin = frame_command(4, SPIN)
    first = device.receive(spin, 0.0)
    plant.pwm_us = np.zeros(2)
    assert device.receive(spin, 0.1) == first
    assert plant.pwm_us.max() == 0.0
    device.receive(frame_command(5, SPIN), 0.2)
    assert plant.pwm_us.max() == 1100.0


def test_hello_starts_the_numbering_anew_and_stops(device: DeviceLink, plant: StillPlant) -> None:
    say(device, 7, wire.ArmDevice())
    assert say(device, 8, SPIN) == "A"
    answer = fields(device.receive(frame_command(1, wire.RequestHello()), 0.0))
    assert plant.pwm_us.max() == 1000.0
    *lines, (letter, number, _, count, whole) = answer
    assert (letter, number, count) == ("A", "1", str(len(lines)))
    assert [line[:2] for line in lines] == [("H", str(index)) for index in range(len(lines))]
    said = "".join(",".join(line) + "\n" for line in lines)
    assert whole == f"{crc16(said.encode()):04X}"
    assert hello_from([line[2:] for line in lines]) == still_hello()
    assert say(device, 2, SPIN) == "N,2,0,not armed since the last stop; send arm first"


def test_a_host_of_version_1_is_refused(device: DeviceLink) -> None:
    (answer,) = fields(device.receive(frame(b"C,1,hello,1"), 0.0))
    assert answer == ("N", "1", "0", "this device speaks protocol version 2; update benchtool")


def test_only_an_armed_device_turns_or_moves(device: DeviceLink, plant: StillPlant) -> None:
    refused = "0,not armed since the last stop; send arm first"
    assert say(device, 1, SPIN) == f"N,1,{refused}"
    assert say(device, 2, wire.SendPlate(0.2)) == f"N,2,{refused}"
    assert say(device, 3, wire.SetPwm((1000.0, 1000.0))) == "A"
    assert say(device, 4, wire.ArmDevice()) == f"A,{still_hello().channel_hash}"
    assert say(device, 5, SPIN) == "A"
    for number, stop in ((6, wire.StopDevice()), (9, wire.Clear())):
        assert say(device, number, stop) == "A"
        assert plant.pwm_us.max() == 1000.0
        assert say(device, number + 1, SPIN) == f"N,{number + 1},{refused}"
        say(device, number + 2, wire.ArmDevice())


def test_a_latched_device_is_not_armed(device: DeviceLink, plant: StillPlant) -> None:
    plant.voltage_V = 5.0
    device.tick(1, 0.0)
    assert "send clear first" in say(device, 1, wire.ArmDevice())
    plant.voltage_V = 12.0
    say(device, 2, wire.Clear())
    assert say(device, 3, wire.ArmDevice()).startswith("A")


def test_an_order_with_a_lower_number_is_late(device: DeviceLink, plant: StillPlant) -> None:
    for number, command in (
        (1, wire.ArmDevice()),
        (5, SPIN),
        (6, wire.StopDevice()),
        (8, wire.ArmDevice()),
    ):
        assert say(device, number, command).startswith("A")
    assert say(device, 7, SPIN) == "N,7,0,late: number 7 comes after 8"
    assert say(device, 0, SPIN) == "N,0,0,late: number 0 comes after 8"
    assert plant.pwm_us.max() == 1000.0
    # A late order takes no number away from those that follow.
    assert say(device, 9, SPIN) == "A"


def test_an_order_older_than_half_a_second_is_late(device: DeviceLink, plant: StillPlant) -> None:
    device.tick(400, 0.0)  # 4 s
    say(device, 1, wire.ArmDevice())
    assert say(device, 2, SPIN, 3_490_000) == "N,2,4000000,late: 510 ms old; limit 500 ms"
    assert plant.pwm_us.max() == 1000.0
    assert say(device, 2, SPIN, 3_510_000) == "A"
    # One of a time to come is as old as the counter is wide.
    assert say(device, 3, SPIN, 4_010_000).startswith("N,3,4000000,late: 429")


def test_an_order_of_an_earlier_session_is_late(device: DeviceLink, plant: StillPlant) -> None:
    device.tick(400, 0.0)
    device.receive(frame_command(1, wire.RequestHello()), 4.0)
    device.tick(10, 4.1)
    assert say(device, 2, wire.ArmDevice()).startswith("A")
    assert say(device, 57, SPIN, 3_990_000) == "N,57,4100000,late: given before the last stop"
    assert say(device, 3, SPIN) == "A"


def test_age_counts_over_the_wrap_of_device_time(device: DeviceLink) -> None:
    device.firmware._device_us = 2.0**32 + 100_000.0
    assert say(device, 1, wire.ArmDevice(), (1 << 32) - 100_000).startswith("A")
    assert say(device, 2, SPIN, (1 << 32) - 500_000) == "N,2,100000,late: 600 ms old; limit 500 ms"


def test_age_is_wall_time_on_a_fast_virtual_bench(plant: StillPlant) -> None:
    device = DeviceLink(Firmware(plant, still_hello(speed=20.0)))
    device.tick(1000, 0.5)  # 10 s of device time in half a second
    assert say(device, 1, wire.ArmDevice(), 100_000).startswith("A")
    device.tick(2, 0.5)
    assert "late: 501 ms old; limit 500 ms" in say(device, 2, SPIN, 0)


@pytest.mark.parametrize("time", ["", "soon", "-5", "4294967296", "1" * 400, "1e3"])
def test_an_order_without_a_time_is_refused(device: DeviceLink, time: str) -> None:
    (answer,) = fields(device.receive(frame(b"C,1,arm,%b" % time.encode()), 0.0))
    assert answer[0] == "N"
    assert "is no device time" in ",".join(answer)


def test_a_stop_is_obeyed_whenever_it_comes(device: DeviceLink, plant: StillPlant) -> None:
    say(device, 10, wire.ArmDevice())
    for number in (3, 0):
        say(device, device.orders.number + 1, wire.ArmDevice())
        assert say(device, device.orders.number + 1, SPIN) == "A"
        assert say(device, number, wire.StopDevice(), 77) == "A"
        assert plant.pwm_us.max() == 1000.0
    assert say(device, 1, wire.RequestPlate()) == "A,0,,,"


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (b"C,7,dance", "unknown command 'dance'"),
        (b"C,7,pwm,0,fast,1", "'fast' is not a number"),
        (b"C,7,pwm,0,nan,nan", "not finite"),
        (b"C,7,rate", "takes 1 fields, got 0"),
        (b"C,7,stop,0,now", "takes 0 fields, got 1"),
        (b"C,7,limit,0,1", "takes 2 fields, got 1"),
        (b"C,7,plate,0,0.1,0", "takes 3 fields, got 2"),
    ],
)
def test_nonsense_is_refused_in_words(device: DeviceLink, payload: bytes, words: str) -> None:
    (answer,) = fields(device.receive(frame(payload), 0.0))
    assert answer[:2] == ("N", "7")
    assert words in ",".join(answer)


@pytest.mark.parametrize(
    "payload", [b"", b"C", b"C,7", b"C,x,stop", b"C,4294967296,stop", b"Q,1", b"S,1,2,3"]
)
def test_what_is_no_command_gets_no_answer(device: DeviceLink, payload: bytes) -> None:
    assert device.receive(frame(payload), 0.0) == b""


def test_any_valid_line_feeds_the_watchdog(device: DeviceLink, plant: StillPlant) -> None:
    say(device, 1, wire.ArmDevice())
    device.receive(frame_command(2, SPIN), 0.0)
    for step in range(1, 10):
        device.receive(HEARTBEAT, 0.2 * step)
        device.tick(1, 0.2 * step)
    assert plant.pwm_us.max() == 1100.0
    device.receive(b"garbage\n" * 3, 2.05)
    events, _ = device.tick(1, 2.06)
    assert fields(events)[0][:2] == ("E", "watchdog")


def test_samples_only_while_streaming(device: DeviceLink) -> None:
    assert device.tick(3, 0.0) == (b"", [])
    device.receive(frame_command(1, wire.SetRate(100.0)), 0.0)
    assert device.tick(2, 0.0)[1] == [
        b"$S,0,40000,1000,1000,,0.1,12*1292\n",
        frame(b"S,1,50000,1000,1000,0,0.1,12"),
    ]


def test_every_command_is_acknowledged_with_device_time(device: DeviceLink) -> None:
    device.tick(5, 0.0)
    assert fields(device.receive(frame_command(9, wire.TareDevice()), 0.0)) == [("A", "9", "50000")]
