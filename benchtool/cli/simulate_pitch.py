"""`benchtool simulate pitch`: the pitch bench under each controller."""

from __future__ import annotations

from typing import Annotated

import typer

from benchtool.cli.simulate_options import (
    Duration,
    Gains,
    MeasureName,
    Out,
    Samples,
    Seed,
    Seeds,
    Settings,
    Varied,
    controller_names,
    gain_sets,
    one_gain_set,
    refuse_without_vary,
    say_if_slow,
)


def command(
    rig: Annotated[str, typer.Option(help="Rig on the hinge.")] = "pquad",
    model: Annotated[
        str, typer.Option(help="Model or its file; the rig's pitch model without.")
    ] = "",
    gains: Gains = None,
    controllers: Annotated[
        str,
        typer.Option(
            "--controllers", "--controller", help="With commas; your own as module:Class."
        ),
    ] = "pid,feedforward,observer",
    schedule: Annotated[str, typer.Option(help="Schedule, or its file.")] = "plate",
    duration_s: Duration = 0.0,
    seed: Seed = 1,
    settings: Settings = None,
    feedforward: Annotated[
        str, typer.Option(help="What feedforward knows: distance or range (sensors).")
    ] = "distance",
    vary: Varied = None,
    seeds: Seeds = 1,
    samples: Samples = 0,
    measure: MeasureName = "",
    out: Out = None,
) -> None:
    """Simulate the pitch bench under each controller: numbers, recordings, figure."""
    from dataclasses import replace

    from benchtool.cli.name_values import name_values
    from benchtool.control.pitch import PITCH_CONTROLLERS, Feedforward
    from benchtool.errors import InputError
    from benchtool.studies.own_controllers import controller_class
    from benchtool.studies.pitch import pitch_study, table_lines, warnings_of, write_study
    from benchtool.studies.pitch_setup import PitchSetup, changed, pitch_setup

    say_if_slow()
    names = controller_names(controllers, PITCH_CONTROLLERS)
    own = [(name, controller_class(name)) for name in names if name not in PITCH_CONTROLLERS]
    built_in = [name for name in names if name in PITCH_CONTROLLERS]
    given = name_values(settings or [], "--set")

    def setup_with(gain_set: str) -> PitchSetup:
        setup = pitch_setup(
            rig=rig,
            model=model or None,
            gains=gain_set,
            controllers=built_in or ["pid"],
            schedule=schedule,
            feedforward=Feedforward(strength=0.9, source=feedforward),
        )
        setup = changed(setup, given)
        if not duration_s:
            return setup
        return replace(setup, schedule=setup.schedule.lasting(duration_s))

    sets = gain_sets(gains)
    if vary:
        from benchtool.cli.campaign_display import run_with_progress
        from benchtool.studies.campaign_pitch import PitchCampaign
        from benchtool.studies.design import Design

        if own:
            raise InputError("a campaign runs built-in controllers; leave your own out")
        campaign = PitchCampaign(setups={name: setup_with(name) for name in sets})
        design = Design.read(vary, samples=samples, seeds=seeds, seed=seed)
        run_with_progress(campaign, design, settings or [], measure, out)
        return
    refuse_without_vary(seeds=seeds > 1, samples=samples, measure=measure)
    gain_set = one_gain_set(sets)
    setup = setup_with(gain_set)
    study = pitch_study(setup, seed, own, only_own=not built_in)
    bench = setup.bench
    print(
        f"SIMULATED pitch bench {bench.model.rig.name}, model {bench.model.name}, "
        f"gains {gain_set}, schedule {setup.schedule.name}, seed {seed}"
    )
    for line in [*table_lines(study), *warnings_of(study)]:
        print(line, flush=True)
    if out is None:
        print("add --out FOLDER for the recordings (CSV) and the figure")
        return
    for path in write_study(study, out):
        print(f"written: {path}")
