"""Put a virtual bench together: physics, firmware, faults, and the link that it listens on."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from benchtool.bench.serial.hello import LARGEST_SPEED
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.physics.model import Model
from benchtool.simulate.imperfections import Imperfections
from benchtool.virtual.device import hello_of, virtual_plant
from benchtool.virtual.device_link import DeviceLink
from benchtool.virtual.faults import Fault, LinkFaults
from benchtool.virtual.faulty_plant import FaultyPlant
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.served_device import ServedDevice
from benchtool.virtual.server import BenchServer
from benchtool.virtual.server_links import ServerLink


def standard_truth(rig: Rig) -> str:
    """Return the name of the model that a virtual bench of this rig obeys unless told otherwise."""
    return "single" if rig.n_discs == 1 else "quad_body_lift"


def virtual_server(
    rig: Rig,
    truth: Model,
    link: ServerLink,
    *,
    seed: int = 0,
    speed: float = 1.0,
    rate_Hz: float = 200.0,
    imperfections: Imperfections | None = None,
    faults: Iterable[Fault] = (),
    speak: Callable[[Firmware], ServedDevice] = DeviceLink,
    clock: Callable[[], float] = time.monotonic,
) -> BenchServer:
    """Return a server whose device is the virtual bench of a rig; `speak` is its protocol.

    Raises:
        InputError: a speed or a rate that makes no sense, or a fault of an unknown channel.
    """
    if not 0.0 < speed <= LARGEST_SPEED:
        raise InputError(f"speed {speed:g} is outside 0 to {LARGEST_SPEED:g}; 1 is real time")
    faults = tuple(faults)
    physics = virtual_plant(rig, truth, seed, imperfections, rate_Hz)
    plant = FaultyPlant(physics, faults)
    hello = replace(
        hello_of(physics, truth, seed),
        speed=speed,
        # Sequence, time and checksum, then about nine characters for each value.
        frame_bytes=26 + 9 * len(physics.channels),
    )
    # A stream of random numbers of its own, apart from that of the physics.
    link_rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(1)[0])
    return BenchServer(
        speak(Firmware(plant, hello, clock())),
        link,
        lambda: plant.rate_Hz,
        LinkFaults(faults, link_rng),
        plant.begin,
        clock,
    )
