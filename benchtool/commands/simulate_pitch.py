"""`benchtool simulate pitch`: the pitch bench under each controller."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated

from annotated_types import Len

from benchtool.commands.declared import declared
from benchtool.commands.simulate_options import StudyInputs, refuse_twice, say_if_slow, show_study
from benchtool.commands.terminal.messages import announce_code, print_notes
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs
from benchtool.simulate.own_controller import controller_class

if TYPE_CHECKING:
    from benchtool.simulate.pitch.setup import PitchSetup


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchInputs(Inputs):
    """What `benchtool simulate pitch` takes."""

    rig: Annotated[str, Input("Rig on the hinge.")] = "pquad"
    model: Annotated[str, Input("Model or its file.", empty="the rig's pitch model")] = ""
    controllers: Annotated[
        tuple[str, ...],
        Len(1),
        Input("With commas; your own as module:Class.", commas=True, also="--controller"),
    ] = ("pid", "feedforward", "observer")
    schedule: Annotated[str, Input("Schedule, or its file.")] = "plate"
    study: StudyInputs = field(default_factory=StudyInputs)


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
        from benchtool.simulate.campaign_pitch import pitch_campaign

        if own:
            raise InputError("a campaign runs built-in controllers; leave your own out")
        setups = {gains: setup_of(inputs, gains) for gains in study.gains}
        run_with_progress(pitch_campaign(setups), study)
        return
    study.refuse_campaign()
    setup = setup_of(inputs, study.gain_set())
    result = pitch_study(setup, study.seed, own, only_own=len(own) == len(names))
    show_study(report_lines(result), lambda folder: write_study(result, folder), study.out)


def setup_of(inputs: PitchInputs, gains: str) -> PitchSetup:
    """Return what runs with one gain set."""
    from benchtool.simulate.controllers.laws import PITCH_CONTROLLERS
    from benchtool.simulate.controllers.pitch import Feedforward
    from benchtool.simulate.pitch.setup import changed, pitch_setup

    setup = pitch_setup(
        rig=inputs.rig,
        model=inputs.model or None,
        gains=gains,
        controllers=[name for name in inputs.controllers if name in PITCH_CONTROLLERS] or ["pid"],
        schedule=inputs.schedule,
        feedforward=Feedforward(strength=0.9),
        permit=announce_code,
    )
    print_notes(setup.notes)
    setup = changed(setup, inputs.study.settings)
    if inputs.study.duration_s is None:
        return setup
    return replace(setup, schedule=setup.schedule.lasting(inputs.study.duration_s))
