"""Command `benchtool sweep`: run folder from a plan."""

from __future__ import annotations

from typing import Any

from benchtool.acquire.inputs import SweepInputs
from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.commands.terminal.sweep_operator import TERMINAL


def _base_inputs(options: dict[str, Any]) -> SweepInputs:
    from benchtool.acquire.run_experiment import base_inputs

    return base_inputs(options, "option")


@command_from_inputs(SweepInputs, _base_inputs)
def sweep(inputs: SweepInputs) -> None:
    """Sweep plate distance and throttle."""
    from benchtool.acquire.run_experiment import run_experiment

    run_experiment(inputs, TERMINAL, announce_code)
