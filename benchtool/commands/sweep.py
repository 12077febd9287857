"""Commands `benchtool sweep`, `benchtool record` and `benchtool stop`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from benchtool.acquire.inputs import RecordInputs, SweepInputs
from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.errors import InputError, StandstillNotConfirmed, UnknownChoice
from benchtool.core.inputs import Input, Inputs


def _base_inputs(options: dict[str, Any]) -> SweepInputs:
    from benchtool.acquire.session import base_inputs

    return base_inputs(options, "option")


@command_from_inputs(SweepInputs, _base_inputs)
def sweep(inputs: SweepInputs) -> None:
    """Sweep plate distance and throttle."""
    _run(inputs)


@command_from_inputs(RecordInputs)
def record(inputs: RecordInputs) -> None:
    """Record a pitch experiment."""
    _run(inputs)


def _run(inputs: SweepInputs | RecordInputs) -> None:
    from benchtool.acquire.session import run_experiment
    from benchtool.commands.terminal.operator import TERMINAL

    run_experiment(inputs, TERMINAL, announce_code)


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
