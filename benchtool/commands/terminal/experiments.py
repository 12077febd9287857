"""Record the experiments that an explanation proposes, each one shown and armed by hand."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from benchtool.commands.terminal.messages import announce_code
from benchtool.commands.terminal.sweep_operator import TERMINAL
from benchtool.core.errors import InputError
from benchtool.core.plural import pluralize
from benchtool.explain.next_steps import next_file, next_sentence

if TYPE_CHECKING:
    from benchtool.core.rig import Rig
    from benchtool.data.run.run import Run
    from benchtool.explain.answer import ExplainResult, Request
    from benchtool.explain.engine.verdict import NextExperiment
    from benchtool.explain.inputs import ExplainInputs


def open_experiment_bench(address: str, question: Request, out: Path | None) -> Rig:
    """Return the rig on a bench that is to be the one of recordings; nothing is opened.

    Raises:
        InputError: no folder for the runs, an address that nothing knows, or another rig.
    """
    from benchtool.acquire.inputs import resolve_rig
    from benchtool.bench.drivers import open_bench
    from benchtool.data.run.run_rig import differences

    if out is None:
        raise InputError("--bench records run folders beside the answer: give --out FOLDER")
    open_bench(address, announce_code)
    known = question.loaded.model.rig
    if not address.startswith("sim:"):
        return known
    stands = resolve_rig(address, None)
    if different := differences(known, stands):
        raise InputError(
            f"{address} is another rig than that of the recordings ({different[0]}); name the "
            f"bench that they were made on"
        )
    return stands


def stop_reason(answer: ExplainResult, inputs: ExplainInputs, made: int, left_min: float) -> str:
    """Return why nothing more is recorded, in a sentence; empty where an experiment comes next."""
    verdict, experiment = answer.verdict, answer.verdict.next
    after = f" after {pluralize(made, 'experiment')}" if made else ""
    if verdict.holds(inputs.until):
        return f"The answer is as sure as --until {inputs.until:g}{after}."
    still = f"The answer is not as sure as --until {inputs.until:g}{after}"
    if experiment is None:
        return f"{still}, and there is no experiment to propose."
    if not experiment.decides:
        return f"{still}. {next_sentence(answer)}"
    if made >= inputs.most_experiments:
        return f"{still}; --most-experiments {inputs.most_experiments} allows no more."
    if experiment.minutes > left_min:
        return (
            f"{still}; the next experiment takes {experiment.minutes:.0f} minutes, and "
            f"--most-minutes leaves {left_min:.0f}."
        )
    return ""


def record_next(
    answer: ExplainResult, experiment: NextExperiment, inputs: ExplainInputs, stands: Rig
) -> Run:
    """Show an experiment, have it armed by hand and record it, as `sweep` and `record` do.

    Raises:
        RunStopped: it was not armed, or stopped.
        BenchError: the bench failed; motors are at zero.
    """
    from benchtool.acquire.inputs import SweepInputs
    from benchtool.acquire.plan import plan_from_toml
    from benchtool.acquire.sweep_run import record_sweep
    from benchtool.commands.record import RecordInputs, record_experiment

    assert inputs.bench is not None
    assert inputs.out is not None
    count = 1
    while (folder := inputs.out / f"experiment-{count}").exists():
        count += 1
    name, text = next_file(answer)
    run: Run | None
    if experiment.schedule is None:
        plan = plan_from_toml(text, name).resolved(stands)
        run = record_sweep(
            SweepInputs(address=inputs.bench, plan=plan, out=folder, stage=inputs.stage),
            stands,
            TERMINAL,
            announce_code,
        )
    else:
        file = inputs.out / name
        run = record_experiment(
            RecordInputs(
                address=_running(inputs.bench, file),
                seconds=experiment.schedule.duration_s,
                schedule=str(file),
                out=folder,
            ),
            stands,
        )
    assert run is not None
    return run


def _running(address: str, schedule: Path) -> str:
    """Return the address of a bench whose device runs a schedule; a virtual one is given it."""
    from urllib.parse import parse_qsl, urlencode

    if address.startswith("sim:"):
        place, _, query = address.partition("?")
        return f"{place}?{urlencode({**dict(parse_qsl(query)), 'schedule': str(schedule)})}"
    print(f"the device runs the schedule by itself: load {schedule} into it before you arm")
    return address
