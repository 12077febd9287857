"""What to do after an answer, with the commands: the same words for page and terminal."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchtool.core.rig_file import export_rig_reference
from benchtool.core.schedule_file import schedule_to_toml
from benchtool.explain.answer import ExplainResult
from benchtool.explain.law_search.draft import FOUND
from benchtool.explain.recordings import RecordingSource
from benchtool.explain.updated_model import MODEL, own_names
from benchtool.physics.effects.effect import BenchKind

RICHER_EXPERIMENT_HINT: dict[
    BenchKind, str
] = {  # what to record where most effects could not be judged
    "pitch": (
        "Record next: steps and slow reversals of the attitude at two collectives or more, the "
        "plate at three distances and away, some dither on the pulses; the schedule identify does "
        "all that."
    ),
    "sweep": (
        "Record next: near distances (z/R of 0.6 to 1) and far ones, two or three levels up and "
        "down, and tares."
    ),
}


@dataclass(frozen=True, slots=True)
class NextStep:
    """Suggested next step with its command."""

    why: str  # purpose
    command: str  # run in the folder of the request


def next_file(answer: ExplainResult) -> tuple[str, str]:
    """Return name and text of the next experiment's file; empty where there is none."""
    experiment = answer.verdict.next
    if experiment is None or not experiment.decides:
        return "", ""
    if experiment.schedule is not None:
        return "next_schedule.toml", schedule_to_toml(experiment.schedule)
    return "next_plan.toml", experiment.plan_toml


def next_sentence(answer: ExplainResult) -> str:
    """Return a recommendation for the next recording; empty if none is needed."""
    experiment = answer.verdict.next
    if experiment is None:
        poor = answer.verdict.mostly_blind and not answer.verdict.is_sure
        return RICHER_EXPERIMENT_HINT[answer.verdict.bench] if poor else ""
    if not experiment.decides:
        return (
            f"No experiment within reach decides: {experiment.title[:1].lower()}"
            f"{experiment.title[1:]} is the best one, and only {experiment.reason}."
        )
    return (
        f"Record next: {experiment.title}. {experiment.reason[:1].upper()}{experiment.reason[1:]}."
    )


def next_steps(answer: ExplainResult, folder: str = "") -> tuple[NextStep, ...]:
    """Return the next commands, the most useful first.

    Args:
        folder: that the answer is written to; empty where it is not.
    """
    name, _ = next_file(answer)
    if not folder:
        if not (answer.has_model or name):
            return ()
        parts = {"the new model": answer.has_model, "the next experiment": bool(name)}
        what = " and ".join(part for part, there in parts.items() if there)
        return (
            NextStep(f"write {what}", _explain(answer, answer.request.model_given, out="found")),
        )
    new = str(Path(folder) / MODEL)
    dependence = answer.verdict.depends
    drafted: tuple[NextStep, ...] = ()
    if dependence is not None and dependence.law is not None:
        file = str(Path(folder) / f"{FOUND}.py")
        why = f"read {file}, name it after its cause, and explain again with it"
        command_again = _explain(
            replace(answer, request=replace(answer.request, effects_given=file)),
            answer.request.model_given, out=f"{folder}-again",
        )  # fmt: skip
        drafted = (NextStep(why, command_again),)
    if name:
        return (*drafted, *_experiment(answer, str(Path(folder) / name), new, folder))
    if drafted:
        return drafted
    if not answer.has_model:
        return ()
    command = _explain(answer, new, out=f"{folder}-again", own=not own_names(answer))
    again = NextStep("explain again: is anything still missing?", command)
    if answer.verdict.bench == "pitch":
        arguments = ["simulate", "pitch", "--model", new, "--out", f"{folder}-simulated"]
        return (again, NextStep("simulate with the new model", _typed(arguments)))
    fit = ["fit", *_paths(answer.request.learn), "--model", new, "--out", f"{folder}-fit"]
    rig, is_user_defined = export_rig_reference(answer.request.loaded.model.rig)
    rig_path = str(Path(folder) / rig) if is_user_defined else rig
    sweep = [
        "sweep",
        f"sim:{rig_path}?truth={new}",
        "--z-over-r",
        "0.6,1,2,4",
        "--pwm",
        "1500,1600",
    ]
    return (
        again,
        NextStep("fit what was found, with its uncertainty", _typed(fit)),
        NextStep(
            "sweep a virtual bench that has it",
            _typed([*sweep, "--yes", "--out", f"{folder}-sweep"]),
        ),
    )


def lines(steps: Sequence[NextStep]) -> list[str]:
    """Return steps as a shell takes them, each command under its purpose."""
    return [line for step in steps for line in (f"# {step.why}", step.command)]


def _experiment(answer: ExplainResult, file: str, new: str, folder: str) -> tuple[NextStep, ...]:
    """Return the steps of a next experiment: try it, do it, explain with it."""
    model = new if answer.has_model else answer.request.model_given
    run = f"{folder}-next"
    if answer.verdict.bench == "pitch":
        tried = [
            "simulate",
            "pitch",
            "--model",
            model,
            "--schedule",
            file,
            "--out",
            f"{folder}-try",
        ]
        done = ["record", "ADDRESS", "--schedule", file, "--out", run]
        steps = [
            NextStep("try the experiment on a simulated bench", _typed(tried)),
            NextStep("do it (ADDRESS: your bench, whose device runs the schedule)", _typed(done)),
        ]
    else:
        planned = ["sweep", "ADDRESS", "--plan", file, "--out", run]
        steps = [NextStep("do the experiment (ADDRESS: your bench)", _typed(planned))]
    last = _explain(answer, answer.request.model_given, more=[run], out=f"{folder}-again")
    return (*steps, NextStep("explain with what it recorded", last))


def _explain(
    answer: ExplainResult, model: str, out: str, more: Sequence[str] = (), *, own: bool = True
) -> str:
    """Return the command; `own` where the model does not bring the user's own effects itself."""
    arguments = ["explain", *_paths(answer.request.learn), *more, "--model", model]
    arguments += ["--check", *_paths(answer.request.check)]
    if answer.request.rig_given and model == answer.request.model_given:
        arguments += ["--rig", answer.request.rig_given]
    if answer.request.effects_given and own:
        arguments += ["--effects", answer.request.effects_given]
    return _typed([*arguments, "--out", out])


def _paths(sources: Sequence[RecordingSource]) -> list[str]:
    return [source.path for source in sources]


def _typed(arguments: Sequence[str]) -> str:
    return shlex.join(["benchtool", *arguments])
