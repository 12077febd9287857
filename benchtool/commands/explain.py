"""Command `benchtool explain`: identification of effects that a model lacks."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from benchtool.commands.input_commands import GroupedCommand, Verbose, command_from_inputs
from benchtool.commands.terminal.messages import announce_code, typed_command
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input
from benchtool.core.text import pluralize
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.explain.inputs import ExplainInputs

if TYPE_CHECKING:
    from benchtool.core.rig import Rig
    from benchtool.data.run.run import Run
    from benchtool.explain.findings import NextExperiment
    from benchtool.explain.request import Request
    from benchtool.explain.result import Explanation

CHECK_OPTION = "--check"


class Parser(GroupedCommand):
    """Command whose --check takes all arguments up to the next option.

    Otherwise a second validation recording would silently become a training recording.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        return super().parse_args(ctx, expand_repeated(args))


def expand_repeated(arguments: list[str]) -> list[str]:
    """Return the arguments with --check before each of its values."""
    expanded: list[str] = []
    follows_check = False  # the last option was --check and has a value
    previous = ""
    for argument in arguments:
        if argument.startswith("-") and len(argument) > 1:
            follows_check = argument.startswith(f"{CHECK_OPTION}=")
        elif previous == CHECK_OPTION:
            follows_check = True
        elif follows_check:
            expanded.append(CHECK_OPTION)
        expanded.append(argument)
        previous = argument
    return expanded


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainArguments(ExplainInputs):
    """Command-line options of `benchtool explain`."""

    each: Annotated[
        bool,
        Input(
            "Explain each RECORDING separately, with the --check at the same position.",
            group="Several recordings",
        ),
    ] = False
    verbose: Verbose = False


@command_from_inputs(ExplainArguments)
def explain(inputs: ExplainArguments) -> None:
    """Identify effects that a model lacks.

    The first line is the verdict: one effect, several, a class of effects that the data cannot
    separate, none, or unknown. The last lines are the changes of the model file and the next
    command: explain with the new model, or the experiment that separates the candidates. --verbose
    prints all tables and next commands. With --bench this experiment is recorded, with an arming
    confirmation each time, until the verdict reaches the probability --until.
    """
    from benchtool.explain.request import read_request

    if inputs.cluster is not None and not inputs.each and not inputs.bootstrap:
        raise InputError("--cluster needs --each or --bootstrap; add one, or remove --cluster")
    if inputs.each:
        _explain_each(inputs)
        return
    request = read_request(inputs, announce_code)
    rig = None
    if inputs.bench is not None:
        rig = _check_bench(inputs.bench, request, inputs.out)
    if not inputs.overwrite:
        from benchtool.report.answer.folder import check_not_existing  # after all input errors

        check_not_existing(inputs.out, inputs.json)
    remaining_min, n_recorded = inputs.most_minutes, 0
    answer = _explain(inputs, request, remaining_min)
    if inputs.bench is None or rig is None or inputs.out is None:
        return
    while not (reason := _stop_reason(answer, inputs, n_recorded, remaining_min)):
        experiment, n_recorded = answer.next, n_recorded + 1
        assert experiment is not None
        print(f"\nExperiment {n_recorded} of up to {inputs.most_experiments}: {experiment.title}")
        run = _record(answer, experiment, inputs, rig)
        remaining_min -= experiment.minutes
        training = (*(source.path for source in answer.request.learn), str(run.path))
        request = read_request(replace(inputs, recordings=training), announce_code)
        answer = _explain(inputs, request, remaining_min)
    print(reason)


def _explain(inputs: ExplainArguments, request: Request, minutes: float) -> Explanation:
    """Explain the recordings of a request; write and print the answer."""
    from rich.progress import TaskProgressColumn, TimeElapsedColumn

    from benchtool.commands.terminal.tables import progress_bar
    from benchtool.report.answer.folder import write_json
    from benchtool.results import explain_result

    recordings = ", ".join(source.path for source in request.sources)
    start_line = f"explaining {recordings}; this can take a minute or more"
    with progress_bar(TaskProgressColumn(), TimeElapsedColumn()) as bar:
        task = bar.add_task("reading", total=1.0)

        def report(stage: str, fraction: float) -> None:
            nonlocal start_line
            if start_line and bar.disable:  # after all inputs are checked
                print(start_line, file=sys.stderr, flush=True)
            start_line = ""
            bar.update(task, description=stage, completed=fraction)

        result = explain_result(
            inputs,
            report,
            request=request,
            minutes=None if inputs.bench is None else minutes,
            commands=[typed_command()],
        )
    if inputs.out is not None:
        result.save(inputs.out)
    if inputs.json is not None:
        write_json(inputs.json, result.found, inputs.out)
    try:
        _print_answer(result.found, verbose=inputs.verbose)
        _print_next(result.found, inputs)
        sys.stdout.flush()
    except BrokenPipeError:  # for example of `head`
        # The remaining buffer must not be written again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return result.found


