"""`benchtool simulate pitch`: the pitch bench under each controller."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def command(
    rig: Annotated[str, typer.Option(help="Rig on the hinge.")] = "pquad",
    model: Annotated[
        str, typer.Option(help="Model or its file; the rig's pitch model without.")
    ] = "",
    gains: Annotated[str, typer.Option(help="Gain set, or its file.")] = "s3",
    controllers: Annotated[
        str,
        typer.Option(help="Controllers, with commas; your own as module:Class."),
    ] = "pid,feedforward,observer",
    schedule: Annotated[str, typer.Option(help="Schedule, or its file.")] = "plate",
    duration_s: Annotated[
        float, typer.Option("--duration-s", help="Length; the schedule's own without.")
    ] = 0.0,
    seed: Annotated[int, typer.Option(help="Seed of the noise.", min=0)] = 1,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="NAME=VALUE, as K_b=1.8 or gains.attitude.k_q_per_s=8."),
    ] = None,
    feedforward: Annotated[
        str, typer.Option(help="What feedforward knows: distance or range (sensors).")
    ] = "distance",
    vary: Annotated[
        list[str] | None,
        typer.Option(help="NAME=FROM:TO:COUNT: a campaign over a grid; --out is needed."),
    ] = None,
    seeds: Annotated[int, typer.Option(help="Seeds per point of a campaign.", min=1)] = 1,
    samples: Annotated[int, typer.Option(help="Random points in place of the grid.", min=0)] = 0,
    out: Annotated[
        Path | None, typer.Option(help="Folder for recordings, table and figure.")
    ] = None,
) -> None:
    """Simulate the pitch bench under each controller: numbers, recordings, figure."""
    from dataclasses import replace

    from benchtool.aero.expression import can_compile
    from benchtool.cli.name_values import name_values
    from benchtool.control.pitch import PITCH_CONTROLLERS, Feedforward
    from benchtool.errors import InputError
    from benchtool.studies.pitch import pitch_study, table_lines, warnings_of, write_study
    from benchtool.studies.pitch_setup import changed, controller_class, pitch_setup

    if not can_compile():
        print(
            "numba is not installed, so this runs as plain Python and takes minutes; "
            "pip install benchtool[fast] makes it a second",
            file=sys.stderr,
        )
    names = [name.strip() for name in controllers.split(",") if name.strip()]
    if not names:
        raise InputError(f"no controller was named; name some of: {', '.join(PITCH_CONTROLLERS)}")
    own = [(name, controller_class(name)) for name in names if name not in PITCH_CONTROLLERS]
    built_in = [name for name in names if name in PITCH_CONTROLLERS]
    setup = pitch_setup(
        rig=rig,
        model=model or None,
        gains=gains,
        controllers=built_in or ["pid"],
        schedule=schedule,
        feedforward=Feedforward(strength=0.9, source=feedforward),
    )
    setup = changed(setup, name_values(settings or [], "--set"))
    if duration_s:
        setup = replace(setup, schedule=setup.schedule.lasting(duration_s))
    if vary:
        from benchtool.cli.campaign_display import run_with_progress

        if own:
            raise InputError("a campaign runs built-in controllers; leave your own out")
        run_with_progress(setup, vary, seeds, samples, seed, out)
        return
    study = pitch_study(setup, seed, own, only_own=not built_in)
    bench = setup.bench
    print(
        f"SIMULATED pitch bench {bench.model.rig.name}, model {bench.model.name}, gains {gains}, "
        f"schedule {setup.schedule.name}, seed {seed}"
    )
    for line in [*table_lines(study), *warnings_of(study)]:
        print(line, flush=True)
    if out is None:
        print("add --out FOLDER for the recordings (CSV) and the figure")
        return
    for path in write_study(study, out):
        print(f"written: {path}")
