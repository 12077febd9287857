"""`benchtool bench`: a virtual bench as a process of its own."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchtool.commands.bridge import bridge
from benchtool.commands.check import check
from benchtool.commands.map_motors import map_motors

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchtool.core.rig import Rig
    from benchtool.virtual.faults import Fault
    from benchtool.virtual.firmware import Firmware
    from benchtool.virtual.links import ServerLink
    from benchtool.virtual.server import BenchServer, ServedDevice

    Speak = Callable[[Firmware], ServedDevice]
    PitchNames = tuple[str, str, str, list[str]]

app = typer.Typer(help="Serve a virtual bench; check a bench before motors spin.")


@app.callback()
def group() -> None:
    """Serve a virtual bench; check a bench before motors spin."""


app.command()(check)
app.command("map")(map_motors)
app.command()(bridge)


@app.command()
def serve(
    rig: Annotated[str, typer.Option(help="Rig by name, or a rig file.")] = "pquad",
    truth: Annotated[
        str | None, typer.Option(help="Model whose thrust the load cell shows; by name or file.")
    ] = None,
    link: Annotated[
        str,
        typer.Option(help="pty, tcp:PORT, tcp:HOST:PORT, mavlink (:pty, :tcp:PORT, ...), rcbudp."),
    ] = "pty",
    symlink: Annotated[
        Path | None, typer.Option(help="A path that always leads to the pseudo-terminal.")
    ] = None,
    grbl: Annotated[
        Path | None,
        typer.Option(help="Serve a G-code stage at this path as well; it alone moves the plate."),
    ] = None,
    speed: Annotated[float, typer.Option(help="Device seconds per wall second.")] = 1.0,
    rate: Annotated[
        float | None, typer.Option(help="Samples per device second, Hz; 200, or the controller's.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of noise and faults.")] = 0,
    fault: Annotated[
        list[str] | None, typer.Option(help="A fault, as silence:at_s=12,for_s=1; repeatable.")
    ] = None,
    mode: Annotated[
        str, typer.Option(help="plate (load cell), or pitch (hinge with a controller).")
    ] = "plate",
    schedule: Annotated[str, typer.Option(help="Pitch: schedule, or its file.")] = "plate",
    controller: Annotated[
        str, typer.Option(help="Pitch: controller; your own as module:Class.")
    ] = "pid",
    gains: Annotated[str, typer.Option(help="Pitch: gain set, or its file.")] = "s3",
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Pitch: NAME=VALUE, as K_b=1.8 or gains.attitude.k_q_per_s=8."),
    ] = None,
    autopilot: Annotated[
        str, typer.Option(help="MAVLink: what it behaves like, ardupilot or px4.")
    ] = "ardupilot",
    system: Annotated[int, typer.Option(min=1, max=250, help="MAVLink: its number.")] = 1,
    key: Annotated[
        Path | None, typer.Option(help="MAVLink: file with the key that signs every frame.")
    ] = None,
) -> None:
    """Run a virtual bench on a pseudo-terminal, TCP port or MAVLink until Ctrl-C."""
    import signal
    import sys

    from benchtool.core.errors import InputError, UnknownChoice
    from benchtool.core.rig_file import rig_named
    from benchtool.virtual.faults import fault_from
    from benchtool.virtual.grbl import stage_option
    from benchtool.virtual.simulated import MODES

    if mode not in MODES:
        raise UnknownChoice("mode", mode, MODES)
    faults = [fault_from(text) for text in fault or ()]
    stands = rig_named(rig)
    device = _pitch if mode == "pitch" else _plate
    named = (schedule, controller, gains, settings or [])
    if settings and mode != "pitch":
        raise InputError("--set changes a pitch bench; add --mode pitch, or give --truth a file")
    kind = link.partition(":")[0]
    if kind == "mavlink":
        speak, where, address = _mavlink(link, symlink, stands, mode, (autopilot, system, key))
    elif kind == "rcbudp":
        speak, where, address = _bridged(link, symlink, mode)
    else:
        speak, where, address = _own_protocol(link, symlink)
    stage = None if grbl is None else _carried(grbl, mode)
    if stage is not None:
        speak = _carrying(speak, stage, stands)
    # A service manager's end, and Ctrl-Break of a Windows console, close the link like Ctrl-C.
    for name in ("SIGTERM", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.default_int_handler)
    try:
        server, told = device(stands, truth, where, seed, speed, rate, faults, named, speak)
        print(address(), flush=True)
        if stage is not None:
            print(stage_option(str(grbl), stands.plate), flush=True)
        print(f"virtual {told}, speed {speed:g}; no motor turns; Ctrl-C ends it", file=sys.stderr)
        server.run()
    except KeyboardInterrupt:
        pass
    finally:
        where.close()
        if stage is not None:
            stage.close()


def _carried(path: Path, mode: str) -> ServerLink:
    """Return the link of a stage that carries the plate."""
    from benchtool.core.errors import InputError
    from benchtool.virtual.links import PtyLink

    if mode != "plate":
        raise InputError("--grbl moves the plate under a load cell; leave --mode pitch out")
    return PtyLink(path)


def _carrying(speak: Speak, link: ServerLink, rig: Rig) -> Speak:
    """Return a protocol whose device has its plate on a stage."""
    from benchtool.virtual.grbl import CarriedPlate

    return lambda firmware: CarriedPlate(speak(firmware), firmware, link, rig.plate)


def _own_protocol(link: str, symlink: Path | None) -> tuple[Speak, ServerLink, Callable[[], str]]:
    """Return protocol, link and address of a device that speaks the bench protocol."""
    from benchtool.virtual.links import link_named
    from benchtool.virtual.protocol import DeviceLink

    where = link_named(link, symlink)
    return DeviceLink, where, lambda: where.address


def _bridged(
    link: str, symlink: Path | None, mode: str
) -> tuple[Speak, ServerLink, Callable[[], str]]:
    """Return protocol, link and address of a virtual stand behind the RCbenchmark GUI."""
    from benchtool.bench.rcbenchmark.bridge_file import GUI_PORT, LOOPBACK
    from benchtool.core.errors import InputError
    from benchtool.virtual.bridge import VirtualBridge
    from benchtool.virtual.links import UdpLink, one_line

    port = link.partition(":")[2] or str(GUI_PORT)
    if symlink is not None or mode != "plate" or not port.isdecimal():
        raise InputError(
            f"link {link!r} is rcbudp or rcbudp:PORT, with a load cell and without --symlink; "
            f"leave --symlink and --mode out"
        )
    where = UdpLink(LOOPBACK, int(port), listen=True, fitting=one_line)
    # This stand answers whoever speaks, so that a host may listen on any port.
    return VirtualBridge, where, lambda: f"rcbudp:{where.place}?listen=0"


def _mavlink(
    link: str, symlink: Path | None, rig: Rig, mode: str, named: tuple[str, int, Path | None]
) -> tuple[Speak, ServerLink, Callable[[], str]]:
    """Return protocol, link and address of a device that behaves like an autopilot."""
    from functools import partial
    from time import time

    from benchtool.acquire.pitch_experiment import hover_pulse_us
    from benchtool.bench.mavlink.settings import read_key
    from benchtool.core.errors import UnknownChoice
    from benchtool.virtual.autopilot import VirtualAutopilot
    from benchtool.virtual.autopilot_orders import AUTOPILOTS
    from benchtool.virtual.links import autopilot_link, host_address

    kind, system, key = named
    if kind not in AUTOPILOTS:
        raise UnknownChoice("autopilot", kind, AUTOPILOTS)
    speak = partial(
        VirtualAutopilot,
        kind=kind,
        system=system,
        key=read_key(key) if key else None,
        now_s=time(),
        hover_us=hover_pulse_us(rig) if mode == "pitch" else None,
    )
    where = autopilot_link(link.partition(":")[2], symlink)
    options = "&mode=pitch&arm=host" if mode == "pitch" else ""
    options += f"&key={key}" if key else ""
    return speak, where, lambda: host_address(where, rig.n_rotors, options)


def _plate(
    rig: Rig,
    truth: str | None,
    link: ServerLink,
    seed: int,
    speed: float,
    rate_Hz: float | None,
    faults: list[Fault],
    _: PitchNames,
    speak: Speak,
) -> tuple[BenchServer, str]:
    from benchtool.commands.terminal.announce_code import announce_code, print_notes
    from benchtool.core.toml_text import build
    from benchtool.physics.model_file import load_model
    from benchtool.simulate.imperfections import Imperfections
    from benchtool.virtual.devices import standard_truth, virtual_server

    name = truth or standard_truth(rig)
    loaded = load_model(name, rig, announce_code)
    print_notes(loaded.notes)
    server = virtual_server(
        rig,
        loaded.model,
        link,
        seed=seed,
        speed=speed,
        rate_Hz=200.0 if rate_Hz is None else rate_Hz,
        imperfections=build(Imperfections, dict(loaded.imperfections), f"{name}: [imperfections]"),
        faults=faults,
        speak=speak,
    )
    return server, f"bench of {rig.name}, truth {loaded.model.name}"


def _pitch(
    rig: Rig,
    truth: str | None,
    link: ServerLink,
    seed: int,
    speed: float,
    rate_Hz: float | None,
    faults: list[Fault],
    named: PitchNames,
    speak: Speak,
) -> tuple[BenchServer, str]:
    from benchtool.commands.terminal.announce_code import announce_code
    from benchtool.commands.terminal.name_values import name_values
    from benchtool.simulate.controllers.pitch import PITCH_CONTROLLERS
    from benchtool.simulate.own_controllers import controller_class
    from benchtool.simulate.pitch.setup import changed_job
    from benchtool.virtual.devices import pitch_plant, pitch_server

    schedule, controller, gains, settings = named
    values = name_values(settings, "--set")
    plant = pitch_plant(
        rig,
        truth,
        schedule,
        controller,
        gains,
        seed,
        rate_Hz,
        own=(
            None
            if controller in PITCH_CONTROLLERS
            else controller_class(controller, permit=announce_code)
        ),
        change=lambda job: changed_job(job, values),
        permit=announce_code,
    )
    server = pitch_server(plant, link, seed=seed, speed=speed, faults=faults, speak=speak)
    return server, (
        f"pitch bench of {rig.name}, truth {plant.job.bench.model.name}, {controller} with gains "
        f"{gains}, schedule {plant.schedule.name} of {plant.schedule.duration_s:g} s"
    )
