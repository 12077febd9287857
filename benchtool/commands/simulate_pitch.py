"""`benchtool simulate pitch`: the pitch bench under each controller."""

from __future__ import annotations

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.simulate_options import say_if_slow, show_study
from benchtool.commands.terminal.messages import announce_code
from benchtool.simulate.pitch.inputs import PitchInputs


@command_from_inputs(PitchInputs)
def pitch(inputs: PitchInputs) -> None:
    """Simulate a pitch bench with each controller.

    Numbers, recordings, a figure; or a campaign of many runs.
    """
    say_if_slow()
    if inputs.study.campaign.vary:
        from benchtool.commands.terminal.show_campaign import show_campaign
        from benchtool.simulate.controllers.laws import PITCH_CONTROLLERS

        show_campaign(inputs, PITCH_CONTROLLERS)
        return
    from benchtool.results import pitch_result

    show_study(pitch_result(inputs, permit=announce_code), inputs.study.out)
