"""Closed-loop simulations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchtool.core.inputs import build_inputs, items
from benchtool.core.keywords import with_keywords
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.report.flight.pitch_study import PitchStudy
from benchtool.report.result import Result, save_if_requested
from benchtool.results import flight_result, pitch_result
from benchtool.simulate.controllers.controller import Controllers
from benchtool.simulate.flight.study import FlownCase
from benchtool.simulate.inputs import CampaignInputs, FlightInputs, PitchInputs

CAMPAIGN = tuple(item.name for item in items(CampaignInputs))


@with_keywords(PitchInputs, omit=CAMPAIGN)
def simulate_pitch(
    controllers: Controllers = ("pid", "feedforward", "observer"),
    *,
    permit: CodePermit = check_code_allowed,
    **options: Any,
) -> Result[PitchStudy]:
    """Simulate the pitch bench with each controller, like `benchtool simulate pitch`.

    Parameters
    ----------
    controllers : str, class, or a sequence of these
        Built-in names and user classes.
    permit : callable, optional
        Called with user code of the model before it runs; by default this raises.

    Returns
    -------
    Result
        Tables: one per controller, and `visits` of a plate.

    Raises
    ------
    InputError
        Unknown controller or schedule, or an invalid number.

    Examples
    --------
    >>> import benchtool as bt
    >>> study = bt.simulate_pitch("pid", duration_s=1.0)
    >>> len(study.to_dataframe("pid"))
    250
    """
    inputs = build_inputs(PitchInputs, options)
    return save_if_requested(pitch_result(inputs, controllers, permit), inputs.study.out)


@with_keywords(FlightInputs, omit=CAMPAIGN)
def simulate_flight(
    controllers: Controllers = ("pid", "observer", "feedforward"),
    *,
    permit: CodePermit = check_code_allowed,
    **options: Any,
) -> Result[Sequence[FlownCase]]:
    """Simulate flights over an obstacle, like `benchtool simulate flight`.

    Parameters
    ----------
    controllers, permit
        As in `simulate_pitch`.

    Returns
    -------
    Result
        Tables: `oge` (PID, no obstacle) and one per controller.

    Raises
    ------
    InputError
        Unknown controller or case, or an invalid number.

    Examples
    --------
    >>> import benchtool as bt
    >>> bt.simulate_flight("pid", case="edge", duration_s=1.0).tables
    ('oge', 'PID')
    """
    inputs = build_inputs(FlightInputs, options)
    return save_if_requested(flight_result(inputs, controllers, permit), inputs.study.out)
