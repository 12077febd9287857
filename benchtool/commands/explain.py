"""`benchtool explain`: where a model disagrees with recordings, and which effect it lacks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from benchtool.commands.declared import GroupedCommand, declared
from benchtool.commands.terminal.messages import announce_code
from benchtool.explain.inputs import ExplainInputs

if TYPE_CHECKING:
    from benchtool.explain.answer import Answer, Request

CHECK = "--check"


class Parser(GroupedCommand):
    """A command whose --check takes every word up to the next option.

    Without it a second word would pass for a recording to learn from, and nobody would notice.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        return super().parse_args(ctx, spread(args))


def spread(words: list[str]) -> list[str]:
    """Return the words with --check before each of those that follow it."""
    out: list[str] = []
    follows = False  # whether the last option was --check with a word of its own
    for place, word in enumerate(words):
        before = words[place - 1] if place else ""
        if word.startswith("-") and len(word) > 1:
            follows = word.startswith(f"{CHECK}=")
        elif before == CHECK:
            follows = True
        elif follows:
            out.append(CHECK)
        out.append(word)
    return out


@declared(ExplainInputs)
def explain(inputs: ExplainInputs) -> None:
    """Name the effect that a model lacks, and show the gap shrink

    The first line printed is the verdict: an effect, several, a class that this data cannot
    separate, none, or unknown. The last lines say what was added to which file and what to type
    next: after a named effect, to explain again with the new model, to fit and to simulate with it;
    where the answer is not sure, the experiment that separates what is likely. With --bench it is
    recorded, armed by hand each time, and explained with the others until the answer is sure.
    """
    from dataclasses import replace

    from benchtool.commands.terminal.experiments import bench_for, record_next, why_no_more
    from benchtool.report.answer.folder import refuse_taken
    from benchtool.results import request_of

    request = request_of(inputs, announce_code)
    stands = bench_for(inputs.bench, request, inputs.out) if inputs.bench is not None else None
    if not inputs.overwrite:
        refuse_taken(inputs.out, inputs.json)
    left_min, made = inputs.most_minutes, 0
    answer = _answered(inputs, request, left_min)
    if inputs.bench is None or stands is None or inputs.out is None:
        return
    while not (ended := why_no_more(answer, inputs, made, left_min)):
        experiment, made = answer.verdict.next, made + 1
        assert experiment is not None
        print(f"\nExperiment {made} of {inputs.most_experiments} at most: {experiment.title}")
        run = record_next(answer, experiment, inputs, stands)
        left_min -= experiment.minutes
        learned = (*(source.path for source in answer.request.learn), str(run.path))
        request = request_of(replace(inputs, recordings=learned), announce_code)
        answer = _answered(inputs, request, left_min)
    print(ended)


def _answered(inputs: ExplainInputs, request: Request, minutes: float) -> Answer:
    """Answer a question, write the answer and print it."""
    import shlex
    import sys

    from benchtool.commands.terminal.show_explain import (
        for_a_reader,
        print_answer,
        print_next,
        working,
    )
    from benchtool.report.answer.folder import write_json
    from benchtool.results import explain_result

    with working(", ".join(source.path for source in request.sources)) as report:
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
    with for_a_reader():
        print_answer(result.found)
        print_next(result.found, inputs.out, inputs.json)
    return result.found
