"""`benchtool explain`: where a model disagrees with recordings, and which effect it lacks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Ge, Le
from typer.core import TyperCommand

from benchtool.commands.declared import declared
from benchtool.commands.terminal.messages import announce_code
from benchtool.core.inputs import Input, Inputs

CHECK = "--check"


class Parser(TyperCommand):
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
    effects: Annotated[str | None, Input("Python file or module with effects of your own.")] = None
    seed: Annotated[int, Ge(0), Input("Seed of everything random.")] = 0
    draws: Annotated[int, Ge(20), Le(100_000), Input("Draws of the noise behind the floor.")] = 128
    bootstrap: Annotated[
        int, Ge(0), Input("Simulated records behind p-values; asymptotic ones without.")
    ] = 0
    overwrite: Annotated[bool, Input("Replace an earlier answer's files.")] = False


@declared(ExplainInputs)
def explain(inputs: ExplainInputs) -> None:
    """Name the effect that a model lacks, and show the gap shrink

    The first line printed is the verdict: an effect, several, a class that this data cannot
    separate, none, or unknown. The last lines say what was added to which file and what to type
    next: after a named effect, to ask again with the new model, to fit and to simulate with it;
    after a class or an unknown, the experiment that separates what is likely.
    """
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
    from benchtool.explain.answer import answer_request, read_request
    from benchtool.report.answer.folder import Written, refuse_taken, write_folder, write_json

    began = time.monotonic()
    learned, checked, out, json_file = inputs.recordings, inputs.check, inputs.out, inputs.json
    question = read_request(
        learned, checked, inputs.model, inputs.effects, announce_code, inputs.rig
    )
    if not inputs.overwrite:
        refuse_taken(out, json_file)
    with working(", ".join([*learned, *checked])) as report:
        answer = answer_request(
            question,
            commands=[shlex.join(["benchtool", *sys.argv[1:]])],
            seed=inputs.seed,
            draws=inputs.draws,
            bootstrap=inputs.bootstrap,
            progress=report,
        )
    answer = replace(answer, seconds=time.monotonic() - began)
    written = Written()
    if out is not None:
        written = write_folder(out, answer, question.effects_file)
    if json_file is not None:
        write_json(json_file, answer, written)
    with for_a_reader():
        print_answer(answer)
        print_next(answer, out, json_file)
