"""`benchtool simulate flight`: a multirotor near surfaces under each controller."""

from __future__ import annotations

from functools import partial

from benchtool.commands.declared import declared
from benchtool.commands.simulate_options import refuse_twice, say_if_slow, show_study
from benchtool.commands.terminal.messages import announce_code, print_notes
from benchtool.core.errors import UnknownChoice
from benchtool.simulate.flight.inputs import FlightInputs, setup_of
from benchtool.simulate.own_controller import controller_class

_setup = partial(setup_of, permit=announce_code, note=print_notes)


@declared(FlightInputs)
def flight(inputs: FlightInputs) -> None:
    """Simulate flights over an obstacle under each controller.

    Numbers, recordings, a figure; or a campaign of many flights.
    """
    from benchtool.report.flight.flight import fly_each, report_lines, write_flights
    from benchtool.simulate.campaign_flight import OGE
    from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS
    from benchtool.simulate.flight.setup import full_name

    say_if_slow()
    study, several = inputs.study, bool(inputs.study.campaign.vary)
    known = tuple(FLIGHT_CONTROLLERS)
    usual = ("oge", "pid") if several else ("pid", "observer", "feedforward")
    names = inputs.controllers or usual
    refuse_twice("--controllers", names)
    refuse_twice("--gains", study.gains)
    for name in names:
        beyond = name == OGE if several else ":" in name
        if name not in known and not beyond:
            raise UnknownChoice("controller of a flight", name, [*known, OGE] if several else known)
    if several:
        from benchtool.commands.terminal.campaign_display import run_with_progress

        run_with_progress(inputs, full_name=full_name)
        return
    study.refuse_campaign()
    flown = _setup(inputs, study.gain_set()).flown("pid", study.seed)
    own = [
        (name, controller_class(name, known, announce_code)) for name in names if name not in known
    ]
    built_in = [each for name in names for each in known if each == name]
    flights = fly_each(flown, built_in, own)
    show_study(report_lines(flights), lambda folder: write_flights(folder, flights), study.out)
