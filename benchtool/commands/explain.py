"""`benchtool explain`: where a model disagrees with recordings, and which effect it lacks."""

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
    from benchtool.explain.answer import ExplainResult, Request

CHECK_OPTION = "--check"


class Parser(GroupedCommand):
    """A command whose --check takes every word up to the next option.

    Without it a second word would pass for a recording to learn from, and nobody would notice.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        return super().parse_args(ctx, expand_repeated(args))


def expand_repeated(words: list[str]) -> list[str]:
    """Return the words with --check before each of those that follow it."""
    out: list[str] = []
    follows = False  # whether the last option was --check with a word of its own
    for place, word in enumerate(words):
        before = words[place - 1] if place else ""
        if word.startswith("-") and len(word) > 1:
            follows = word.startswith(f"{CHECK_OPTION}=")
        elif before == CHECK_OPTION:
            follows = True
        elif follows:
            out.append(CHECK_OPTION)
        out.append(word)
    return out


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainArguments(ExplainInputs):
    """What `benchtool explain` takes on the command line."""

    each: Annotated[
        bool,
        Input(
            "Explain each RECORDING by itself, its --check in the same place, side by side.",
            group="Several recordings",
        ),
    ] = False


@command_from_inputs(ExplainArguments)
def explain(inputs: ExplainArguments) -> None:
    """Identify effects that a model lacks.

    The first line printed is the verdict: an effect, several, a class that this data cannot
    separate, none, or unknown. The last lines say what was added to which file and what to type
    next: after a named effect, to explain again with the new model, to fit and to simulate with it;
    where the answer is not sure, the experiment that separates what is likely. With --bench it is
    recorded, armed by hand each time, and explained with the others until the answer is sure.
    """
    from benchtool.commands.terminal.experiments import (
        open_experiment_bench,
        record_next,
        stop_reason,
    )
    from benchtool.report.answer.folder import check_not_existing
    from benchtool.results import build_request

    if inputs.cluster is not None and not inputs.each and not inputs.bootstrap:
        raise InputError(
            "--cluster is for --each, or for the draws of --bootstrap; add one, or leave it out"
        )

    if inputs.each:
        _explain_each(inputs)
        return
    request = build_request(inputs, announce_code)
    stands = (
        open_experiment_bench(inputs.bench, request, inputs.out)
        if inputs.bench is not None
        else None
    )
    if not inputs.overwrite:
        check_not_existing(inputs.out, inputs.json)
    left_min, made = inputs.most_minutes, 0
    answer = _answered(inputs, request, left_min)
    if inputs.bench is None or stands is None or inputs.out is None:
        return
    while not (ended := stop_reason(answer, inputs, made, left_min)):
        experiment, made = answer.verdict.next, made + 1
        assert experiment is not None
        print(f"\nExperiment {made} of {inputs.most_experiments} at most: {experiment.title}")
        run = record_next(answer, experiment, inputs, stands)
        left_min -= experiment.minutes
        learned = (*(source.path for source in answer.request.learn), str(run.path))
        request = build_request(replace(inputs, recordings=learned), announce_code)
        answer = _answered(inputs, request, left_min)
    print(ended)


def _answered(inputs: ExplainInputs, request: Request, minutes: float) -> ExplainResult:
    """Answer a question, write the answer and print it."""
    import shlex
    import sys

    from benchtool.commands.terminal.show_explain import (
        is_interactive,
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
    with is_interactive():
        print_answer(result.found)
        print_next(result.found, inputs.out, inputs.json)
    return result.found


def _explain_each(inputs: ExplainArguments) -> None:
    """Explain several recordings, each by itself; print and write the answers."""
    import shlex
    import sys
    from functools import partial

    from benchtool.commands.terminal.batch import index_by_name, outcome, raise_first, run_each
    from benchtool.commands.terminal.tables import Output, print_table
    from benchtool.report.page import Table
    from benchtool.results import build_request

    for option, given in (("--bench", inputs.bench), ("--json", inputs.json)):
        if given is not None:
            raise InputError(f"{option} is for one explanation; leave it or --each out")
    if len(inputs.check) not in (1, len(inputs.recordings)):
        raise InputError(
            f"{len(inputs.recordings)} recordings and {len(inputs.check)} to check on: with --each "
            f"give one check recording for each, in their order, or one for all"
        )
    named = index_by_name(inputs.recordings)
    checks = inputs.check * (len(named) // len(inputs.check))
    tasks = {
        name: replace(inputs, recordings=(data,), check=(check,), each=False, cluster=None)
        for (name, data), check in zip(named.items(), checks, strict=True)
    }
    build_request(next(iter(tasks.values())), announce_code)
    about = replace(inputs, out=None, cluster=None)
    command = shlex.join(["benchtool", *sys.argv[1:]])
    permitted = inputs.cluster is None  # Python of the user's own is announced, and stays here
    found = run_each(
        partial(outcome, partial(_explain_one, inputs.out, command, permitted)),
        {name: (name, task) for name, task in tasks.items()},
        out=inputs.out,
        about={"explain": str(about)},
        cluster=inputs.cluster,
    )
    rows = [(name, one["result"]["sentence"]) for name, one in found.items() if one["result"]]
    if rows:
        print_table(Output(), Table("Each by itself.", ("recording", "answer"), rows, 2))
    if inputs.out is not None:
        print(f"written: {inputs.out}, with a folder of each")
    raise_first(found)


def _explain_one(
    out: Path | None, command: str, permitted: bool, item: tuple[str, ExplainInputs]
) -> dict[str, Any]:
    """Return one answer as its JSON has it, its folder written; called in a process of its own."""
    from benchtool.commands.terminal.batch import reject_duplicate_outputs
    from benchtool.report.answer.folder import WrittenFiles, answer_tables
    from benchtool.results import explain_result

    name, inputs = item
    permit: CodePermit = (lambda file: None) if permitted else check_code_allowed
    inputs = replace(inputs, out=None)
    result = explain_result(inputs, permit=permit, commands=[command])
    reject_duplicate_outputs(None if out is None else out / name, result.save)
    return answer_tables(result.found, WrittenFiles())
