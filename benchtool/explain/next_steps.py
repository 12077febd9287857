"""Suggested next steps with their commands, for page and terminal."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchtool.core.rig_file import export_rig_reference
from benchtool.core.schedule import schedule_to_toml
from benchtool.explain.law_search.draft import DRAFT_NAME
from benchtool.explain.recordings import RecordingSource
from benchtool.explain.request import Request
from benchtool.explain.result import Explanation
from benchtool.explain.updated_model import MODEL, user_effect_names
from benchtool.physics.effects.effect import BenchKind

RICHER_EXPERIMENT_HINT: dict[BenchKind, str] = {  # if most effects are unjudged
    "pitch": (
        "Record next: steps and slow reversals of the attitude at two or more collectives, with "
        "the plate at three distances and parked, and dither on the pulse widths; the schedule "
        "identify does all of it."
    ),
    "sweep": (
        "Record next: near (z/R of 0.6 to 1) and far distances, two or three throttles up and "
        "down, and tares."
    ),
}


@dataclass(frozen=True, slots=True)
class NextStep:
    """Suggested next step with its command."""

    purpose: str
    command: str  # for the folder of the request


def next_file(answer: Explanation) -> tuple[str, str]:
    """Return name and text of the file of the next experiment; empty without a decisive one."""
    experiment = answer.next
    if experiment is None or not experiment.is_decisive:
        return "", ""
    if experiment.schedule is not None:
        return "next_schedule.toml", schedule_to_toml(experiment.schedule)
    return "next_plan.toml", experiment.plan_toml


def next_sentence(answer: Explanation) -> str:
    """Return a recommendation for the next recording; empty if none is needed."""
    experiment = answer.next
    if experiment is None:
        is_poor = answer.is_mostly_unjudged and not answer.is_sure
        return RICHER_EXPERIMENT_HINT[answer.bench] if is_poor else ""
    title, reason = experiment.title, experiment.reason
    if not experiment.is_decisive:
        title = f"{title[:1].lower()}{title[1:]}"
        return f"No possible experiment is decisive; the best one, {title}, is only {reason}."
    return f"Record next: {title}. {reason[:1].upper()}{reason[1:]}."


def next_steps(answer: Explanation, folder: str = "") -> tuple[NextStep, ...]:
    """Return the next commands, most useful first; `folder` is that of the answer, if written."""
    name, _ = next_file(answer)
    request, again = answer.request, f"{folder}-again"
    if not folder:
        if not (answer.effects or name):
            return ()
        files = ["the new model"] if answer.effects else []
        files += ["the next experiment"] if name else []
        command = _explain_command(request, request.model_given, out="found")
        return (NextStep(f"write {' and '.join(files)}", command),)
    new = str(Path(folder) / MODEL)
    dependence = answer.depends
    drafted: tuple[NextStep, ...] = ()
    if dependence is not None and dependence.law is not None:
        file = str(Path(folder) / f"{DRAFT_NAME}.py")
        purpose = f"check {file}, name it after its cause, and explain again with it"
        with_draft = replace(request, effects_given=file)
        drafted = (NextStep(purpose, _explain_command(with_draft, request.model_given, again)),)
    if name:
        return (*drafted, *_experiment_steps(answer, str(Path(folder) / name), new, folder))
    if drafted:
        return drafted
    if not answer.effects:
        return ()
    command = _explain_command(request, new, again, with_effects=not user_effect_names(answer))
    explain_again = NextStep("explain again: is anything still missing?", command)
    if answer.bench == "pitch":
        arguments = ["simulate", "pitch", "--model", new, "--out", f"{folder}-simulated"]
        return (explain_again, NextStep("simulate with the new model", _command(arguments)))
    fit = ["fit", *_paths(request.learn), "--model", new, "--out", f"{folder}-fit"]
    rig, is_user_defined = export_rig_reference(request.loaded.model.rig)
    rig_path = str(Path(folder) / rig) if is_user_defined else rig
    sweep = ["sweep", f"sim:{rig_path}?truth={new}", "--z-over-r", "0.6,1,2,4"]
    sweep += ["--pwm", "1500,1600", "--yes", "--out", f"{folder}-sweep"]
    return (
        explain_again,
        NextStep("fit the new model, with uncertainties", _command(fit)),
        NextStep("sweep a virtual bench with the new model", _command(sweep)),
    )


def format_steps(steps: Sequence[NextStep]) -> list[str]:
    """Return steps as shell lines, each command below a comment with its purpose."""
    return [line for step in steps for line in (f"# {step.purpose}", step.command)]


def _experiment_steps(
    answer: Explanation, file: str, new: str, folder: str
) -> tuple[NextStep, ...]:
    """Return the steps of a next experiment: simulate, run, explain."""
    request, run = answer.request, f"{folder}-next"
    model = new if answer.effects else request.model_given
    if answer.bench == "pitch":
        simulate = ["simulate", "pitch", "--model", model, "--schedule", file]
        simulate += ["--out", f"{folder}-try"]
        record = ["record", "ADDRESS", "--schedule", file, "--out", run]
        purpose = "run the experiment (ADDRESS: your bench, whose device runs the schedule)"
        steps = [
            NextStep("try the experiment on a simulated bench", _command(simulate)),
            NextStep(purpose, _command(record)),
        ]
    else:
        sweep = ["sweep", "ADDRESS", "--plan", file, "--out", run]
        steps = [NextStep("run the experiment (ADDRESS: your bench)", _command(sweep))]
    last = _explain_command(request, request.model_given, f"{folder}-again", extra=[run])
    return (*steps, NextStep("explain with the new recording", last))


def _explain_command(
    request: Request,
    model: str,
    out: str,
    extra: Sequence[str] = (),
    *,
    with_effects: bool = True,
) -> str:
    """Return the `explain` command; without `--effects` if the model file names the effects."""
    arguments = ["explain", *_paths(request.learn), *extra, "--model", model]
    arguments += ["--check", *_paths(request.check)]
    if request.rig_given and model == request.model_given:
        arguments += ["--rig", request.rig_given]
    if request.effects_given and with_effects:
        arguments += ["--effects", request.effects_given]
    return _command([*arguments, "--out", out])


def _paths(sources: Sequence[RecordingSource]) -> list[str]:
    return [source.path for source in sources]


def _command(arguments: Sequence[str]) -> str:
    return shlex.join(["benchtool", *arguments])
