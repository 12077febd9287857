"""What a bench on a link tells a listener: every sample once, as it comes, whatever waits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchtool.bench.bench import Bench, Readings, StreamingBench
from benchtool.bench.mavlink.bench import MavlinkBench
from benchtool.bench.mavlink.settings import MavlinkSettings
from benchtool.bench.stop_requests import StoppableBench
from benchtool.virtual.autopilot import VirtualAutopilot
from benchtool.virtual.devices import build_hello, virtual_plant
from benchtool.virtual.firmware import Firmware
from tests.contracts.benches import RIG, TRUTH, looped
from tests.doubles.loopback_link import LoopbackLink

LONGEST_S = 0.15  # longest silence that a watcher may see


def flown(kind: str) -> Bench:
    """Return a bench behind an autopilot, no faster than life."""
    plant = virtual_plant(RIG, TRUTH, 2)
    device = VirtualAutopilot(Firmware(plant, build_hello(plant, TRUTH, 2)), kind)
    link = LoopbackLink(device, lambda: plant.rate_Hz)
    return MavlinkBench(link, "mavlink:loop", MavlinkSettings(rotors=1), clock=link.clock)


MAKERS: dict[str, Callable[[], Bench]] = {
    "loop": looped,
    "ardupilot": lambda: flown("ardupilot"),
    "px4": lambda: flown("px4"),
}


@pytest.mark.parametrize("name", MAKERS)
def test_every_sample_is_told_once_and_as_it_comes(name):
    bench = MAKERS[name]()
    assert isinstance(bench, StreamingBench)
    told: list[Readings] = []
    moments_s: list[float] = []

    def listen(readings: Readings) -> None:
        told.append(readings)
        moments_s.append(bench.now_s())

    read: list[Readings] = []

    def gather(seconds: float) -> None:
        until_s = bench.now_s() + seconds
        while bench.now_s() < until_s:
            read.append(bench.read(0.05))

    with StoppableBench(bench, listen) as stoppable:
        gather(0.5)
        began_s = bench.now_s()
        stoppable.move_plate(1.2)
        assert bench.now_s() - began_s > 2.0 * LONGEST_S
        stoppable.tare()
        gather(0.5)
        stoppable.set_pwm(np.array([1300.0]))
        gather(0.5)
    assert np.diff(moments_s).max() < LONGEST_S
    for part in ("device_time_us", "time_s", "values"):
        heard = np.concatenate([getattr(readings, part) for readings in told])
        got = np.concatenate([getattr(readings, part) for readings in read])
        assert np.array_equal(heard[: len(got)], got, equal_nan=True)
        # What comes while the link is closed is heard, but nobody reads it.
        assert len(heard) - len(got) < 200
    assert sum(readings.lost for readings in told) == 0
    messages = [message for readings in told for message in readings.messages]
    assert messages == [message for readings in read for message in readings.messages]
    device_s = 1e-6 * np.concatenate([readings.device_time_us for readings in told])
    assert np.diff(device_s).max() < LONGEST_S
