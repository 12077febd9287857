"""`benchtool record`: a pitch experiment from a bench into a run folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from benchtool.acquire.pitch_experiment import PitchExperiment
    from benchtool.acquire.pitch_record import PitchSummary
    from benchtool.bench.guard import GuardedBench
    from benchtool.core.rig import Rig
    from benchtool.data.run.run import Run


def command(
    address: Annotated[
        str, typer.Argument(help="The bench: sim:pquad?mode=pitch, serial:PORT, tcp:HOST:PORT.")
    ],
    rig: Annotated[str | None, typer.Option(help="Rig by name, or a rig file.")] = None,
    seconds: Annotated[float, typer.Option(help="How long, on the bench's clock.")] = 40.0,
    collective: Annotated[
        float | None, typer.Option(help="Pulse that arms the device, us; hover when left out.")
    ] = None,
    plate_z_m: Annotated[
        float | None, typer.Option("--plate-z-m", help="Send the plate there before, m.")
    ] = None,
    limit_deg: Annotated[float, typer.Option(help="Stop beyond this pitch angle.")] = 45.0,
    schedule: Annotated[
        str, typer.Option(help="What the device runs, for the record; its own word without.")
    ] = "",
    name: Annotated[str, typer.Option(help="Name of the run.")] = "pitch",
    runs: Annotated[Path, typer.Option(help="Where run folders are made.")] = Path("runs"),
    out: Annotated[Path | None, typer.Option(help="Exactly this run folder; must be new.")] = None,
    operator: Annotated[str, typer.Option(help="Who measures; the user when left out.")] = "",
    yes: Annotated[
        bool, typer.Option("--yes", help="No typed arming: simulated or checked today.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show what would spin only.")] = False,
) -> None:
    """Record a pitch experiment from a bench into a run folder."""
    from math import radians

    from benchtool.acquire.inputs import rig_for
    from benchtool.acquire.pitch_experiment import (
        PitchExperiment,
        arming_text,
        check_experiment,
        hover_pulse_us,
    )
    from benchtool.acquire.pitch_record import summary_line
    from benchtool.bench.drivers import open_bench
    from benchtool.commands.terminal.announce_code import announce_code
    from benchtool.data.run.run import refuse_taken

    stands = rig_for(address, rig)
    experiment = PitchExperiment(
        seconds=seconds,
        collective_us=hover_pulse_us(stands) if collective is None else collective,
        plate_z_m=plate_z_m,
        pitch_limit_rad=radians(limit_deg),
        schedule=schedule,
    )
    expected = check_experiment(experiment, stands)
    if out is not None:
        refuse_taken(out)
    if dry_run:
        open_bench(address, announce_code)  # refuses what it names wrongly; opens nothing yet
        print(arming_text(experiment, stands, expected))
        print("dry run: nothing was opened, nothing spins")
        return
    run, summary, simulated = _record(address, stands, experiment, (runs, name, out), operator, yes)
    print(f"{summary_line(summary)}{' (simulated)' if simulated else ''}; in {run.path}")


def _record(
    address: str,
    rig: Rig,
    experiment: PitchExperiment,
    folder: tuple[Path, str, Path | None],
    operator: str,
    yes: bool,
) -> tuple[Run, PitchSummary, bool]:
    """Open the bench, arm, record, and close the run whatever happened."""
    from benchtool.acquire.new_run import new_pitch_run
    from benchtool.acquire.pitch_experiment import require_pitch
    from benchtool.acquire.pitch_record import record_pitch
    from benchtool.bench.drivers import open_bench
    from benchtool.bench.guard import GuardedBench
    from benchtool.bench.signals import ClosingSignals
    from benchtool.commands.terminal.announce_code import announce_code
    from benchtool.commands.terminal.closing import close_stopped
    from benchtool.commands.terminal.sweep_operator import say_of_bench, say_of_end
    from benchtool.data.parquet import load_library

    load_library()
    run: Run | None = None
    with ClosingSignals() as closing:
        try:
            with GuardedBench(open_bench(address, announce_code), rig) as bench:
                identity = bench.identity
                say_of_bench(identity, rig)
                require_pitch(identity)
                _arm(bench, rig, experiment, yes)
                run = new_pitch_run(folder, experiment, rig, identity, operator=operator)
                print(f"run {run.path}", flush=True)
                closing.begin()
                summary = record_pitch(bench, rig, experiment, run)
            say_of_end(bench)
        except BaseException:
            if run is not None:
                close_stopped(run)
            raise
        run.close()
    return run, summary, identity.simulated


def _arm(bench: GuardedBench, rig: Rig, experiment: PitchExperiment, yes: bool) -> None:
    from datetime import datetime

    from benchtool.acquire.arming import CONFIRMATION, require_unattended
    from benchtool.acquire.pitch_experiment import arming_text, expected_on
    from benchtool.commands.terminal.sweep_operator import confirm_arming

    identity = bench.identity
    text = arming_text(experiment, rig, expected_on(identity, experiment, rig))
    if yes:
        require_unattended(identity, rig, datetime.now().astimezone().date())
        print(text, flush=True)
    else:
        confirm_arming(text, CONFIRMATION, bench)
