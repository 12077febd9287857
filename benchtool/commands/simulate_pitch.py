"""`benchtool simulate pitch`: the pitch bench under each controller."""

from __future__ import annotations

from typing import Annotated

import typer

from benchtool.commands import simulate_options as options


def command(
    rig: Annotated[str, typer.Option(help="Rig on the hinge.")] = "pquad",
    model: Annotated[
        str, typer.Option(help="Model or its file; the rig's pitch model when left out.")
    ] = "",
    gains: options.Gains = None,
    controllers: Annotated[
        str,
        typer.Option(
            "--controllers", "--controller", help="With commas; your own as module:Class."
        ),
    ] = "pid,feedforward,observer",
    schedule: Annotated[str, typer.Option(help="Schedule, or its file.")] = "plate",
    duration_s: options.Duration = 0.0,
    seed: options.Seed = 1,
    settings: options.Settings = None,
    vary: options.Varied = None,
    seeds: options.Seeds = 1,
    samples: options.Samples = 0,
    measure: options.MeasureName = "",
    out: options.Out = None,
) -> None:
    """Simulate the pitch bench under each controller.

    Numbers, recordings, a figure; or a campaign of many runs.
    """
    from dataclasses import replace

    from benchtool.commands.terminal.announce_code import announce_code, print_notes
    from benchtool.commands.terminal.name_values import name_values
    from benchtool.core.errors import InputError
    from benchtool.report.flight.pitch_study import pitch_study, report_lines, write_study
    from benchtool.simulate.controllers.pitch import PITCH_CONTROLLERS
    from benchtool.simulate.own_controllers import controller_class
    from benchtool.simulate.pitch.setup import PitchSetup, changed, pitch_setup

    options.say_if_slow()
    names = options.controller_names(controllers, PITCH_CONTROLLERS)
    own = [
        (name, controller_class(name, permit=announce_code))
        for name in names
        if name not in PITCH_CONTROLLERS
    ]
    built_in = [name for name in names if name in PITCH_CONTROLLERS]
    given = name_values(settings or [], "--set")

    def setup_with(gain_set: str) -> PitchSetup:
        setup = pitch_setup(
            rig=rig,
            model=model or None,
            gains=gain_set,
            controllers=built_in or ["pid"],
            schedule=schedule,
            permit=announce_code,
        )
        print_notes(setup.notes)
        setup = changed(setup, given)
        if not duration_s:
            return setup
        return replace(setup, schedule=setup.schedule.lasting(duration_s))

    sets = options.gain_sets(gains)
    if vary:
        from benchtool.commands.terminal.campaign_display import run_with_progress
        from benchtool.simulate.campaign_pitch import PitchCampaign
        from benchtool.simulate.design import Design

        if own:
            raise InputError("a campaign runs built-in controllers; leave your own out")
        campaign = PitchCampaign(setups={name: setup_with(name) for name in sets})
        design = Design.read(vary, samples=samples, seeds=seeds, seed=seed)
        run_with_progress(campaign, design, settings or [], measure, out)
        return
    options.refuse_without_vary(seeds=seeds > 1, samples=samples, measure=measure)
    setup = setup_with(options.one_gain_set(sets))
    study = pitch_study(setup, seed, own, only_own=not built_in)
    options.show_study(report_lines(study), lambda folder: write_study(study, folder), out)
