"""Command `benchtool explain`: identification of effects that a model lacks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from benchtool.commands.input_commands import GroupedCommand, command_from_inputs
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.explain.inputs import ExplainInputs

if TYPE_CHECKING:
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


@command_from_inputs(ExplainArguments)
def explain(inputs: ExplainArguments) -> None:
    """Identify effects that a model lacks.

    The first line is the verdict: one effect, several, a class of effects that the data cannot
    separate, none, or unknown. The last lines are the changes of the model file and the next
    commands: explain, fit and simulate with the new model, or the experiment that separates the
    candidates. With --bench this experiment is recorded, with an arming confirmation each time,
    until the verdict reaches the probability --until.
    """
    from benchtool.commands.terminal.experiments import (
        open_experiment_bench,
        record_next,
        stop_reason,
    )
    from benchtool.explain.request import read_request
    from benchtool.report.answer.folder import check_not_existing

    if inputs.cluster is not None and not inputs.each and not inputs.bootstrap:
        raise InputError("--cluster needs --each or --bootstrap; add one, or remove --cluster")
    if inputs.each:
        _explain_each(inputs)
        return
    request = read_request(inputs, announce_code)
    rig = None
    if inputs.bench is not None:
        rig = open_experiment_bench(inputs.bench, request, inputs.out)
    if not inputs.overwrite:
        check_not_existing(inputs.out, inputs.json)
    remaining_min, n_recorded = inputs.most_minutes, 0
    answer = _explain(inputs, request, remaining_min)
    if inputs.bench is None or rig is None or inputs.out is None:
        return
    while not (reason := stop_reason(answer, inputs, n_recorded, remaining_min)):
        experiment, n_recorded = answer.next, n_recorded + 1
        assert experiment is not None
        print(f"\nExperiment {n_recorded} of up to {inputs.most_experiments}: {experiment.title}")
        run = record_next(answer, experiment, inputs, rig)
        remaining_min -= experiment.minutes
        training = (*(source.path for source in answer.request.learn), str(run.path))
        request = read_request(replace(inputs, recordings=training), announce_code)
        answer = _explain(inputs, request, remaining_min)
    print(reason)


def _explain(inputs: ExplainInputs, request: Request, minutes: float) -> Explanation:
    """Explain the recordings of a request; write and print the answer."""
    import shlex
    import sys

    from benchtool.commands.terminal.show_explain import (
        ignore_broken_pipe,
        print_answer,
        print_next,
        progress_status,
    )
    from benchtool.report.answer.folder import write_json
    from benchtool.results import explain_result

    with progress_status(", ".join(source.path for source in request.sources)) as report:
        result = explain_result(
            inputs,
            report,
            request=request,
            minutes=None if inputs.bench is None else minutes,
            commands=[shlex.join(["benchtool", *sys.argv[1:]])],
        )
    if inputs.out is not None:
        result.save(inputs.out)
    if inputs.json is not None:
        write_json(inputs.json, result.found, inputs.out)
    with ignore_broken_pipe():
        print_answer(result.found)
        print_next(result.found, inputs.out, inputs.json)
    return result.found


def _explain_each(inputs: ExplainArguments) -> None:
    """Explain several recordings separately; print and write the answers."""
    import shlex
    import sys
    from functools import partial

    from benchtool.commands.terminal.batch import index_by_name, outcome, raise_first, run_each
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
    command = shlex.join(["benchtool", *sys.argv[1:]])
    is_permitted = inputs.cluster is None  # user code runs on this machine only
    outcomes = run_each(
        partial(outcome, partial(_explain_one, inputs.out, command, is_permitted)),
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
    from benchtool.report.answer.folder import WrittenFiles, answer_tables
    from benchtool.results import explain_result

    name, inputs = item
    permit: CodePermit = (lambda file: None) if is_permitted else check_code_allowed
    inputs = replace(inputs, out=None)
    result = explain_result(inputs, permit=permit, commands=[command])
    write_folder_once(None if out is None else out / name, result.save)
    return answer_tables(result.found, WrittenFiles())
