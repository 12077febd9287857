"""`benchtool bench`: a virtual bench as a process of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from annotated_types import Ge, Gt, Le

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs
from benchtool.simulate.user_controller import controller_class

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchtool.core.rig import Rig
    from benchtool.virtual.faults import Fault
    from benchtool.virtual.firmware import Firmware
    from benchtool.virtual.links import ServerLink
    from benchtool.virtual.server import BenchServer, ServedDevice

    Speak = Callable[[Firmware], ServedDevice]


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeInputs(Inputs):
    """What `benchtool bench serve` takes."""

    rig: Annotated[str, Input("Rig by name, or a rig file.")] = "pquad"
    truth: Annotated[
        str | None, Input("Model whose thrust the load cell shows; by name or file.")
    ] = None
    link: Annotated[
        str,
        Input("pty, tcp:PORT, tcp:HOST:PORT, mavlink (:pty, :tcp:PORT, ...).", group="Link"),
    ] = "pty"
    symlink: Annotated[Path | None, Input("A path that always leads to the pseudo-terminal.")] = (
        None
    )
    speed: Annotated[
        float, Gt(0.0), Le(1000.0), Input("Device seconds per wall second.", group="Simulation")
    ] = 1.0
    rate: Annotated[
        Annotated[float, Ge(1.0), Le(1000.0)] | None,
        Input("Samples per device second.", "Hz", default_text="200, or the controller's"),
    ] = None
    seed: Annotated[int, Ge(0), Input("Seed of noise and faults.")] = 0
    fault: Annotated[
        tuple[str, ...], Input("A fault, as silence:at_s=12,for_s=1; repeatable.")
    ] = ()
    mode: Annotated[
        Literal["plate", "pitch"], Input("A load cell, or a hinge with a controller.")
    ] = "plate"
    schedule: Annotated[str, Input("Pitch: schedule, or its file.", group="Pitch bench")] = "plate"
    controller: Annotated[str, Input("Pitch: controller; your own as module:Class.")] = "pid"
    gains: Annotated[str, Input("Pitch: gain set, or its file.")] = "s3"
    settings: Annotated[
        Mapping[str, float],
        Input("Pitch: NAME=VALUE, as K_b=1.8 or gains.attitude.k_q_per_s=8.", option="set"),
    ] = field(default_factory=dict)
    autopilot: Annotated[
        Literal["ardupilot", "px4"], Input("MAVLink: what it behaves like.", group="MAVLink")
    ] = "ardupilot"
    system: Annotated[int, Ge(1), Le(250), Input("MAVLink: its number.")] = 1
    key: Annotated[Path | None, Input("MAVLink: file with the key that signs every frame.")] = None


@command_from_inputs(ServeInputs)
def serve(inputs: ServeInputs) -> None:
    """Serve a virtual bench on a pseudo-terminal, TCP port or MAVLink until Ctrl-C."""
    import signal
    import sys

    from benchtool.core.rig_file import load_rig_by_name
    from benchtool.virtual.faults import parse_fault

    faults = [parse_fault(text) for text in inputs.fault]
    stands = load_rig_by_name(inputs.rig)
    device = _pitch if inputs.mode == "pitch" else _plate
    if inputs.settings and inputs.mode != "pitch":
        raise InputError("--set changes a pitch bench; add --mode pitch, or give --truth a file")
    if inputs.link.partition(":")[0] == "mavlink":
        speak, where, address = _mavlink(inputs, stands)
    else:
        speak, where, address = _own_protocol(inputs)
    # A service manager's end, and Ctrl-Break of a Windows console, close the link like Ctrl-C.
    for name in ("SIGTERM", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.default_int_handler)
    try:
        server, text = device(inputs, stands, where, faults, speak)
        print(address(), flush=True)
        ends = "no motor turns; Ctrl-C ends it"
        print(f"virtual {text}, speed {inputs.speed:g}; {ends}", file=sys.stderr)
        server.run()
    except KeyboardInterrupt:
        pass
    finally:
        where.close()


def _own_protocol(inputs: ServeInputs) -> tuple[Speak, ServerLink, Callable[[], str]]:
    from benchtool.virtual.links import open_link
    from benchtool.virtual.protocol import DeviceLink

    where = open_link(inputs.link, inputs.symlink)
    return DeviceLink, where, lambda: where.address


def _mavlink(inputs: ServeInputs, rig: Rig) -> tuple[Speak, ServerLink, Callable[[], str]]:
    from functools import partial
    from time import time

    from benchtool.acquire.pitch_experiment import hover_pulse_us
    from benchtool.bench.mavlink.settings import read_key
    from benchtool.virtual.autopilot import VirtualAutopilot
    from benchtool.virtual.links import host_address, open_link

    pitches, key = inputs.mode == "pitch", inputs.key
    speak = partial(
        VirtualAutopilot,
        kind=inputs.autopilot,
        system=inputs.system,
        key=read_key(key) if key else None,
        now_s=time(),
        hover_us=hover_pulse_us(rig) if pitches else None,
    )
    where = open_link(inputs.link, inputs.symlink)
    options = "&mode=pitch&arm=host" if pitches else ""
    options += f"&key={key}" if key else ""
    return speak, where, lambda: host_address(where, rig.n_rotors, options)


def _plate(
    inputs: ServeInputs, rig: Rig, link: ServerLink, faults: list[Fault], speak: Speak
) -> tuple[BenchServer, str]:
    from benchtool.core.toml_text import build_dataclass
    from benchtool.physics.model_file import load_model
    from benchtool.simulate.imperfections import Imperfections
    from benchtool.virtual.devices import standard_truth, virtual_server

    name = inputs.truth or standard_truth(rig)
    loaded = load_model(name, rig, announce_code)
    server = virtual_server(
        rig,
        loaded.model,
        link,
        seed=inputs.seed,
        speed=inputs.speed,
        rate_Hz=200.0 if inputs.rate is None else inputs.rate,
        imperfections=build_dataclass(
            Imperfections, dict(loaded.imperfections), f"{name}: [imperfections]"
        ),
        faults=faults,
        protocol=speak,
    )
    return server, f"bench of {rig.name}, truth {loaded.model.name}"


def _pitch(
    inputs: ServeInputs, rig: Rig, link: ServerLink, faults: list[Fault], speak: Speak
) -> tuple[BenchServer, str]:
    from benchtool.simulate.controllers.laws import PITCH_CONTROLLERS
    from benchtool.simulate.pitch.setup import changed_job
    from benchtool.virtual.devices import device_server, pitch_hello, pitch_plant

    controller = inputs.controller
    plant = pitch_plant(
        rig,
        inputs.truth,
        inputs.schedule,
        controller,
        inputs.gains,
        inputs.seed,
        inputs.rate,
        user_controller=(
            None
            if controller in PITCH_CONTROLLERS
            else controller_class(controller, PITCH_CONTROLLERS, announce_code)
        ),
        change=lambda job: changed_job(job, inputs.settings),
        permit=announce_code,
    )
    server = device_server(
        plant,
        pitch_hello(plant, inputs.seed),
        link,
        seed=inputs.seed,
        speed=inputs.speed,
        faults=faults,
        protocol=speak,
    )
    return server, (
        f"pitch bench of {rig.name}, truth {plant.job.bench.model.name}, {controller} with gains "
        f"{inputs.gains}, schedule {plant.schedule.name} of {plant.schedule.duration_s:g} s"
    )
