"""`benchtool simulate pitch`: the pitch bench under each controller."""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchtool.commands.declared import declared
from benchtool.commands.simulate_options import refuse_twice, say_if_slow, show_study
from benchtool.commands.terminal.messages import announce_code, print_notes
from benchtool.core.errors import InputError
from benchtool.simulate.own_controller import controller_class
from benchtool.simulate.pitch.inputs import PitchInputs, setup_of

if TYPE_CHECKING:
    from benchtool.simulate.pitch.setup import PitchSetup


@declared(PitchInputs)
def pitch(inputs: PitchInputs) -> None:
    """Simulate the pitch bench under each controller.

    Numbers, recordings, a figure; or a campaign of many runs.
    """
    from benchtool.report.flight.pitch_study import pitch_study, report_lines, write_study
    from benchtool.simulate.controllers.laws import PITCH_CONTROLLERS

    say_if_slow()
    names, study = inputs.controllers, inputs.study
    refuse_twice("--controllers", names)
    refuse_twice("--gains", study.gains)
    own = [
        (name, controller_class(name, PITCH_CONTROLLERS, announce_code))
        for name in names
        if name not in PITCH_CONTROLLERS
    ]
    if study.campaign.vary:
        from benchtool.commands.terminal.campaign_display import run_with_progress

        if own:
            raise InputError("a campaign runs built-in controllers; leave your own out")
        run_with_progress(inputs)
        return
    study.refuse_campaign()
    setup = _setup(inputs, study.gain_set())
    result = pitch_study(setup, study.seed, own, only_own=len(own) == len(names))
    show_study(report_lines(result), lambda folder: write_study(result, folder), study.out)


def _setup(inputs: PitchInputs, gains: str) -> PitchSetup:
    setup = setup_of(inputs, gains, announce_code)
    print_notes(setup.notes)
    return setup
