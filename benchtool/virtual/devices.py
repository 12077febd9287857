"""Virtual benches as devices: simulated physics, device information, server."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from benchtool import __version__
from benchtool.bench.serial.hello import MAX_SPEED, Hello
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig import Rig
from benchtool.core.schedule import load_schedule
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.physics.catalogue import find_effect
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model, model_names
from benchtool.simulate.controllers.laws import build_pitch_controller
from benchtool.simulate.gain_file import load_gains
from benchtool.simulate.imperfections import Imperfections
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.run import PitchJob
from benchtool.simulate.pitch.setup import PLATE_DISTANCE, PitchSetup
from benchtool.simulate.pitch.simulate import PitchController
from benchtool.simulate.plate_bench import PlateBench
from benchtool.virtual.faults import Fault, FaultyPlant, LinkFaults
from benchtool.virtual.firmware import Firmware, Plant
from benchtool.virtual.links import ServerLink
from benchtool.virtual.pitch_plant import PitchBenchPlant, idle_us
from benchtool.virtual.protocol import DeviceLink
from benchtool.virtual.server import BenchServer, ServedDevice


def virtual_plant(
    rig: Rig,
    truth: Model,
    seed: int,
    imperfections: Imperfections | None = None,
    rate_Hz: float = 200.0,
) -> PlateBench:
    """Return the simulated physics of a rig, its random numbers from `seed`."""
    return PlateBench(rig, truth, np.random.default_rng(seed), imperfections, rate_Hz)


def _hello(plant: PlateBench | PitchBenchPlant, name: str, seed: int, **more: Any) -> Hello:
    rig = plant.rig
    return Hello(
        device_id=f"virtual-{name.replace(' ', '-')}{rig.name}-{seed}",
        firmware=f"benchtool virtual {name}bench {__version__}",
        n_rotors=rig.n_rotors,
        channels=plant.channels,
        channel_rates_Hz=plant.channel_rates_Hz,
        rate_Hz=plant.rate_Hz,
        pwm_stop_us=rig.propulsion.pwm_stop_us,
        pwm_idle_us=idle_us(rig),
        # The virtual device moves the plate, for every stage the rig file names.
        moves_plate=True,
        simulated=True,
        **more,
    )


def build_hello(plant: PlateBench, truth: Model, seed: int) -> Hello:
    """Return the device information of the virtual bench of a plant."""
    rig = plant.rig
    facts = {
        "rig": rig.name,
        "truth": truth.name,
        "seed": str(seed),
        "thrust_raw_N_per_count": f"{plant.count_N:.9g}",
    }
    return _hello(plant, "", seed, limits=device_limits(rig), facts=facts)


def device_limits(rig: Rig) -> dict[str, float]:
    """Return the limits that a device of this rig checks, by name."""
    limits = rig.limits
    return {
        "pwm_us": limits.pwm_us,
        "thrust_N": min(limits.thrust_N, limits.load_cell_rating_N),
        "rpm": limits.rpm,
        "current_A": limits.current_A,
        "voltage_min_V": limits.voltage_min_V,
        "temperature_degC": limits.temperature_degC,
        "plate_z_min_m": rig.plate.z_min_m,
        "plate_z_max_m": rig.plate.z_max_m,
        "plate_x_max_m": rig.plate_x_max_m,
    }


HIDDEN_EXAMPLE = "coulomb_friction.torque_Nm:0.012"


def with_hidden_effects(model: Model, text: str) -> Model:
    """Return the model with EFFECT.PARAMETER:VALUE[,...] applied, in SI units."""
    for item in text.split(","):
        name, _, value = item.partition(":")
        effect, _, parameter = name.partition(".")
        names = [entry.name for entry in find_effect(effect).parameters]
        if parameter not in names:
            raise UnknownChoice(f"parameter of effect {effect!r}", parameter, names)
        try:
            number = float(value)
        except ValueError:
            raise InputError(
                f"option hidden={item!r} does not end in a number; example: hidden={HIDDEN_EXAMPLE}"
            ) from None
        if name not in model.parameters:
            model = model.with_effect(effect)
        model = model.with_fixed(name, number)
    return model


PITCH_LIMIT_RAD = np.radians(45.0)  # device stops beyond; hinge stop is at 60°; assumed
RATE_LIMIT_RAD_S = 10.0  # device stops beyond; twice that of shipped schedules; assumed


def pitch_plant(
    rig: Rig,
    truth: str | None = None,  # model or its file; default: the rig's pitch model
    schedule: str = "plate",
    controller: str = "pid",
    gains: str = "s3",
    seed: int = 0,
    rate_Hz: float | None = None,  # stream rate; default: control rate
    user_controller: type[PitchController] | None = None,  # runs at the rate of the gains
    hidden: str = "",
    settings: Mapping[str, float] = MappingProxyType({}),  # as of `PitchSetup.with_changes`
    permit: CodePermit = check_code_allowed,
) -> PitchBenchPlant:
    """Return the simulated pitch bench for a model, schedule, controller and gains by name."""
    default = f"pitch_{rig.name}"
    if truth is not None:
        model = load_model(truth, rig, permit).model
    elif default in model_names():
        model = load_model(default, rig).model
    else:
        model = Model.single(rig)
    if hidden:
        model = with_hidden_effects(model, hidden)
    control = build_pitch_controller("pid" if user_controller else controller, load_gains(gains))
    if PLATE_DISTANCE in settings:
        raise InputError(
            f"{PLATE_DISTANCE} cannot be set here: the schedule moves the plate; remove it"
        )
    setup = PitchSetup(
        bench=PitchBench.from_model(model),
        controls=(replace(control, name=controller),),
        schedule=load_schedule(schedule),
    ).with_changes(settings)
    job = PitchJob(setup.bench, setup.controls[0])
    return PitchBenchPlant(job, setup.schedule, seed, rate_Hz, user_controller)


def pitch_hello(plant: PitchBenchPlant, seed: int) -> Hello:
    """Return the device information of the virtual pitch bench of a plant."""
    rig, job = plant.rig, plant.job
    gains = job.control.gains
    families = ("pwm", "rpm", "plate_z")
    limits = {k: v for k, v in device_limits(rig).items() if k.startswith(families)}
    limits |= {"theta_rad": float(PITCH_LIMIT_RAD), "gyro_rad_s": RATE_LIMIT_RAD_S}
    facts = {
        "mode": "pitch",
        "rig": rig.name,
        "truth": job.bench.model.name,
        "controller": job.control.name,
        "gains": gains.name if gains is not None else "none",
        "schedule": plant.schedule.name,
        "schedule_s": f"{plant.schedule.duration_s:g}",
        "control_rate_Hz": f"{plant.control_rate_Hz:g}",
        "seed": str(seed),
    }
    # Sequence, time and checksum, then about thirteen characters for each value.
    size = 26 + 13 * len(plant.channels)
    return _hello(
        plant, "pitch ", seed, limits=limits, facts=facts, has_loop=True, frame_bytes=size
    )


def standard_truth(rig: Rig) -> str:
    """Return the name of the default true model of a virtual bench of this rig."""
    return "single" if rig.n_discs == 1 else "quad_body_lift"


def virtual_server(
    rig: Rig,
    truth: Model,
    link: ServerLink,
    *,
    seed: int = 0,
    rate_Hz: float = 200.0,
    imperfections: Imperfections | None = None,
    **more: Any,
) -> BenchServer:
    """Return a server whose device is the virtual bench of a rig; see `device_server`."""
    plant = virtual_plant(rig, truth, seed, imperfections, rate_Hz)
    # Sequence, time and checksum, then about nine characters for each value.
    hello = replace(build_hello(plant, truth, seed), frame_bytes=26 + 9 * len(plant.channels))
    return device_server(plant, hello, link, seed=seed, **more)


def device_server(
    physics: Plant,
    hello: Hello,
    link: ServerLink,
    *,
    seed: int = 0,
    speed: float = 1.0,
    faults: Iterable[Fault] = (),
    protocol: Callable[[Firmware], ServedDevice] = DeviceLink,
    clock: Callable[[], float] = time.monotonic,
) -> BenchServer:
    """Return a server for a device; `protocol` builds its protocol handler."""
    if not 0.0 < speed <= MAX_SPEED:
        raise InputError(f"speed {speed:g} is outside 0 to {MAX_SPEED:g}; 1 is real time")
    faults = tuple(faults)
    plant = FaultyPlant(physics, faults)
    # Link faults use a separate random stream, so that the physics stays reproducible.
    link_rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(1)[0])
    return BenchServer(
        protocol(Firmware(plant, replace(hello, speed=speed), clock())),
        link,
        lambda: plant.rate_Hz,
        LinkFaults(faults, link_rng),
        plant.begin,
        clock,
    )
