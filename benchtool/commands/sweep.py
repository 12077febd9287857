"""Commands `benchtool sweep`, `benchtool record` and `benchtool stop`."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from benchtool.acquire.inputs import RecordInputs, SweepInputs, resolve_rig
from benchtool.commands.input_commands import Verbose, command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.errors import InputError, StandstillNotConfirmed, UnknownChoice
from benchtool.core.inputs import Input, Inputs

if TYPE_CHECKING:
    from benchtool.data.run.run import Run


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepArguments(SweepInputs):
    """Command-line options of `benchtool sweep`."""

    verbose: Verbose = False


def _base_inputs(options: dict[str, Any]) -> SweepArguments:
    if "resume" not in options:
        if not options.get("address"):
            raise InputError("no bench address; give one, for example sim:pquad")
        resolve_rig(options["address"], options.get("rig"))  # before the imports of a session
    from benchtool.acquire.session import base_inputs

    return SweepArguments(plan=base_inputs(options, "option").plan)


@command_from_inputs(SweepArguments, _base_inputs)
def sweep(inputs: SweepArguments) -> None:
    """Sweep plate distance and throttle."""
    if (run := _run(inputs, verbose=inputs.verbose)) is not None:
        print(f"next: {_next_command(run)}")


@command_from_inputs(RecordInputs)
def record(inputs: RecordInputs) -> None:
    """Record a pitch experiment."""
    resolve_rig(inputs.address, inputs.rig)  # before the imports of a session
    _run(inputs, verbose=True)


def _run(inputs: SweepInputs | RecordInputs, *, verbose: bool) -> Run | None:
    from benchtool.acquire.session import run_experiment
    from benchtool.commands.terminal.operator import TerminalOperator

    return run_experiment(inputs, TerminalOperator(verbose=verbose), announce_code)


def _next_command(run: Run) -> str:
    """Return the command that evaluates a sweep."""
    from benchtool.acquire.plan import plan_from_toml
    from benchtool.data.run.read import run_rig

    if not plan_from_toml(run.plan_text, "plan").plate.used:
        return shlex.join(["benchtool", "motor", str(run.path)])
    models = {1: "single", 4: "quad_bench"}  # by number of rotors
    model = models.get(len(run_rig(run.path).rotors), "MODEL")
    return shlex.join(["benchtool", "fit", str(run.path), "--model", model])


@dataclass(frozen=True, slots=True, kw_only=True)
class StopInputs(Inputs):
    """Options of `benchtool stop`."""

    address: Annotated[
        str | None, Input("Bench to stop.", default_text="every bench of this user")
    ] = None


@command_from_inputs(StopInputs)
def stop(inputs: StopInputs) -> None:
    """Stop the motors of every bench that this user runs."""
    from concurrent.futures import ThreadPoolExecutor

    from benchtool.acquire.stop_listener import find_benches, stop_folder

    benches = announced = find_benches()
    if not benches:
        raise InputError(
            f"no bench of this user runs on this machine (searched {stop_folder()}); if a motor "
            f"turns, cut the power"
        )
    if inputs.address is not None:
        benches = [bench for bench in announced if bench.address == inputs.address]
        if not benches:
            raise UnknownChoice("bench", inputs.address, [bench.address for bench in announced])
    with ThreadPoolExecutor(len(benches)) as pool:
        reports = list(pool.map(lambda bench: bench.stop(), benches))
    for bench, report in zip(benches, reports, strict=True):
        print(f"{bench.address}: {report.text}")
    unconfirmed = [
        bench.address for bench, report in zip(benches, reports, strict=True) if not report.standing
    ]
    if unconfirmed:
        raise StandstillNotConfirmed(
            f"MOTORS MAY STILL TURN: {', '.join(unconfirmed)}; check, and cut the power if they do"
        )
