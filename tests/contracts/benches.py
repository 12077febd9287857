"""Benches to hold against contracts: one case for every driver, and benches around them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import NamedTuple

from benchtool.bench.bench import Bench
from benchtool.bench.drivers import SimAddress, open_bench
from benchtool.bench.guard import GuardedBench
from benchtool.bench.mavlink.bench import MavlinkBench
from benchtool.bench.mavlink.settings import MavlinkSettings
from benchtool.bench.replay import ReplayBench
from benchtool.bench.serial.bench import SerialBench
from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.model_file import load_model
from benchtool.virtual.autopilot import VirtualAutopilot
from benchtool.virtual.devices import (
    ServerOptions,
    build_hello,
    pitch_hello,
    pitch_plant,
    virtual_plant,
    virtual_server,
)
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.links import ServerLink
from benchtool.virtual.server import DeviceLink, ServedDevice
from tests.contracts.text_stand_device import TextStandDevice, driver_of_the_page
from tests.doubles.loopback_link import LoopbackLink

RIG = load_rig_by_name("pquad_single")
TRUTH = load_model("single", RIG).model
STOP_US = RIG.propulsion.pwm_stop_us


def simulated() -> Bench:
    return open_bench("sim:pquad_single?seed=2")


def looped() -> Bench:
    plant = virtual_plant(RIG, TRUTH, 2)
    link = LoopbackLink(Firmware(plant, build_hello(plant, TRUTH, 2)), lambda: plant.rate_Hz)
    return SerialBench(link, "serial:loop", clock=link.clock)


def guarded() -> Bench:
    return GuardedBench(simulated(), RIG)


@contextmanager
def served(link: ServerLink) -> Iterator[Bench]:
    """Serve a virtual bench from a thread at 20 times real time."""
    server = virtual_server(RIG, TRUTH, link, ServerOptions(seed=2, speed=20.0), rate_Hz=100.0)
    ended = threading.Event()
    thread = threading.Thread(target=server.run, args=(lambda: not ended.is_set(),), daemon=True)
    thread.start()
    try:
        yield open_bench(link.address)
    finally:
        ended.set()
        thread.join(5.0)
        link.close()


def pitching() -> Bench:
    return open_bench("sim:pquad?mode=pitch&seed=2")


def pitching_looped() -> Bench:
    plant = pitch_plant(load_rig_by_name("pquad"), SimAddress(rig="pquad", seed=2))
    link = LoopbackLink(Firmware(plant, pitch_hello(plant, 2)), lambda: plant.rate_Hz)
    return SerialBench(link, "serial:loop", clock=link.clock)


def flown(kind: str) -> Bench:
    plant = virtual_plant(RIG, TRUTH, 2)
    hello = replace(build_hello(plant, TRUTH, 2), speed=20.0)
    device = VirtualAutopilot(Firmware(plant, hello), kind)
    link = LoopbackLink(device, lambda: plant.rate_Hz)
    return MavlinkBench(link, "mavlink:loop", MavlinkSettings(rotors=1), clock=link.clock)


def ardupilot() -> Bench:
    return flown("ardupilot")


def px4() -> Bench:
    return flown("px4")


def pitching_flown() -> Bench:
    plant = pitch_plant(load_rig_by_name("pquad"), SimAddress(rig="pquad", seed=2))
    firmware = Firmware(plant, replace(pitch_hello(plant, 2), speed=20.0))
    link = LoopbackLink(VirtualAutopilot(firmware, hover_us=1599.0), lambda: plant.rate_Hz)
    settings = MavlinkSettings(rotors=4, mode="pitch", arm="host", orientation=25)
    return MavlinkBench(link, "mavlink:loop", settings, clock=link.clock)


MAKERS = {"sim": simulated, "loop": looped, "guarded": guarded}
MAKERS |= {"ardupilot": ardupilot, "px4": px4}
PITCH_MAKERS = {"pitch": pitching, "pitch loop": pitching_looped, "pitch flown": pitching_flown}


class Case(NamedTuple):
    """Hold a bench, and the link whose far end is its virtual device; None without a link."""

    bench: Bench
    link: LoopbackLink | None = None


def linked(
    speak: Callable[[Firmware], ServedDevice], connect: Callable[[LoopbackLink], Bench]
) -> Case:
    """Return a bench on a link of this process that ends in a virtual device."""
    plant = virtual_plant(RIG, TRUTH, 2)
    firmware = Firmware(plant, build_hello(plant, TRUTH, 2))
    link = LoopbackLink(speak(firmware), lambda: plant.rate_Hz)
    return Case(connect(link), link)


def serial_case() -> Case:
    return linked(DeviceLink, lambda link: SerialBench(link, "serial:loop", clock=link.clock))


def mavlink_case() -> Case:
    settings = MavlinkSettings(rotors=1)
    return linked(
        VirtualAutopilot,
        lambda link: MavlinkBench(link, "mavlink:loop", settings, clock=link.clock),
    )


def stand_case() -> Case:
    """Return the driver that the page "write a driver" writes."""
    driver = driver_of_the_page()
    return linked(
        TextStandDevice, lambda link: driver.TextStand(link, "stand:loop", clock=link.clock)
    )


def replay_case() -> Case:
    """Return a second of a bench at rest, played back."""
    with simulated() as source:
        readings = source.read(1.0)
        return Case(
            ReplayBench(source.identity, readings.time_s, readings.device_time_us, readings.values)
        )


CASES: dict[str, Callable[[], Case]] = {  # a case for every driver, by the scheme of its addresses
    "sim": lambda: Case(simulated()),
    "serial": serial_case,
    "tcp": serial_case,
    "mavlink": mavlink_case,
    "replay": replay_case,
}
