"""`benchtool record`: a pitch experiment from a bench into a run folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import Gt, Le

from benchtool.bench.signals import ClosingSignals
from benchtool.commands.input_commands import command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.commands.terminal.sweep_operator import TERMINAL
from benchtool.core.inputs import Input, Inputs

if TYPE_CHECKING:
    from benchtool.acquire.pitch_experiment import PitchExperiment
    from benchtool.acquire.pitch_record import PitchSummary
    from benchtool.core.rig import Rig
    from benchtool.data.run.run import Run


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordInputs(Inputs):
    """What `benchtool record` takes."""

    address: Annotated[
        str,
        Input("The bench: sim:pquad?mode=pitch, serial:PORT, tcp:HOST:PORT.", argument="ADDRESS"),
    ]
    rig: Annotated[str | None, Input("Rig by name, or a rig file.")] = None
    seconds: Annotated[
        float, Gt(0.0), Le(3600.0), Input("How long, on the bench's clock.", "s", label="Length, s")
    ] = 40.0
    collective: Annotated[
        Annotated[float, Gt(0.0), Le(1e4)] | None,
        Input("Pulse that arms the device.", "us", default_text="hover", label="Collective, us"),
    ] = None
    plate_z_m: Annotated[
        Annotated[float, Gt(0.0), Le(1000.0)] | None,
        Input("Send the plate there before.", "m", label="Plate distance, m", default_text="stays"),
    ] = None
    limit_deg: Annotated[
        float,
        Gt(0.0),
        Le(90.0),
        Input("Stop beyond this pitch angle.", "deg", label="Stop beyond, deg"),
    ] = 45.0
    schedule: Annotated[
        str, Input("What the device runs, for the record.", default_text="its own word")
    ] = ""
    name: Annotated[str, Input("Name of the run.", label="Name of the run", group="Run folder")] = (
        "pitch"
    )
    runs: Annotated[Path, Input("Where run folders are made.")] = Path("runs")
    out: Annotated[Path | None, Input("Exactly this run folder; must be new.")] = None
    operator: Annotated[str, Input("Who measures; the user when left out.")] = ""
    yes: Annotated[
        bool, Input("No typed arming: simulated or checked today.", group="This run")
    ] = False
    dry_run: Annotated[bool, Input("Show what would spin only.")] = False


@command_from_inputs(RecordInputs)
def record(inputs: RecordInputs) -> None:
    """Record a pitch experiment."""
    from benchtool.acquire.inputs import resolve_rig

    record_experiment(inputs, resolve_rig(inputs.address, inputs.rig))


def record_experiment(inputs: RecordInputs, stands: Rig) -> Run | None:
    """Check an experiment on a rig, arm and record it; return the run, None of a dry one."""
    from benchtool.acquire.pitch_experiment import arming_text, check_experiment
    from benchtool.acquire.pitch_record import summary_line
    from benchtool.bench.drivers import open_bench
    from benchtool.data.run.run import check_not_existing

    experiment = experiment_of(inputs, stands)
    expected = check_experiment(experiment, stands)
    if inputs.out is not None:
        check_not_existing(inputs.out)
    if inputs.dry_run:
        open_bench(inputs.address, announce_code)  # refuses a wrong name; opens nothing yet
        print(arming_text(experiment, stands, expected))
        print("dry run: nothing was opened, nothing spins")
        return None
    run, summary, simulated = _record(inputs, stands, experiment)
    print(f"{summary_line(summary)}{' (simulated)' if simulated else ''}; in {run.path}")
    return run


def experiment_of(inputs: RecordInputs, rig: Rig) -> PitchExperiment:
    """Return what is recorded on a rig."""
    from math import radians

    from benchtool.acquire.pitch_experiment import PitchExperiment, hover_pulse_us

    pulse_us = inputs.collective
    return PitchExperiment(
        seconds=inputs.seconds,
        collective_us=hover_pulse_us(rig) if pulse_us is None else pulse_us,
        plate_z_m=inputs.plate_z_m,
        pitch_limit_rad=radians(inputs.limit_deg),
        schedule=inputs.schedule,
    )


def _record(
    inputs: RecordInputs, rig: Rig, experiment: PitchExperiment
) -> tuple[Run, PitchSummary, bool]:
    """Open the bench, arm, record, and close the run whatever happened."""
    from benchtool.acquire.operator import arm, close_stopped, describe_bench, describe_end
    from benchtool.acquire.pitch_experiment import arming_text, expected_extremes, require_pitch
    from benchtool.acquire.pitch_record import record_pitch
    from benchtool.acquire.run_creation import new_pitch_run
    from benchtool.acquire.stop_listener import accept_stops
    from benchtool.bench.drivers import open_bench
    from benchtool.bench.guard import GuardedBench
    from benchtool.data.parquet import load_library

    load_library()
    run: Run | None = None
    with ClosingSignals() as closing:
        try:
            guard = GuardedBench(open_bench(inputs.address, announce_code), rig)
            with accept_stops(guard, inputs.address) as bench:
                identity = bench.identity
                describe_bench(TERMINAL, identity, rig)
                require_pitch(identity)
                expected = expected_extremes(identity, experiment, rig)
                text = arming_text(experiment, rig, expected)
                arm(TERMINAL, text, bench, rig, unattended=inputs.yes)
                folder = (inputs.runs, inputs.name, inputs.out)
                run = new_pitch_run(folder, experiment, rig, identity, operator=inputs.operator)
                print(f"run {run.path}", flush=True)
                closing.begin()
                summary = record_pitch(bench, rig, experiment, run)
            describe_end(TERMINAL, bench)
        except BaseException:
            if run is not None:
                close_stopped(TERMINAL, run)
            raise
        run.close()
    return run, summary, identity.simulated
