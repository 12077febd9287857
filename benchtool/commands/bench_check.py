"""`benchtool bench check` and `bench map`: each motor turned alone, slowly, and judged."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code, write_new
from benchtool.commands.terminal.sweep_operator import LOOK_S, TERMINAL
from benchtool.core.errors import BenchError, InputError, WouldOverwrite
from benchtool.core.input_text import format_value
from benchtool.core.inputs import Input, Inputs

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchtool.bench.bench import Bench
    from benchtool.core.rig import Rig


@dataclass(frozen=True, slots=True, kw_only=True)
class MapInputs(Inputs):
    """What `benchtool bench map` takes."""

    address: Annotated[str, Input("The flight controller: mavlink:...", argument="ADDRESS")]
    rig: Annotated[str | None, Input("Rig by name, or a rig file.")] = None
    out: Annotated[Path | None, Input("File to write.", default_text="RIG.motors.toml")] = None
    motors: Annotated[
        tuple[Annotated[int, Ge(1)], ...] | None,
        Input(
            "Test number of each rotor, in the rig's order: 1,4,3,2.",
            default_text="asked for each motor that has turned",
        ),
    ] = None
    yes: Annotated[bool, Input("No typed confirmation; simulated benches only.")] = False


@command_from_inputs(MapInputs)
def map_motors(inputs: MapInputs) -> None:
    """Turn each motor of a flight controller at low throttle and write the motor map."""
    from benchtool.acquire.bench_check import detect_motor_map, low_throttle_us
    from benchtool.acquire.inputs import resolve_rig
    from benchtool.acquire.operator import confirm_arming, describe_bench, describe_end
    from benchtool.acquire.stop_listener import accept_stops
    from benchtool.bench.addresses import MavlinkAddress
    from benchtool.bench.drivers import open_bench, parse_address
    from benchtool.bench.guard import GuardedBench

    address = inputs.address
    stands = resolve_rig(address, inputs.rig)
    numbers = _numbers(inputs.motors, stands, inputs.yes)
    parsed = parse_address(address)
    if not isinstance(parsed, MavlinkAddress) or parsed.map is not None:
        raise InputError(
            "a map is learnt from a mavlink: address without map=; name one, for example "
            "mavlink:udpin:127.0.0.1:14550"
        )
    target = inputs.out or Path(f"{stands.name}.motors.toml")
    if target.exists():
        raise WouldOverwrite(str(target))
    guard = GuardedBench(open_bench(address, announce_code), stands)
    with accept_stops(guard, address) as bench:
        describe_bench(TERMINAL, bench.identity, stands)
        text = (
            f"motors 1 to {stands.n_rotors} will turn one after another at "
            f"{low_throttle_us(stands):g} us; see which rotor each one is"
        )
        if not inputs.yes:
            confirm_arming(TERMINAL, text, bench)
        elif not bench.identity.simulated:
            raise InputError("--yes is for simulated benches only; leave it out and type ARM")
        which = numbers.index if numbers else _question(stands, bench)
        found = detect_motor_map(bench, stands, which, TERMINAL.inform)
    describe_end(TERMINAL, bench)
    write_new(target, lambda: target.write_text(found.to_toml(), encoding="utf-8"))
    joint = "&" if "?" in address else "?"
    print(f"written to {target}; from now on use {address}{joint}map={target}")


def _question(rig: Rig, bench: Bench) -> Callable[[int], int]:
    """Return a function that asks the operator which rotor has turned: only eyes can see it."""
    left = set(range(rig.n_rotors))

    def rotor_of(motor: int) -> int:
        while len(left) > 1:
            listed = ", ".join(f"{rotor + 1} {rig.rotors[rotor].name}" for rotor in sorted(left))
            question = f"motor {motor} has turned; which rotor was it? ({listed}): "
            answer = TERMINAL.answer(question, lambda: bench.read(LOOK_S)).strip()
            rotor = int(answer) - 1 if answer.isdecimal() else -1
            if rotor in left:
                left.remove(rotor)
                return rotor
        return left.pop()

    return rotor_of


def _numbers(given: tuple[int, ...] | None, rig: Rig, unattended: bool) -> tuple[int, ...]:
    """Return the motor of every rotor; none where the operator must be asked.

    The order is never guessed: ArduPilot counts motors clockwise from the front, rigs
    counter-clockwise.
    """
    n_rotors = rig.n_rotors
    if given is None:
        if n_rotors == 1:
            return (1,)
        if unattended:
            names = ", ".join(rotor.name for rotor in rig.rotors)
            raise InputError(
                f"--yes leaves nobody to say which rotor a motor turns; give --motors, the test "
                f"number of each rotor in the order {names} (ArduPilot counts clockwise from the "
                f"front), or leave --yes out"
            )
        return ()
    if sorted(given) != list(range(1, n_rotors + 1)):
        raise InputError(
            f"--motors is {format_value(given)}, but every number from 1 to {n_rotors} must stand "
            f"in it once, in the order of the rig's rotors"
        )
    return given


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckInputs(Inputs):
    """What `benchtool bench check` takes."""

    address: Annotated[str, Input("The bench: serial:PORT, tcp:HOST:PORT.", argument="ADDRESS")]
    rig: Annotated[str | None, Input("Rig by name, or a rig file.")] = None
    yes: Annotated[bool, Input("No typed confirmation; simulated benches only.")] = False


@command_from_inputs(CheckInputs)
def check(inputs: CheckInputs) -> None:
    """Check standstill, ESC arming, channel map, thrust sign and rpm at low throttle."""
    from datetime import datetime

    from benchtool.acquire.arming import store_check_result
    from benchtool.acquire.bench_check import check_bench, low_throttle_us
    from benchtool.acquire.inputs import resolve_rig
    from benchtool.acquire.operator import confirm_arming, describe_bench, describe_end
    from benchtool.acquire.stop_listener import accept_stops
    from benchtool.bench.drivers import open_bench
    from benchtool.bench.guard import GuardedBench

    stands = resolve_rig(inputs.address, inputs.rig)
    findings = []
    guard = GuardedBench(open_bench(inputs.address, announce_code), stands)
    with accept_stops(guard, inputs.address) as bench:
        identity = bench.identity
        describe_bench(TERMINAL, identity, stands)
        text = (
            f"rotors 1 to {stands.n_rotors} of rig {stands.name} will turn one after another at "
            f"{low_throttle_us(stands):g} us"
        )
        if not inputs.yes:
            confirm_arming(TERMINAL, text, bench)
        elif not identity.simulated:
            raise InputError(
                "--yes is for simulated benches only: this is the check; leave it out and type the "
                "confirmation"
            )
        for finding in check_bench(bench, stands):
            findings.append(finding)
            print(f"{'ok  ' if finding.passed else 'FAIL'} {finding.name}: {finding.text}")
    describe_end(TERMINAL, bench)
    failed = [finding for finding in findings if not finding.passed]
    if failed:
        raise BenchError(
            f"{len(failed)} of {len(findings)} checks failed, first {failed[0].name}: "
            f"{failed[0].text}; mend it and check again"
        )
    today = datetime.now().astimezone().date()
    store_check_result(identity, stands, [finding.text for finding in findings], today)
    print(f"all {len(findings)} checks passed on {identity.device_id}; noted for today")
