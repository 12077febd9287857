"""Recording of the experiments that an explanation proposes, each with arming confirmation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from benchtool.commands.terminal.messages import announce_code
from benchtool.commands.terminal.operator import TERMINAL
from benchtool.core.errors import InputError
from benchtool.core.text import pluralize
from benchtool.explain.next_steps import next_file, next_sentence

if TYPE_CHECKING:
    from benchtool.core.rig import Rig
    from benchtool.data.run.run import Run
    from benchtool.explain.findings import NextExperiment
    from benchtool.explain.inputs import ExplainInputs
    from benchtool.explain.request import Request
    from benchtool.explain.result import Explanation


def open_experiment_bench(address: str, request: Request, out: Path | None) -> Rig:
    """Return the rig of a bench after a check against the recordings; does not connect.

    Raises:
        InputError: no folder for the runs, an unknown address, or another rig.
    """
    from benchtool.acquire.inputs import resolve_rig
    from benchtool.bench.drivers import open_bench
    from benchtool.data.run.read import find_differences

    if out is None:
        raise InputError("--bench needs a folder for the runs; add --out FOLDER")
    open_bench(address, announce_code)
    model_rig = request.loaded.model.rig
    if not address.startswith("sim:"):
        return model_rig
    rig = resolve_rig(address, None)
    if different := find_differences(model_rig, rig):
        raise InputError(
            f"the rig of {address} differs from that of the recordings ({different[0]}); use the "
            f"bench of the recordings"
        )
    return rig


def stop_reason(
    answer: Explanation, inputs: ExplainInputs, n_recorded: int, remaining_min: float
) -> str:
    """Return the reason to stop recording experiments; empty to continue."""
    experiment = answer.next
    count = f" after {pluralize(n_recorded, 'experiment')}" if n_recorded else ""
    if answer.has_probability(inputs.until):
        return f"The verdict has reached --until {inputs.until:g}{count}."
    status = f"The verdict has not reached --until {inputs.until:g}{count}"
    if experiment is None:
        return f"{status}, and there is no experiment to propose."
    if not experiment.is_decisive:
        return f"{status}. {next_sentence(answer)}"
    if n_recorded >= inputs.most_experiments:
        return f"{status}; --most-experiments {inputs.most_experiments} is reached."
    if experiment.minutes > remaining_min:
        return (
            f"{status}; the next experiment takes {experiment.minutes:.0f} min, but only "
            f"{remaining_min:.0f} min of --most-minutes remain."
        )
    return ""


def record_next(
    answer: Explanation, experiment: NextExperiment, inputs: ExplainInputs, rig: Rig
) -> Run:
    """Print an experiment, wait for the arming confirmation and record it.

    Raises:
        RunInterrupted: not armed, or stopped.
        BenchError: the bench failed; throttle is zero.
    """
    from benchtool.acquire.inputs import RecordInputs, SweepInputs
    from benchtool.acquire.plan import plan_from_toml
    from benchtool.acquire.run_experiment import run_experiment

    assert inputs.bench is not None
    assert inputs.out is not None
    count = 1
    while (folder := inputs.out / f"experiment-{count}").exists():
        count += 1
    name, text = next_file(answer)
    run_inputs: SweepInputs | RecordInputs
    if experiment.schedule is None:
        run_inputs = SweepInputs(
            address=inputs.bench, plan=plan_from_toml(text, name), out=folder, stage=inputs.stage
        )
    else:
        file = inputs.out / name
        run_inputs = RecordInputs(
            address=_with_schedule(inputs.bench, file),
            seconds=experiment.schedule.duration_s,
            schedule=str(file),
            out=folder,
        )
    run = run_experiment(run_inputs, TERMINAL, announce_code, rig)
    assert run is not None
    return run


def _with_schedule(address: str, schedule: Path) -> str:
    """Return a `sim:` address with the schedule; for other benches print how to load it."""
    from urllib.parse import parse_qsl, urlencode

    if address.startswith("sim:"):
        base, _, query = address.partition("?")
        return f"{base}?{urlencode({**dict(parse_qsl(query)), 'schedule': str(schedule)})}"
    print(f"load schedule {schedule} into the device before arming")
    return address
