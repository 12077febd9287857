"""Command `benchtool bench serve`: virtual bench in a separate process."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from annotated_types import Ge, Gt, Le

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.choices import BenchMode
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs
from benchtool.simulate.controllers.controller import load_controller_class

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchtool.core.rig import Rig
    from benchtool.virtual.faults import Fault
    from benchtool.virtual.firmware import Firmware
    from benchtool.virtual.links import ServerLink
    from benchtool.virtual.server import BenchServer, ServedDevice

    WrapFirmware = Callable[[Firmware], ServedDevice]


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeInputs(Inputs):
    """Options of `benchtool bench serve`."""

    rig: Annotated[str, Input("Rig name or file.")] = "pquad"
    truth: Annotated[str | None, Input("Model of the simulated thrust: name or file.")] = None
    link: Annotated[
        str, Input("pty, tcp:PORT, tcp:HOST:PORT, mavlink (:pty, :tcp:PORT, ...).", group="Link")
    ] = "pty"
    symlink: Annotated[Path | None, Input("Symbolic link to the pseudo-terminal.")] = None
    speed: Annotated[float, Gt(0.0), Le(1000.0), Input("Time factor.", group="Simulation")] = 1.0
    rate: Annotated[
        Annotated[float, Ge(1.0), Le(1000.0)] | None,
        Input("Sampling rate.", "Hz", default_text="200, or controller rate"),
    ] = None
    seed: Annotated[int, Ge(0), Input("Seed of noise and faults.")] = 0
    fault: Annotated[
        tuple[str, ...], Input("Injected fault, e.g. silence:at_s=12,for_s=1; repeatable.")
    ] = ()
    mode: Annotated[BenchMode, Input("Load cell with plate, or hinged beam with controller.")] = (
        "plate"
    )
    schedule: Annotated[str, Input("Pitch: schedule name or file.", group="Pitch bench")] = "plate"
    controller: Annotated[str, Input("Pitch: controller, or module:Class.")] = "pid"
    gains: Annotated[str, Input("Pitch: gain set or file.")] = "s3"
    settings: Annotated[
        Mapping[str, float], Input("Pitch: NAME=VALUE, e.g. K_b=1.8; repeatable.", option="set")
    ] = field(default_factory=dict)
    autopilot: Annotated[
        Literal["ardupilot", "px4"], Input("MAVLink: autopilot to emulate.", group="MAVLink")
    ] = "ardupilot"
    system: Annotated[int, Ge(1), Le(250), Input("MAVLink: system id.")] = 1
    key: Annotated[Path | None, Input("MAVLink: signing key file.")] = None


@command_from_inputs(ServeInputs)
def serve(inputs: ServeInputs) -> None:
    """Serve a virtual bench on a pseudo-terminal, TCP port or MAVLink until Ctrl-C."""
    import signal
    import sys

    from benchtool.core.rig_file import load_rig_by_name
    from benchtool.virtual.faults import parse_fault

    faults = [parse_fault(text) for text in inputs.fault]
    rig = load_rig_by_name(inputs.rig)
    build_server = _build_pitch_server if inputs.mode == "pitch" else _build_plate_server
    if inputs.settings and inputs.mode != "pitch":
        raise InputError("--set needs a pitch bench; add --mode pitch, or use --truth FILE")
    if inputs.link.partition(":")[0] == "mavlink":
        wrap, link, format_address = _mavlink(inputs, rig)
    else:
        wrap, link, format_address = _bench_protocol(inputs)
    # SIGTERM and Ctrl-Break of a Windows console close the link like Ctrl-C.
    for name in ("SIGTERM", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.default_int_handler)
    try:
        server, text = build_server(inputs, rig, link, faults, wrap)
        print(format_address(), flush=True)
        speed = f"speed {inputs.speed:g}; no motor turns; Ctrl-C to stop"
        print(f"virtual {text}, {speed}", file=sys.stderr)
        server.run()
    except KeyboardInterrupt:
        pass
    finally:
        link.close()


def _bench_protocol(inputs: ServeInputs) -> tuple[WrapFirmware, ServerLink, Callable[[], str]]:
    from benchtool.virtual.links import open_link
    from benchtool.virtual.protocol import DeviceLink

    link = open_link(inputs.link, inputs.symlink)
    return DeviceLink, link, lambda: link.address


def _mavlink(inputs: ServeInputs, rig: Rig) -> tuple[WrapFirmware, ServerLink, Callable[[], str]]:
    from functools import partial
    from time import time

    from benchtool.acquire.inputs import hover_pulse_us
    from benchtool.bench.mavlink.settings import read_key
    from benchtool.virtual.autopilot import VirtualAutopilot
    from benchtool.virtual.links import host_address, open_link

    is_pitch, key = inputs.mode == "pitch", inputs.key
    wrap = partial(
        VirtualAutopilot,
        kind=inputs.autopilot,
        system=inputs.system,
        key=read_key(key) if key else None,
        now_s=time(),
        hover_us=hover_pulse_us(rig) if is_pitch else None,
    )
    link = open_link(inputs.link, inputs.symlink)
    options = "&mode=pitch&arm=host" if is_pitch else ""
    options += f"&key={key}" if key else ""
    return wrap, link, lambda: host_address(link, rig.n_rotors, options)


def _build_plate_server(
    inputs: ServeInputs, rig: Rig, link: ServerLink, faults: list[Fault], wrap: WrapFirmware
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
        protocol=wrap,
    )
    return server, f"bench of {rig.name}, truth {loaded.model.name}"


def _build_pitch_server(
    inputs: ServeInputs, rig: Rig, link: ServerLink, faults: list[Fault], wrap: WrapFirmware
) -> tuple[BenchServer, str]:
    from benchtool.simulate.controllers.laws import PITCH_CONTROLLERS
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
            else load_controller_class(controller, PITCH_CONTROLLERS, announce_code)
        ),
        settings=inputs.settings,
        permit=announce_code,
    )
    server = device_server(
        plant,
        pitch_hello(plant, inputs.seed),
        link,
        seed=inputs.seed,
        speed=inputs.speed,
        faults=faults,
        protocol=wrap,
    )
    return server, (
        f"pitch bench of {rig.name}, truth {plant.job.bench.model.name}, {controller} with gains "
        f"{inputs.gains}, schedule {plant.schedule.name} of {plant.schedule.duration_s:g} s"
    )
