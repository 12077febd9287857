"""The device's end of the wire, and its own guards: limits, latch, watchdog, what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchtool.bench.serial.frames import HEARTBEAT, frame
from benchtool.core.channel import Channel
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.server import DeviceLink
from tests.wire.still_plant import StillPlant, still_hello

TALKS = Path(__file__).with_name("device_talks.txt").read_text("utf-8").strip().split("\n\n")
"""Payloads of the host, and behind the arrow those of the device; what comes while time passes; `!`
changes the plant (`device_us`: the device's clock), `=` gives the pulses of its motors."""


@pytest.fixture
def plant():
    return StillPlant()


@pytest.fixture
def device(plant):
    return DeviceLink(Firmware(plant, still_hello()))


def payloads(data: bytes) -> str:
    return " + ".join(line[1:-5] for line in data.decode().splitlines())


def play(line: str, device: DeviceLink, plant: StillPlant, tick: int) -> tuple[str, int]:
    """Do what a line says; return what comes of it, and how many ticks have passed."""
    name, *words = line.split()
    values = [float(word) for word in words if not word[0].isalpha()]
    if name == "=":
        return f"= {' '.join(f'{us:g}' for us in plant.pwm_us)}", tick
    if name == "!" and words[0] == "device_us":
        device.firmware._device_us = values[0]
    elif name == "!":
        setattr(plant, words[0], np.array(values) if words[0] == "pwm_us" else values[0])
    elif words[:1] == ["ms"]:
        said = b""
        for _ in range(int(name) // 10):
            tick += 1
            events, samples = device.tick(1, tick / 100)
            said += b"".join(samples) + events
        return payloads(said), tick
    else:
        return payloads(device.receive(frame(line.encode()), tick / 100)), tick
    return "", tick


@pytest.mark.parametrize("talk", TALKS, ids=lambda talk: talk.split("\n")[0])
def test_an_exact_conversation(talk, device, plant):
    tick = 0
    for line in talk.split("\n")[1:]:
        given, _, expected = line.partition(" ->")
        found, tick = play(given, device, plant, tick)
        if line.startswith("="):
            expected = line
        if expected.endswith("..."):
            expected, found = expected[:-3], found[: len(expected) - 4]
        assert found.strip() == expected.strip(), line


def test_age_is_wall_time_on_a_fast_virtual_bench(plant):
    device = DeviceLink(Firmware(plant, still_hello(speed=20.0)))
    device.tick(1000, 0.5)  # 10 s of device time in half a second
    assert payloads(device.receive(frame(b"C,1,arm,100000"), 0.5)).startswith("A,1,")
    device.tick(2, 0.5)
    assert "late: 501 ms old" in payloads(device.receive(frame(b"C,2,pwm,0,1100,1100"), 0.5))


def test_any_valid_line_feeds_the_watchdog_and_garbage_does_not(device, plant):
    device.receive(frame(b"C,1,arm,0") + frame(b"C,2,pwm,0,1100,1100"), 0.0)
    for step in range(1, 10):
        device.receive(HEARTBEAT, 0.2 * step)
        device.tick(1, 0.2 * step)
    assert plant.pwm_us.max() == 1100.0
    device.receive(b"garbage\n" * 3, 2.05)
    events, _ = device.tick(0, 2.06)  # nor does it wait for a tick of a slow stream
    assert payloads(events).startswith("E,watchdog")


def test_a_family_limit_guards_every_rotor():
    plant = StillPlant()
    plant.channels = tuple(
        Channel(name, "rpm" if name.startswith("rpm") else "V")
        for name in ("rpm1", "rpm2", "rpm3", "rpm10", "voltage_V")
    )
    plant.advance = lambda n: np.array([[1.0, 2.0, 3.0, 9000.0, 12.0]] * n)  # type: ignore[method-assign]
    device = Firmware(plant, still_hello(channels=plant.channels, limits={"rpm": 8000.0}))
    device.advance(1, 0.0)
    assert device.take_events()[0].text == "rpm10 9000 against limit 8000; motors stopped"
