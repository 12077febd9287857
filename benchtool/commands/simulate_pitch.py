"""`benchtool simulate pitch`: the pitch bench under each controller."""

from __future__ import annotations

from benchtool.commands.declared import declared
from benchtool.commands.simulate_options import refuse_own, say_if_slow, show_study
from benchtool.commands.terminal.messages import announce_code
from benchtool.simulate.pitch.inputs import PitchInputs


@declared(PitchInputs)
def pitch(inputs: PitchInputs) -> None:
    """Simulate the pitch bench under each controller.

    Numbers, recordings, a figure; or a campaign of many runs.
    """
    say_if_slow()
    if inputs.study.campaign.vary:
        from benchtool.commands.terminal.campaign_display import run_with_progress
        from benchtool.simulate.controllers.laws import PITCH_CONTROLLERS

        refuse_own(inputs, PITCH_CONTROLLERS)
        run_with_progress(inputs)
        return
    from benchtool.results import pitch_result

    show_study(pitch_result(inputs, permit=announce_code), inputs.study.out)
