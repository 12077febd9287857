"""Commands `benchtool simulate pitch` and `benchtool simulate flight`: closed-loop simulations."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.errors import InputError
from benchtool.simulate.inputs import FlightInputs, PitchInputs

if TYPE_CHECKING:
    from benchtool.report.result import Result


@command_from_inputs(PitchInputs)
def pitch(inputs: PitchInputs) -> None:
    """Simulate a pitch bench with each controller.

    Writes recordings and a figure, or with --vary a table of many runs.
    """
    _warn_if_slow()
    if inputs.study.campaign.vary:
        from benchtool.commands.terminal.show_campaign import show_campaign
        from benchtool.simulate.controllers.laws import PITCH_CONTROLLERS

        show_campaign(inputs, PITCH_CONTROLLERS)
        return
    from benchtool.results import pitch_result

    _print_study(pitch_result(inputs, permit=announce_code), inputs.study.out)


@command_from_inputs(FlightInputs)
def flight(inputs: FlightInputs) -> None:
    """Simulate flights over an obstacle with each controller.

    Writes recordings and a figure, or with --vary a table of many flights.
    """
    _warn_if_slow()
    if inputs.study.campaign.vary:
        from benchtool.commands.terminal.show_campaign import show_campaign
        from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS
        from benchtool.simulate.flight.setup import OGE, full_name

        show_campaign(inputs, (*FLIGHT_CONTROLLERS, OGE), full_name=full_name)
        return
    from benchtool.results import flight_result

    _print_study(flight_result(inputs, permit=announce_code), inputs.study.out)


def _warn_if_slow() -> None:
    """Print a warning if simulations run without a compiler."""
    from benchtool.physics.expression import can_compile

    if not can_compile():
        print(
            "numba is not installed, so the simulation takes minutes instead of a second; use "
            "pip install benchtool[fast]",
            file=sys.stderr,
        )


def _print_study(result: Result[Any], out: Path | None) -> None:
    """Print the summary of a result, and write it if a folder is given."""
    print(result.summary(), flush=True)
    if out is None:
        print("add --out FOLDER for the recordings (CSV) and the figure")
        return
    try:
        written = result.save(out)
    except OSError as error:
        raise InputError(
            f"{out} cannot be written: {error.strerror or error}; use another folder with --out"
        ) from error
    for path in written:
        print(f"written: {path}")
