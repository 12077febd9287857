"""`benchtool sweep`: from a plan to a run folder."""

from __future__ import annotations

from typing import Any

from benchtool.acquire.inputs import SweepInputs
from benchtool.commands.declared import declared
from benchtool.commands.terminal.messages import announce_code
from benchtool.commands.terminal.sweep_operator import TERMINAL


def _base(given: dict[str, Any]) -> SweepInputs:
    from benchtool.acquire.sweep_run import base_inputs

    return base_inputs(given, "option")


@declared(SweepInputs, _base)
def sweep(inputs: SweepInputs) -> None:
    """Sweep plate distance and throttle into a run folder."""
    from benchtool.acquire.sweep_run import sweep_to_run

    sweep_to_run(inputs, TERMINAL, announce_code)