def _print_answer(answer: Explanation, *, verbose: bool) -> None:
    """Print verdict, location, and effects or gap; `verbose`: all tables and warnings."""
    from benchtool.commands.terminal.tables import Output, print_table
    from benchtool.report.answer.page import where_sentence
    from benchtool.report.answer.tables import (
        short_effects_table,
        short_gap_table,
        tolerances_table,
        unjudged_sentence,
    )

    console = Output()
    if answer.simulated:
        console.print("SIMULATED DATA: no physical bench produced these recordings")
    console.print_lines(answer.sentence, where_sentence(answer))
    if answer.effects:
        print_table(console, short_effects_table(answer))
    if verbose or not answer.effects:
        print_table(console, short_gap_table(answer, legend=verbose))
    if not verbose:
        if remarks := answer.remarks:
            more = f" ({len(remarks) - 1} more with --verbose)" if len(remarks) > 1 else ""
            console.print_lines(f"! {remarks[0]}{more}")
        return
    print_table(console, tolerances_table(answer))
    for name in answer.not_judged:
        console.print_lines(
            f"Not judged: {answer.find_title(name)} {unjudged_sentence(answer, name)}"
        )
    console.print_lines(*(f"! {line}" for line in answer.remarks))
    console.print_lines(f"Computing time: {answer.seconds:.1f} s.")


def _print_next(answer: Explanation, inputs: ExplainArguments) -> None:
    """Print the written files, model changes and next commands; briefly unless `verbose`."""
    from benchtool.commands.terminal.tables import Output
    from benchtool.explain.next_steps import format_steps, next_file, next_sentence, next_steps
    from benchtool.report.answer.folder import ANSWER
    from benchtool.report.answer.page import added_sentence, changes
    from benchtool.report.page import PAGE

    console, out = Output(), inputs.out
    folder = str(out) if out is not None else ""
    if out is not None:
        print(f"written: {out / PAGE}, figures and {ANSWER} in the same folder")
    if inputs.json is not None:
        print(f"written: {inputs.json}")
    console.print_lines(added_sentence(answer, folder))
    changed = changes(answer)
    listed = [change for change in changed if change.found or inputs.verbose]
    console.print_lines(*(f"  {change.words}" for change in listed))
    if n_hidden := len(changed) - len(listed):
        console.print_lines(f"  and {pluralize(n_hidden, 'adjusted parameter')} (--verbose)")
    if sentence := next_sentence(answer):
        name, _ = next_file(answer)
        location = f" File: {out / name}." if out is not None and name else ""
        console.print_lines(f"{sentence}{location}")
    steps = next_steps(answer, folder)
    if not (out or steps):
        print("add --out FOLDER for the report and figures")
    console.print_lines(*format_steps(steps if inputs.verbose else steps[:1]))


def _check_bench(address: str, request: Request, out: Path | None) -> Rig:
    """Return the rig of a bench after a check against the recordings; does not connect."""
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


def _stop_reason(
    answer: Explanation, inputs: ExplainInputs, n_recorded: int, remaining_min: float
) -> str:
    """Return the reason to stop recording experiments; empty to continue."""
    from benchtool.explain.next_steps import next_sentence

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


def _record(
    answer: Explanation, experiment: NextExperiment, inputs: ExplainInputs, rig: Rig
) -> Run:
    """Record an experiment after the arming confirmation."""
    from benchtool.acquire.inputs import RecordInputs, SweepInputs
    from benchtool.acquire.plan import plan_from_toml
    from benchtool.acquire.session import run_experiment
    from benchtool.commands.terminal.operator import TERMINAL
    from benchtool.explain.next_steps import next_file

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


def _explain_each(inputs: ExplainArguments) -> None:
    """Explain several recordings separately; print and write the answers."""
    from benchtool.commands.terminal.batch import index_by_name, raise_first, run_each
    from benchtool.commands.terminal.tables import Output, print_table
    from benchtool.explain.request import read_request
    from benchtool.report.page import Table

    for option, value in (("--bench", inputs.bench), ("--json", inputs.json)):
        if value is not None:
            raise InputError(f"{option} is for one explanation; remove it or --each")
    if len(inputs.check) not in (1, len(inputs.recordings)):
        raise InputError(
            f"{len(inputs.check)} --check recordings for {len(inputs.recordings)} recordings; with "
            f"--each give one for each, in the same order, or one for all"
        )
    recordings = index_by_name(inputs.recordings)
    checks = inputs.check * (len(recordings) // len(inputs.check))
    tasks = {
        name: replace(inputs, recordings=(data,), check=(check,), each=False, cluster=None)
        for (name, data), check in zip(recordings.items(), checks, strict=True)
    }
    read_request(next(iter(tasks.values())), announce_code)
    description = replace(inputs, out=None, cluster=None)
    is_permitted = inputs.cluster is None  # user code runs on this machine only
    outcomes = run_each(
        partial(_explain_one, inputs.out, typed_command(), is_permitted),
        {name: (name, task) for name, task in tasks.items()},
        out=inputs.out,
        about={"explain": str(description)},
        cluster=inputs.cluster,
    )
    rows = [(name, row["result"]["sentence"]) for name, row in outcomes.items() if row["result"]]
    if rows:
        print_table(Output(), Table("Separate explanations.", ("recording", "verdict"), rows, 2))
    if inputs.out is not None:
        print(f"written: {inputs.out}, with one folder each")
    raise_first(outcomes)


def _explain_one(
    out: Path | None, command: str, is_permitted: bool, item: tuple[str, ExplainInputs]
) -> dict[str, Any]:
    """Write the folder of one answer and return its JSON data; runs in a worker process."""
    from benchtool.commands.terminal.batch import write_folder_once
    from benchtool.report.answer.folder import answer_tables
    from benchtool.results import explain_result

    name, inputs = item
    permit: CodePermit = (lambda file: None) if is_permitted else check_code_allowed
    inputs = replace(inputs, out=None)
    result = explain_result(inputs, permit=permit, commands=[command])
    write_folder_once(None if out is None else out / name, result.save)
    return answer_tables(result.found)
