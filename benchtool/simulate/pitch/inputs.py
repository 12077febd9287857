"""Inputs of a pitch simulation, from the command line, the page or Python."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated

from annotated_types import Len

from benchtool.core.inputs import Input, Inputs
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.simulate.study_inputs import StudyInputs

if TYPE_CHECKING:
    from benchtool.simulate.pitch.setup import PitchSetup


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchInputs(Inputs):
    """Inputs of `benchtool simulate pitch`."""

    rig: Annotated[
        str | None, Input("Rig on the hinge.", default_text="of the model; pquad without a model")
    ] = None
    model: Annotated[str, Input("Model or its file.", default_text="pitch model of the rig")] = ""
    controllers: Annotated[
        tuple[str, ...],
        Len(1),
        Input(
            "Comma-separated; user-defined: module:Class.",
            comma_separated=True,
            alias="--controller",
            label="Controllers",
        ),
    ] = ("pid", "feedforward", "observer")
    schedule: Annotated[str, Input("Schedule, or its file.")] = "plate"
    study: StudyInputs = field(default_factory=StudyInputs)


def build_setup(
    inputs: PitchInputs, gains: str, permit: CodePermit = check_code_allowed
) -> PitchSetup:
    """Return the setup of one gain set; `permit` is called before user code of a model is run."""
    from benchtool.simulate.controllers.laws import PITCH_CONTROLLERS
    from benchtool.simulate.pitch.setup import pitch_setup, with_changes

    setup = pitch_setup(
        rig=inputs.rig,
        model=inputs.model or None,
        gains=gains,
        controllers=[name for name in inputs.controllers if name in PITCH_CONTROLLERS] or ["pid"],
        schedule=inputs.schedule,
        permit=permit,
    )
    setup = with_changes(setup, inputs.study.settings)
    if inputs.study.duration_s is None:
        return setup
    return replace(setup, schedule=setup.schedule.with_duration(inputs.study.duration_s))
