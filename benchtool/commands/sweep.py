"""`benchtool sweep`: from a plan to a run folder."""

from __future__ import annotations

from typing import Any

from benchtool.acquire.inputs import SweepInputs
from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.commands.terminal.sweep_operator import TERMINAL


def _base(given: dict[str, Any]) -> SweepInputs:
    from benchtool.acquire.sweep_run import base_inputs

    return base_inputs(given, "option")


@command_from_inputs(SweepInputs, _base)
def sweep(inputs: SweepInputs) -> None:
    """Sweep plate distance and throttle."""
    from benchtool.acquire.sweep_run import run_sweep_to_folder

    run_sweep_to_folder(inputs, TERMINAL, announce_code)
