"""The device's own guards: limits, latch, watchdog, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.bench.serial import commands as wire
from benchtool.virtual.firmware import REMIND_S, Firmware
from tests.wire.still_plant import StillPlant, still_hello

SPIN = wire.SetPwm((1200.0, 1200.0))


@pytest.fixture
def plant() -> StillPlant:
    return StillPlant()


@pytest.fixture
def device(plant: StillPlant) -> Firmware:
    return Firmware(plant, still_hello())


def kinds(device: Firmware) -> list[str]:
    return [event.kind for event in device.take_events()]


def test_watchdog_stops_the_motors_after_250_ms_without_a_line(
    device: Firmware, plant: StillPlant
) -> None:
    assert device.execute(SPIN, 0.0).ok
    device.note_host(0.125)
    device.advance(1, 0.374)
    assert plant.pwm_us.max() == 1200
    device.advance(1, 0.375)
    np.testing.assert_array_equal(plant.pwm_us, [1000, 1000])
    (event,) = device.take_events()
    assert (event.kind, event.text) == ("watchdog", "no line for 250 ms; motors stopped")
    assert event.stops_motors


def test_watchdog_halts_a_moving_plate(device: Firmware, plant: StillPlant) -> None:
    device.execute(wire.SendPlate(0.4), 0.0)
    device.advance(5, 0.05)
    device.advance(1, 0.30)
    assert not plant.plate_moving
    assert plant.z_m == pytest.approx(0.105)


def test_the_watchdog_does_not_wait_for_a_slow_stream(device: Firmware) -> None:
    device.execute(SPIN, 0.0)
    device.execute(wire.SetRate(1.0), 0.0)
    assert len(device.advance(0, 0.25).values) == 0
    assert kinds(device) == ["watchdog"]


def test_an_idle_device_waits_for_ever(device: Firmware) -> None:
    device.advance(10, 1000.0)
    assert kinds(device) == []


def test_a_stopped_device_wants_a_clear_and_repeats_why(device: Firmware) -> None:
    device.execute(SPIN, 0.0)
    device.advance(1, 0.3)
    refused = device.execute(SPIN, 0.31)
    assert not refused.ok
    assert "watchdog" in refused.reason
    assert "clear" in refused.reason
    assert device.execute(wire.SetPwm((1000.0, 1000.0)), 0.32).ok
    device.advance(1, 0.3 + REMIND_S)
    assert kinds(device) == ["watchdog", "watchdog"]
    assert device.execute(wire.Clear(), 1.4).ok
    assert device.execute(SPIN, 1.4).ok


@pytest.mark.parametrize(
    ("limit", "pwm_us", "voltage_V", "text"),
    [
        ("thrust_N", 1900.0, 12.0, "thrust_N 18 against limit 15; motors stopped"),
        ("voltage_min_V", 1200.0, 9.4, "voltage_V 9.4 against limit 10; motors stopped"),
    ],
)
def test_limits_on_every_tick(
    device: Firmware, plant: StillPlant, limit: str, pwm_us: float, voltage_V: float, text: str
) -> None:
    device.execute(wire.SetLimit("thrust_N", 15.0), 0.0)
    device.execute(wire.SetLimit("voltage_min_V", 10.0), 0.0)
    device.execute(wire.SetPwm((pwm_us, pwm_us)), 0.0)
    plant.voltage_V = voltage_V
    device.advance(2, 0.02)
    np.testing.assert_array_equal(plant.pwm_us, [1000, 1000])
    assert [(event.kind, event.text) for event in device.take_events()] == [("limit", text)]


def test_a_family_limit_guards_every_rotor() -> None:
    from benchtool.core.channel import Channel

    plant = StillPlant()
    plant.channels = tuple(
        Channel(name, "rpm" if name.startswith("rpm") else "V")
        for name in ("rpm1", "rpm2", "rpm3", "rpm10", "voltage_V")
    )
    plant.advance = lambda n: np.array([[1.0, 2.0, 3.0, 9000.0, 12.0]] * n)  # type: ignore[method-assign]
    device = Firmware(plant, still_hello(channels=plant.channels, limits={"rpm": 8000.0}))
    device.advance(1, 0.0)
    assert device.take_events()[0].text == "rpm10 9000 against limit 8000; motors stopped"


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (wire.SetPwm((1200.0,)), "2 pulses needed; 1 given"),
        (wire.SetPwm((1200.0, 1901.0)), "1000 to 1900 us"),
        (wire.SetPwm((900.0, 1200.0)), "1000 to 1900 us"),
        (wire.SendPlate(0.04), "outside 0.05 to 0.5 m"),
        (wire.SendPlate(0.6), "outside 0.05 to 0.5 m"),
        (wire.SetRate(9000.0), "outside 0 to 5000 Hz"),
        (wire.SetRate(-1.0), "outside 0 to 5000 Hz"),
        (wire.SetLimit("thrust_N", 31.0), "wider than 30"),
        (wire.SetLimit("voltage_min_V", 8.0), "wider than 9"),
        (wire.SetLimit("courage", 1.0), "known: "),
    ],
)
def test_refusals_say_why(device: Firmware, command: wire.Command, words: str) -> None:
    reply = device.execute(command, 0.0)
    assert not reply.ok
    assert words in reply.reason


def test_the_plate_moves_only_at_idle(device: Firmware) -> None:
    device.execute(SPIN, 0.0)
    assert "idle" in device.execute(wire.SendPlate(0.2), 0.0).reason
    device.execute(wire.SetPwm((1050.0, 1000.0)), 0.0)
    assert device.execute(wire.SendPlate(0.2), 0.0).ok
    assert "moving" in device.execute(SPIN, 0.0).reason


def test_arrival_is_told_once(device: Firmware) -> None:
    device.execute(wire.SendPlate(0.102), 0.0)
    assert device.execute(wire.RequestPlate(), 0.0).fields == ("1", "0.102", "0", "0")
    device.advance(1, 0.01)
    assert kinds(device) == []
    device.advance(5, 0.06)
    assert [(event.kind, event.text) for event in device.take_events()] == [
        ("arrived", "0.102,0,0")
    ]
    assert device.execute(wire.RequestPlate(), 0.0).fields == ("0", "0.102", "0", "0")


def test_stop_zeroes_motors_and_halts_the_plate_without_a_latch(
    device: Firmware, plant: StillPlant
) -> None:
    device.execute(wire.SendPlate(0.2), 0.0)
    assert device.execute(wire.StopDevice(), 0.0) == wire.Reply(True)
    assert not plant.plate_moving
    assert device.execute(SPIN, 0.0).ok
    device.execute(wire.StopDevice(), 0.0)
    np.testing.assert_array_equal(plant.pwm_us, [1000, 1000])


def test_tare_and_device_time(device: Firmware, plant: StillPlant) -> None:
    device.execute(SPIN, 0.0)
    device.execute(wire.TareDevice(), 0.0)
    rows = device.advance(3, 0.03)
    np.testing.assert_array_equal(rows.device_time_us, [10_000, 20_000, 30_000])
    np.testing.assert_array_equal(rows.values[::2, 2], [0.0, 0.0])
    device.execute(wire.SetRate(1000.0), 0.03)
    np.testing.assert_array_equal(device.advance(2, 0.032).device_time_us, [31_000, 32_000])
