"""`benchtool stop`: zero throttle for the benches of this user."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from benchtool.commands.declared import declared
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class StopInputs(Inputs):
    """Inputs of `benchtool stop`."""

    address: Annotated[
        str | None, Input("Only the bench at this address.", empty="every bench of this user")
    ] = None


@declared(StopInputs)
def stop(inputs: StopInputs) -> None:
    """Stop the motors of every bench of this user."""
    from concurrent.futures import ThreadPoolExecutor

    from benchtool.acquire.stop_listener import find_benches, stop_folder
    from benchtool.core.errors import InputError, StandstillNotSeen, UnknownChoice

    benches = announced = find_benches()
    if not benches:
        raise InputError(
            f"no bench of this user runs on this machine (looked in {stop_folder()}); if a motor "
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
    unseen = [
        bench.address for bench, report in zip(benches, reports, strict=True) if not report.standing
    ]
    if unseen:
        raise StandstillNotSeen(
            f"MOTORS MAY STILL TURN: {', '.join(unseen)}; look, cut the power if they turn"
        )
