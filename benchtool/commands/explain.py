"""`benchtool explain`: where a model disagrees with recordings, and which effect it lacks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge, Gt, Le, Lt

from benchtool.commands.declared import GroupedCommand, declared
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.inputs import Input, Inputs

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


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainInputs(Inputs):
    """What `benchtool explain` takes."""

    recordings: Annotated[
        tuple[str, ...],
        Input(
            "To learn from: CSV, Parquet of benchtool import, run folders.", argument="RECORDING"
        ),
    ] = ()
    model: Annotated[
        str, Input("Shipped model (benchtool models) or the path of a model file.")
    ] = ""
    rig: Annotated[str | None, Input("Rig of a CSV: shipped name or path; runs carry theirs.")] = (
        None
    )
    check: Annotated[
        tuple[str, ...], Input("To check on: same bench, not learned from; one or more.")
    ] = ()
    out: Annotated[
        Path | None, Input("Folder for page, figures, new model or next experiment.")
    ] = None
    json: Annotated[Path | None, Input("File for the answer as JSON.")] = None
    effects: Annotated[
        str | None, Input("Python file or module with effects of your own.", group="Search")
    ] = None
    seed: Annotated[int, Ge(0), Input("Seed of everything random.")] = 0
    draws: Annotated[int, Ge(20), Le(100_000), Input("Draws of the noise behind the floor.")] = 128
    bootstrap: Annotated[
        int, Ge(0), Input("Simulated records behind p-values; asymptotic ones without.")
    ] = 0
    overwrite: Annotated[bool, Input("Replace an earlier answer's files.")] = False
    bench: Annotated[
        str | None,
        Input(
            "Address of the bench: record next experiments on it, each armed anew.",
            group="Next experiments on a bench",
        ),
    ] = None
    until: Annotated[
        float, Gt(0.5), Lt(1.0), Input("With --bench: how probable the answer shall become.")
    ] = 0.95
    most_experiments: Annotated[int, Ge(1), Le(20), Input("With --bench: experiments at most.")] = 3
    most_minutes: Annotated[
        float, Gt(0.0), Le(600.0), Input("With --bench: minutes of experiments at most.", "min")
    ] = 30.0
    stage: Annotated[
        str | None,
        Input("With --bench: what moves the plate, as of benchtool sweep.", empty="as rig says"),
    ] = None


@declared(ExplainInputs)
def explain(inputs: ExplainInputs) -> None:
    """Name the effect that a model lacks, and show the gap shrink

    The first line printed is the verdict: an effect, several, a class that this data cannot
    separate, none, or unknown. The last lines say what was added to which file and what to type
    next: after a named effect, to explain again with the new model, to fit and to simulate with it;
    where the answer is not sure, the experiment that separates what is likely. With --bench it is
    recorded, armed by hand each time, and explained with the others until the answer is sure.
    """
    from benchtool.commands.terminal.experiments import bench_for, record_next, why_no_more
    from benchtool.report.answer.folder import refuse_taken

    question = _question(inputs, inputs.recordings)
    stands = bench_for(inputs.bench, question, inputs.out) if inputs.bench is not None else None
    if not inputs.overwrite:
        refuse_taken(inputs.out, inputs.json)
    left_min, made = inputs.most_minutes, 0
    answer = _answered(inputs, question, left_min)
    if inputs.bench is None or stands is None or inputs.out is None:
        return
    while not (ended := why_no_more(answer, inputs, made, left_min)):
        experiment, made = answer.verdict.next, made + 1
        assert experiment is not None
        print(f"\nExperiment {made} of {inputs.most_experiments} at most: {experiment.title}")
        run = record_next(answer, experiment, inputs, stands)
        left_min -= experiment.minutes
        learned = (*(source.path for source in answer.request.learn), str(run.path))
        answer = _answered(inputs, _question(inputs, learned), left_min)
    print(ended)


def _question(inputs: ExplainInputs, learn: tuple[str, ...]) -> Request:
    """Read the recordings to learn from, with everything else that was named."""
    from benchtool.explain.answer import read_request

    return read_request(
        learn, inputs.check, inputs.model, inputs.effects, announce_code, inputs.rig
    )


def _answered(inputs: ExplainInputs, question: Request, minutes: float) -> Answer:
    """Answer a question, write the answer and print it."""
    import shlex
    import sys
    import time
    from dataclasses import replace

    from benchtool.commands.terminal.show_explain import (
        for_a_reader,
        print_answer,
        print_next,
        working,
    )
    from benchtool.explain.answer import answer_request
    from benchtool.explain.engine.verdict import SURE
    from benchtool.report.answer.folder import Written, write_folder, write_json

    began = time.monotonic()
    with working(", ".join(source.path for source in question.sources)) as report:
        answer = answer_request(
            question,
            commands=[shlex.join(["benchtool", *sys.argv[1:]])],
            seed=inputs.seed,
            draws=inputs.draws,
            bootstrap=inputs.bootstrap,
            sure=SURE if inputs.bench is None else inputs.until,
            minutes=None if inputs.bench is None else minutes,
            progress=report,
        )
    answer = replace(answer, seconds=time.monotonic() - began)
    written = Written()
    if inputs.out is not None:
        written = write_folder(inputs.out, answer, question.effects_file)
    if inputs.json is not None:
        write_json(inputs.json, answer, written)
    with for_a_reader():
        print_answer(answer)
        print_next(answer, inputs.out, inputs.json)
    return answer
