"""Command `benchtool record`: run folder of a pitch experiment."""

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
    """Options of `benchtool record`."""

    address: Annotated[
        str, Input("Bench: sim:pquad?mode=pitch, serial:PORT, tcp:HOST:PORT.", argument="ADDRESS")
    ]
    rig: Annotated[str | None, Input("Rig name or file.")] = None
    seconds: Annotated[
        float, Gt(0.0), Le(3600.0), Input("Duration in bench time.", "s", label="Duration, s")
    ] = 40.0
    collective: Annotated[
        Annotated[float, Gt(0.0), Le(1e4)] | None,
        Input("Collective pulse width.", "us", default_text="hover", label="Collective, us"),
    ] = None
    plate_z_m: Annotated[
        Annotated[float, Gt(0.0), Le(1000.0)] | None,
        Input("Plate distance.", "m", label="Plate distance, m", default_text="unchanged"),
    ] = None
    limit_deg: Annotated[
        float,
        Gt(0.0),
        Le(90.0),
        Input("Pitch angle limit; stops the motors.", "deg", label="Stop beyond, deg"),
    ] = 45.0
    schedule: Annotated[
        str, Input("Schedule of the device, for the metadata.", default_text="as reported")
    ] = ""
    name: Annotated[str, Input("Name of the run.", label="Name of the run", group="Run folder")] = (
        "pitch"
    )
    runs: Annotated[Path, Input("Parent folder of the runs.")] = Path("runs")
    out: Annotated[Path | None, Input("New run folder.")] = None
    operator: Annotated[str, Input("Operator.", default_text="user name")] = ""
    yes: Annotated[
        bool, Input("Skip arming confirmation: simulated or checked today.", group="This run")
    ] = False
    dry_run: Annotated[bool, Input("Print the experiment only; no motor turns.")] = False


@command_from_inputs(RecordInputs)
def record(inputs: RecordInputs) -> None:
    """Record a pitch experiment."""
    from benchtool.acquire.inputs import resolve_rig

    record_experiment(inputs, resolve_rig(inputs.address, inputs.rig))


def record_experiment(inputs: RecordInputs, rig: Rig) -> Run | None:
    """Check, arm and record an experiment; return the run, or None for a dry run."""
    from benchtool.acquire.pitch_experiment import arming_text, check_experiment
    from benchtool.acquire.pitch_record import summary_line
    from benchtool.bench.drivers import open_bench
    from benchtool.data.run.run import check_not_existing

    experiment = build_experiment(inputs, rig)
    expected = check_experiment(experiment, rig)
    if inputs.out is not None:
        check_not_existing(inputs.out)
    if inputs.dry_run:
        open_bench(inputs.address, announce_code)  # checks the address; opens nothing yet
        print(arming_text(experiment, rig, expected))
        print("dry run: nothing was opened, nothing spins")
        return None
    run, summary, simulated = _record(inputs, rig, experiment)
    print(f"{summary_line(summary)}{' (simulated)' if simulated else ''}; in {run.path}")
    return run


def build_experiment(inputs: RecordInputs, rig: Rig) -> PitchExperiment:
    """Return the pitch experiment of the options."""
    from math import radians

    from benchtool.acquire.pitch_experiment import PitchExperiment, hover_pulse_us

    command_pwm_us = inputs.collective
    return PitchExperiment(
        seconds=inputs.seconds,
        collective_us=hover_pulse_us(rig) if command_pwm_us is None else command_pwm_us,
        plate_z_m=inputs.plate_z_m,
        pitch_limit_rad=radians(inputs.limit_deg),
        schedule=inputs.schedule,
    )


def _record(
    inputs: RecordInputs, rig: Rig, experiment: PitchExperiment
) -> tuple[Run, PitchSummary, bool]:
    """Open the bench, arm, record, and close the run even after an error."""
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
    with ClosingSignals() as signals:
        try:
            guard = GuardedBench(open_bench(inputs.address, announce_code), rig)
            with accept_stops(guard, inputs.address) as bench:
                device = bench.identity
                describe_bench(TERMINAL, device, rig)
                require_pitch(device)
                expected = expected_extremes(device, experiment, rig)
                text = arming_text(experiment, rig, expected)
                arm(TERMINAL, text, bench, rig, unattended=inputs.yes)
                folder = (inputs.runs, inputs.name, inputs.out)
                run = new_pitch_run(folder, experiment, rig, device, operator=inputs.operator)
                print(f"run {run.path}", flush=True)
                signals.ignore_signals()
                summary = record_pitch(bench, rig, experiment, run)
            describe_end(TERMINAL, bench)
        except BaseException:
            if run is not None:
                close_stopped(TERMINAL, run)
            raise
        run.close()
    return run, summary, device.simulated
