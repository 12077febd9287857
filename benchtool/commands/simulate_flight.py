"""Command `benchtool simulate flight`: closed-loop flight near surfaces."""

from __future__ import annotations

from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.simulate_options import print_study, warn_if_slow
from benchtool.commands.terminal.messages import announce_code
from benchtool.simulate.inputs import FlightInputs


@command_from_inputs(FlightInputs)
def flight(inputs: FlightInputs) -> None:
    """Simulate flights over an obstacle with each controller.

    Writes recordings and a figure, or with --vary a table of many flights.
    """
    warn_if_slow()
    if inputs.study.campaign.vary:
        from benchtool.commands.terminal.show_campaign import show_campaign
        from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS
        from benchtool.simulate.flight.setup import OGE, full_name

        show_campaign(inputs, (*FLIGHT_CONTROLLERS, OGE), full_name=full_name)
        return
    from benchtool.results import flight_result

    print_study(flight_result(inputs, permit=announce_code), inputs.study.out)
