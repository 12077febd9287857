"""Virtual benches as devices: simulated physics, device information, server."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from benchtool import __version__
from benchtool.bench.drivers import SimAddress
from benchtool.bench.serial.hello import MAX_SPEED, Hello
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig import Rig
from benchtool.core.schedule import load_schedule
from benchtool.core.toml_text import build_dataclass
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
from benchtool.virtual.server import BenchServer, DeviceLink, ServedDevice


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
    # Sequence, time and checksum, then so many characters for each value, roughly
    digits = 9 if isinstance(plant, PlateBench) else 13
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
        frame_bytes=26 + digits * len(plant.channels),
        **more,
    )


def build_hello(plant: PlateBench, truth: Model, seed: int) -> Hello:
    """Return the device information of the virtual bench of a plant."""
    facts = {
        "rig": plant.rig.name,
        "truth": truth.name,
        "seed": str(seed),
        "thrust_raw_N_per_count": f"{plant.count_N:.9g}",
    }
    return _hello(plant, "", seed, limits=device_limits(plant.rig), facts=facts)


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
    address: SimAddress,
    settings: Mapping[str, float] = MappingProxyType({}),  # as of `PitchSetup.with_changes`
    user_controller: type[PitchController] | None = None,  # runs at the rate of the gains
) -> PitchBenchPlant:
    """Return the simulated pitch bench of an address."""
    default = f"pitch_{rig.name}"
    if address.truth:
        model = load_model(address.truth, rig, address.permit).model
    elif default in model_names():
        model = load_model(default, rig).model
    else:
        model = Model.single(rig)
    if address.hidden:
        model = with_hidden_effects(model, address.hidden)
    controller = address.controller or "pid"
    gains = load_gains(address.gains or "s3")
    control = build_pitch_controller("pid" if user_controller else controller, gains)
    if PLATE_DISTANCE in settings:
        raise InputError(
            f"{PLATE_DISTANCE} cannot be set here: the schedule moves the plate; remove it"
        )
    setup = PitchSetup(
        bench=PitchBench.from_model(model),
        controls=(replace(control, name=controller),),
        schedule=load_schedule(address.schedule or "plate"),
    ).with_changes(settings)
    job = PitchJob(setup.bench, setup.controls[0])
    return PitchBenchPlant(job, setup.schedule, address.seed, address.rate_Hz, user_controller)


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
    return _hello(plant, "pitch ", seed, limits=limits, facts=facts, has_loop=True)


def standard_truth(rig: Rig) -> str:
    """Return the name of the default true model of a virtual bench of this rig."""
    return "single" if rig.n_discs == 1 else "quad_body_lift"


def load_truth(
    rig: Rig, name: str | None, permit: CodePermit = check_code_allowed
) -> tuple[Model, Imperfections]:
    """Return the true model of a virtual bench, and the imperfections in its file."""
    name = name or standard_truth(rig)
    loaded = load_model(name, rig, permit)
    where = f"{name}: [imperfections]"
    return loaded.model, build_dataclass(Imperfections, dict(loaded.imperfections), where)


@dataclass(frozen=True, slots=True, kw_only=True)
class ServerOptions:
    """Options of the server of a virtual bench."""

    seed: int = 0  # of noise and faults
    speed: float = 1.0  # device seconds per wall second
    faults: Sequence[Fault] = ()
    protocol: Callable[[Firmware], ServedDevice] = DeviceLink  # builds the protocol handler
    clock: Callable[[], float] = time.monotonic


def virtual_server(
    rig: Rig,
    truth: Model,
    link: ServerLink,
    options: ServerOptions,
    imperfections: Imperfections | None = None,
    rate_Hz: float = 200.0,
) -> BenchServer:
    """Return a server whose device is the virtual bench of a rig."""
    plant = virtual_plant(rig, truth, options.seed, imperfections, rate_Hz)
    return device_server(plant, build_hello(plant, truth, options.seed), link, options)


def device_server(
    physics: Plant, hello: Hello, link: ServerLink, options: ServerOptions
) -> BenchServer:
    """Return a server for a device."""
    if not 0.0 < options.speed <= MAX_SPEED:
        raise InputError(f"speed {options.speed:g} is outside 0 to {MAX_SPEED:g}; 1 is real time")
    plant = FaultyPlant(physics, options.faults)
    # Link faults use a separate random stream, so that the physics stays reproducible.
    link_rng = np.random.default_rng(np.random.SeedSequence(options.seed).spawn(1)[0])
    firmware = Firmware(plant, replace(hello, speed=options.speed), options.clock())
    return BenchServer(
        options.protocol(firmware),
        link,
        lambda: plant.rate_Hz,
        LinkFaults(options.faults, link_rng),
        plant.begin,
        options.clock,
    )
