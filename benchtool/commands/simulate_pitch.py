"""Command `benchtool simulate pitch`: closed-loop pitch bench."""

from __future__ import annotations

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.simulate_options import print_study, warn_if_slow
from benchtool.commands.terminal.messages import announce_code
from benchtool.simulate.inputs import PitchInputs


@command_from_inputs(PitchInputs)
def pitch(inputs: PitchInputs) -> None:
    """Simulate a pitch bench with each controller.

    Writes recordings and a figure, or with --vary a table of many runs.
    """
    warn_if_slow()
    if inputs.study.campaign.vary:
        from benchtool.commands.terminal.show_campaign import show_campaign
        from benchtool.simulate.controllers.laws import PITCH_CONTROLLERS

        show_campaign(inputs, PITCH_CONTROLLERS)
        return
    from benchtool.results import pitch_result

    print_study(pitch_result(inputs, permit=announce_code), inputs.study.out)
