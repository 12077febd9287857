"""Commands `benchtool bench check`, `map` and `serve`: motor tests, and virtual benches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from annotated_types import Ge, Gt, Le

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code, write_new
from benchtool.core.choices import BenchMode
from benchtool.core.errors import BenchError, InputError, WouldOverwrite
from benchtool.core.inputs import Input, Inputs
from benchtool.core.text import format_value

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchtool.bench.bench import Bench
    from benchtool.core.rig import Rig
    from benchtool.virtual.devices import ServerOptions
    from benchtool.virtual.firmware import Firmware
    from benchtool.virtual.links import ServerLink
    from benchtool.virtual.server import BenchServer, ServedDevice


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
    from benchtool.virtual.devices import ServerOptions
    from benchtool.virtual.faults import parse_fault
    from benchtool.virtual.links import host_address, open_link
    from benchtool.virtual.server import DeviceLink

    faults = [parse_fault(text) for text in inputs.fault]
    rig = load_rig_by_name(inputs.rig)
    is_pitch, is_mavlink = inputs.mode == "pitch", inputs.link.partition(":")[0] == "mavlink"
    if inputs.settings and not is_pitch:
        raise InputError("--set needs a pitch bench; add --mode pitch, or use --truth FILE")
    protocol = _autopilot(inputs, rig) if is_mavlink else DeviceLink
    options = ServerOptions(seed=inputs.seed, speed=inputs.speed, faults=faults, protocol=protocol)
    link = open_link(inputs.link, inputs.symlink)
    # SIGTERM and Ctrl-Break of a Windows console close the link like Ctrl-C.
    for name in ("SIGTERM", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.default_int_handler)
    try:
        build_server = _build_pitch_server if is_pitch else _build_plate_server
        server, text = build_server(inputs, rig, link, options)
        address = link.address
        if is_mavlink:
            query = "&mode=pitch&arm=host" if is_pitch else ""
            query += f"&key={inputs.key}" if inputs.key else ""
            address = host_address(link, rig.n_rotors, query)
        print(address, flush=True)
        speed = f"speed {inputs.speed:g}; no motor turns; Ctrl-C to stop"
        print(f"virtual {text}, {speed}", file=sys.stderr)
        server.run()
    except KeyboardInterrupt:
        pass
    finally:
        link.close()


def _autopilot(inputs: ServeInputs, rig: Rig) -> Callable[[Firmware], ServedDevice]:
    """Return a function that builds the protocol handler of the autopilot."""
    from functools import partial
    from time import time

    from benchtool.acquire.inputs import hover_pulse_us
    from benchtool.bench.mavlink.settings import read_key
    from benchtool.virtual.autopilot import VirtualAutopilot

    return partial(
        VirtualAutopilot,
        kind=inputs.autopilot,
        system=inputs.system,
        key=read_key(inputs.key) if inputs.key else None,
        now_s=time(),
        hover_us=hover_pulse_us(rig) if inputs.mode == "pitch" else None,
    )


def _build_plate_server(
    inputs: ServeInputs, rig: Rig, link: ServerLink, options: ServerOptions
) -> tuple[BenchServer, str]:
    from benchtool.virtual.devices import load_truth, virtual_server

    truth, imperfections = load_truth(rig, inputs.truth, announce_code)
    rate_Hz = 200.0 if inputs.rate is None else inputs.rate
    server = virtual_server(rig, truth, link, options, imperfections, rate_Hz)
    return server, f"bench of {rig.name}, truth {truth.name}"


def _build_pitch_server(
    inputs: ServeInputs, rig: Rig, link: ServerLink, options: ServerOptions
) -> tuple[BenchServer, str]:
    from benchtool.bench.drivers import SimAddress
    from benchtool.simulate.controllers.controller import load_controller_class
    from benchtool.simulate.controllers.laws import PITCH_CONTROLLERS
    from benchtool.virtual.devices import device_server, pitch_hello, pitch_plant

    controller = inputs.controller
    address = SimAddress(
        rig=inputs.rig,
        truth=inputs.truth or "",
        schedule=inputs.schedule,
        controller=controller,
        gains=inputs.gains,
        seed=inputs.seed,
        rate_Hz=inputs.rate,
        permit=announce_code,
    )
    user_controller = (
        None
        if controller in PITCH_CONTROLLERS
        else load_controller_class(controller, PITCH_CONTROLLERS, announce_code)
    )
    plant = pitch_plant(rig, address, inputs.settings, user_controller)
    return device_server(plant, pitch_hello(plant, inputs.seed), link, options), (
        f"pitch bench of {rig.name}, truth {plant.job.bench.model.name}, {controller} with gains "
        f"{inputs.gains}, schedule {plant.schedule.name} of {plant.schedule.duration_s:g} s"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MapInputs(Inputs):
    """Options of `benchtool bench map`."""

    address: Annotated[str, Input("Flight controller: mavlink:...", argument="ADDRESS")]
    rig: Annotated[str | None, Input("Rig name or file.")] = None
    out: Annotated[Path | None, Input("File to write.", default_text="RIG.motors.toml")] = None
    motors: Annotated[
        tuple[Annotated[int, Ge(1)], ...] | None,
        Input(
            "Motor test number of each rotor, in the order of the rig: 1,4,3,2.",
            default_text="prompt for each motor",
        ),
    ] = None
    yes: Annotated[bool, Input("Skip the typed confirmation; simulated benches only.")] = False


@command_from_inputs(MapInputs)
def map_motors(inputs: MapInputs) -> None:
    """Turn each motor of a flight controller at low throttle and write the motor map."""
    from benchtool.acquire.inputs import resolve_rig

    address = inputs.address
    rig = resolve_rig(address, inputs.rig)
    from benchtool.acquire.bench_check import detect_motor_map, low_throttle_us
    from benchtool.acquire.session import open_motor_test
    from benchtool.bench.drivers import MavlinkAddress, parse_address
    from benchtool.commands.terminal.operator import TERMINAL

    numbers = _check_numbers(inputs.motors, rig, inputs.yes)
    parsed = parse_address(address)
    if not isinstance(parsed, MavlinkAddress) or parsed.map is not None:
        raise InputError(
            "a motor map needs a mavlink: address without map=, for example "
            "mavlink:udpin:127.0.0.1:14550"
        )
    target = inputs.out or Path(f"{rig.name}.motors.toml")
    if target.exists():
        raise WouldOverwrite(str(target))
    text = (
        f"motors 1 to {rig.n_rotors} will turn one after another at {low_throttle_us(rig):g} us; "
        f"watch which rotor each one turns"
    )
    with open_motor_test(address, rig, text, TERMINAL, announce_code, yes=inputs.yes) as bench:
        find_rotor = numbers.index if numbers else _build_prompt(rig, bench)
        motor_map = detect_motor_map(bench, rig, find_rotor, TERMINAL.inform)
    write_new(target, lambda: target.write_text(motor_map.to_toml(), encoding="utf-8"))
    separator = "&" if "?" in address else "?"
    print(f"written: {target}; from now on use {address}{separator}map={target}")


def _build_prompt(rig: Rig, bench: Bench) -> Callable[[int], int]:
    """Return a function that prompts the operator for the rotor that a motor has turned."""
    from benchtool.acquire.operator import POLL_INTERVAL_S
    from benchtool.commands.terminal.operator import TERMINAL

    remaining = set(range(rig.n_rotors))

    def find_rotor(motor: int) -> int:
        while len(remaining) > 1:
            names = [f"{index + 1} {rig.rotors[index].name}" for index in sorted(remaining)]
            question = f"motor {motor} has turned; which rotor was it? ({', '.join(names)}): "
            answer = TERMINAL.answer(question, lambda: bench.read(POLL_INTERVAL_S)).strip()
            rotor = int(answer) - 1 if answer.isdecimal() else -1
            if rotor in remaining:
                remaining.remove(rotor)
                return rotor
        return remaining.pop()

    return find_rotor


def _check_numbers(
    numbers: tuple[int, ...] | None, rig: Rig, is_unattended: bool
) -> tuple[int, ...]:
    """Return the motor of each rotor; empty if the operator must be prompted.

    There is no default order: ArduPilot counts motors clockwise from the front, rigs
    counter-clockwise.
    """
    n_rotors = rig.n_rotors
    if numbers is None:
        if n_rotors == 1:
            return (1,)
        if is_unattended:
            names = ", ".join(rotor.name for rotor in rig.rotors)
            raise InputError(
                f"--yes needs --motors, the motor test number of each rotor in the order {names} "
                f"(ArduPilot counts clockwise from the front); add it, or remove --yes"
            )
        return ()
    if sorted(numbers) != list(range(1, n_rotors + 1)):
        raise InputError(
            f"--motors is {format_value(numbers)}; give each number from 1 to {n_rotors} once, in "
            f"the order of the rotors of the rig"
        )
    return numbers


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckInputs(Inputs):
    """Options of `benchtool bench check`."""

    address: Annotated[str, Input("Bench: serial:PORT, tcp:HOST:PORT.", argument="ADDRESS")]
    rig: Annotated[str | None, Input("Rig name or file.")] = None
    yes: Annotated[bool, Input("Skip the typed confirmation; simulated benches only.")] = False


@command_from_inputs(CheckInputs)
def check(inputs: CheckInputs) -> None:
    """Check standstill, ESC arming, channel map, thrust sign and rpm at low throttle."""
    from datetime import datetime

    from benchtool.acquire.inputs import resolve_rig

    rig = resolve_rig(inputs.address, inputs.rig)
    from benchtool.acquire.bench_check import check_bench, low_throttle_us
    from benchtool.acquire.operator import store_check_result
    from benchtool.acquire.session import open_motor_test
    from benchtool.commands.terminal.operator import TERMINAL

    findings = []
    text = (
        f"rotors 1 to {rig.n_rotors} of rig {rig.name} will turn one after another at "
        f"{low_throttle_us(rig):g} us"
    )
    address = inputs.address
    with open_motor_test(address, rig, text, TERMINAL, announce_code, yes=inputs.yes) as bench:
        device = bench.identity
        for finding in check_bench(bench, rig):
            findings.append(finding)
            print(f"{'ok  ' if finding.passed else 'FAIL'} {finding.name}: {finding.text}")
    failed = [finding for finding in findings if not finding.passed]
    if failed:
        raise BenchError(
            f"{len(failed)} of {len(findings)} checks failed, first {failed[0].name}: "
            f"{failed[0].text}; correct it and check again"
        )
    today = datetime.now().astimezone().date()
    store_check_result(device, rig, [finding.text for finding in findings], today)
    print(f"all {len(findings)} checks passed on {device.device_id}; valid today")
