"""The device's end of the wire: each command number is carried out once."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.bench.commands import SetPwm, SetRate, Tare
from benchtool.bench.device_link import DeviceLink
from benchtool.bench.firmware import Firmware
from benchtool.bench.hello import hello_from, hello_lines
from benchtool.bench.link import HEARTBEAT, Decoder, frame, frame_command
from benchtool.errors import ProtocolError
from tests.wire.still_plant import StillPlant, still_hello


@pytest.fixture
def plant() -> StillPlant:
    return StillPlant()


@pytest.fixture
def device(plant: StillPlant) -> DeviceLink:
    return DeviceLink(Firmware(plant, still_hello()))


def fields(answer: bytes) -> list[tuple[str, ...]]:
    return [(message.letter, *message.fields) for message in Decoder().feed(answer).messages]


def test_a_repeated_number_is_answered_again_but_not_carried_out(
    device: DeviceLink, plant: StillPlant
) -> None:
    spin = frame_command(4, SetPwm((1100.0, 1100.0)))
    first = device.receive(spin, 0.0)
    plant.pwm_us = np.zeros(2)
    assert device.receive(spin, 0.1) == first
    assert plant.pwm_us.max() == 0.0
    device.receive(frame_command(5, SetPwm((1100.0, 1100.0))), 0.2)
    assert plant.pwm_us.max() == 1100.0


def test_hello_starts_the_numbering_anew(device: DeviceLink, plant: StillPlant) -> None:
    device.receive(frame_command(1, SetPwm((1100.0, 1100.0))), 0.0)
    answer = fields(device.receive(frame(b"C,1,hello,1"), 0.0))
    assert answer[-1] == ("A", "1", "0", str(len(answer) - 1))
    assert hello_from([line[1:] for line in answer[:-1]]) == still_hello()


@pytest.mark.parametrize(
    ("payload", "words"),
    [
        (b"C,7,dance", "unknown command 'dance'"),
        (b"C,7,pwm,fast,1", "'fast' is not a number"),
        (b"C,7,pwm,nan,nan", "not finite"),
        (b"C,7,rate", "takes 1 fields, got 0"),
        (b"C,7,stop,now", "takes 0 fields, got 1"),
        (b"C,7,limit,1", "takes 2 fields, got 1"),
        (b"C,7,plate,0.1,0", "takes 3 fields, got 2"),
    ],
)
def test_nonsense_is_refused_in_words(device: DeviceLink, payload: bytes, words: str) -> None:
    (answer,) = fields(device.receive(frame(payload), 0.0))
    assert answer[:2] == ("N", "7")
    assert words in ",".join(answer)


@pytest.mark.parametrize("payload", [b"", b"C", b"C,7", b"C,x,stop", b"Q,1", b"S,1,2,3"])
def test_what_is_no_command_gets_no_answer(device: DeviceLink, payload: bytes) -> None:
    assert device.receive(frame(payload), 0.0) == b""


def test_any_valid_line_feeds_the_watchdog(device: DeviceLink, plant: StillPlant) -> None:
    device.receive(frame_command(1, SetPwm((1100.0, 1100.0))), 0.0)
    for step in range(1, 10):
        device.receive(HEARTBEAT, 0.2 * step)
        device.tick(1, 0.2 * step)
    assert plant.pwm_us.max() == 1100.0
    device.receive(b"garbage\n" * 3, 2.05)
    events, _ = device.tick(1, 2.06)
    assert fields(events)[0][:2] == ("E", "watchdog")


def test_samples_only_while_streaming(device: DeviceLink) -> None:
    assert device.tick(3, 0.0) == (b"", [])
    device.receive(frame_command(1, SetRate(100.0)), 0.0)
    assert device.tick(2, 0.0)[1] == [
        b"$S,0,40000,1000,1000,,0.1,12*1292\n",
        frame(b"S,1,50000,1000,1000,0,0.1,12"),
    ]


def test_every_command_is_acknowledged_with_device_time(device: DeviceLink) -> None:
    device.tick(5, 0.0)
    assert fields(device.receive(frame_command(9, Tare()), 0.0)) == [("A", "9", "50000")]


def test_hello_survives_its_text_and_names_what_is_missing() -> None:
    hello = still_hello(speed=20.0, simulated=True, baud=115200, watchdog_s=0.1)
    lines = hello_lines(hello)
    assert hello_from(lines) == hello
    assert hello_from([*lines, ("novelty", "1", "2")]) == hello
    with pytest.raises(ProtocolError, match="no line 'device'"):
        hello_from([line for line in lines if line[0] != "device"])
    with pytest.raises(ProtocolError, match="version 2, this program version 1"):
        hello_from([("protocol", "2"), *lines[1:]])
    with pytest.raises(ProtocolError, match="unknown unit 'furlong'"):
        hello_from([*lines, ("channel", "way", "furlong", "1")])
    with pytest.raises(ProtocolError, match="too few fields"):
        hello_from([*lines, ("channel", "way")])
