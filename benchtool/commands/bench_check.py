"""Commands `benchtool bench check` and `bench map`: test of each motor at low throttle."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code, write_new
from benchtool.commands.terminal.sweep_operator import POLL_INTERVAL_S, TERMINAL
from benchtool.core.errors import BenchError, InputError, WouldOverwrite
from benchtool.core.inputs import Input, Inputs
from benchtool.core.text import format_value

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchtool.bench.bench import Bench
    from benchtool.core.rig import Rig


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
    from benchtool.acquire.bench_check import detect_motor_map, low_throttle_us
    from benchtool.acquire.inputs import resolve_rig
    from benchtool.acquire.session import open_motor_test
    from benchtool.bench.drivers import MavlinkAddress, parse_address

    address = inputs.address
    rig = resolve_rig(address, inputs.rig)
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

    from benchtool.acquire.bench_check import check_bench, low_throttle_us
    from benchtool.acquire.inputs import resolve_rig
    from benchtool.acquire.operator import store_check_result
    from benchtool.acquire.session import open_motor_test

    rig = resolve_rig(inputs.address, inputs.rig)
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
