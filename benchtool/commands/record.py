"""Command `benchtool record`: run folder of a pitch experiment."""

from __future__ import annotations

from benchtool.acquire.inputs import RecordInputs
from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.commands.terminal.sweep_operator import TERMINAL


@command_from_inputs(RecordInputs)
def record(inputs: RecordInputs) -> None:
    """Record a pitch experiment."""
    from benchtool.acquire.run_experiment import run_experiment

    run_experiment(inputs, TERMINAL, announce_code)
