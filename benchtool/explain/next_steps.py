"""Next steps after an explanation: model with the named effects, next experiment, commands."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isclose
from pathlib import Path
from typing import Any

from benchtool import __version__
from benchtool.core.rig_file import export_rig_reference
from benchtool.core.schedule import schedule_to_toml
from benchtool.explain.engine.evidence import known_prior
from benchtool.explain.findings import NamedEffect
from benchtool.explain.laws import DRAFT_NAME
from benchtool.explain.request import RecordingSource, Request
from benchtool.explain.result import Explanation
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.effects.effect import BenchKind
from benchtool.physics.model import Model
from benchtool.physics.model_file import model_to_toml

MODEL = "model.toml"  # file of the new model in the folder of an answer
NEAREST = "model_nearest.toml"  # model with the effect nearest to an unnamed one
ZERO_TOLERANCE = 1e-15  # largest rounding error of a zero after optimisation, in any unit; assumed
NEGLIGIBLE = 0.1  # of a tolerance or prior sd: a smaller estimate adds no effect; assumed

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
        command = _explain_command(request, request.inputs.model, out="found")
        return (NextStep(f"write {' and '.join(files)}", command),)
    new = str(Path(folder) / MODEL)
    dependence = answer.depends
    drafted: tuple[NextStep, ...] = ()
    if dependence is not None and dependence.law is not None:
        file = str(Path(folder) / f"{DRAFT_NAME}.py")
        purpose = f"check {file}, name it after its cause, and explain again with it"
        with_draft = replace(request, inputs=replace(request.inputs, effects=file))
        drafted = (NextStep(purpose, _explain_command(with_draft, request.inputs.model, again)),)
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
    model = new if answer.effects else request.inputs.model
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
    last = _explain_command(request, request.inputs.model, f"{folder}-again", extra=[run])
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
    if request.inputs.rig and model == request.inputs.model:
        arguments += ["--rig", request.inputs.rig]
    if request.inputs.effects and with_effects:
        arguments += ["--effects", request.inputs.effects]
    return _command([*arguments, "--out", out])


def _paths(sources: Sequence[RecordingSource]) -> list[str]:
    return [source.path for source in sources]


def _command(arguments: Sequence[str]) -> str:
    return shlex.join(["benchtool", *arguments])


def format_added_model(answer: Explanation, rig: str = "", effects_file: str = "") -> str:
    """Return the text of the new model's file: the parent with the named effects.

    Other effects keep the parent's values. Of a class the most probable member is added. An empty
    `rig` or `effects_file` stands for that of the parent.
    """
    loaded = answer.request.loaded
    named = added_effects(answer)
    names = ", ".join(effect.name for effect in named)
    model = replace(
        model_with_effects(answer),
        name="_".join((loaded.model.name, *(effect.name for effect in named))),
        description=f"{loaded.model.description} With {names}, found by benchtool explain.".strip(),
        provenance=_provenance(answer, named),
    )
    new = replace(loaded, model=model, effects_file=effects_file or loaded.effects_file)
    return model_to_toml(new, rig or loaded.rig_name or None)


def with_nearest_effect(answer: Explanation) -> Explanation | None:
    """Return the answer with the nearest effect as the named one; None without a nearest effect.

    Its model is the best approximation with effects of the library, for simulations.
    """
    nearest = answer.nearest
    if nearest is None:
        return None
    return replace(answer, kind="effect", effects=(nearest.effect,), parameters=nearest.parameters)


def model_with_effects(answer: Explanation) -> Model:
    """Return the model with the added effects and the estimated parameters.

    Roughly known parameters (inertia, radius, map from pulse width to speed) are adjusted, too. For
    a sweep they stay free with their priors: fixed, they would make the standard errors of a later
    fit many times too small.
    """
    model = answer.request.loaded.model
    candidates = {name.partition(".")[0] for name in answer.tolerances}
    for name, parameter in answer.parameters.items():
        owner, dot, _ = name.partition(".")
        if owner in candidates:
            continue
        if dot and name not in model.parameters:
            prior, neutral = parameter.prior, parameter.neutral
            matters = parameter.tolerance or (prior.sd if prior.kind == "normal" else 0.0)
            # For a sweep even nothing adds its uncertainty to the next fit.
            share = NEGLIGIBLE if answer.bench == "pitch" else 0.0
            nothing = max(ZERO_TOLERANCE, share * matters)
            if neutral is not None and isclose(parameter.value, neutral, abs_tol=nothing):
                continue
            model = model.with_effect(answer.request.effects[owner])
        value = model.parameters[name].value
        source = f"benchtool explain, within its prior; {value:.6g} before"
        model = _with_estimate(answer, model, name, source)
    for effect in added_effects(answer):
        model = _with_effect(answer, model, effect)
    return model


def user_effect_names(answer: Explanation) -> tuple[str, ...]:
    """Return the names of added effects that are user-defined."""
    return tuple(effect.name for effect in added_effects(answer) if effect.name not in EFFECTS)


def added_effects(answer: Explanation) -> tuple[NamedEffect, ...]:
    """Return the effects of the new model; of a class the most probable member."""
    effects = answer.effects
    return effects[:1] if answer.kind == "class" else effects


def _with_effect(answer: Explanation, model: Model, effect: NamedEffect) -> Model:
    definition = answer.request.effects[effect.name]
    if all(present.name != effect.name for present in model.effects):
        model = model.with_effect(definition)
    source = f"benchtool explain of {', '.join(source.name for source in answer.request.learn)}"
    for parameter in definition.parameters:  # includes those of the law's shape
        name = f"{effect.name}.{parameter.name}"
        if name in answer.parameters:
            model = _with_estimate(answer, model, name, source)
    for estimate in effect.parameters:
        model = _with_changes(
            model,
            f"{effect.name}.{estimate.name}",
            value=estimate.value,
            tolerance=estimate.tolerance,
            # A sweep can be fitted again; a pitch recording is explained again.
            free=answer.bench == "sweep",
            source=f"{source}: {estimate.text}",
        )
    return model


def _with_estimate(answer: Explanation, model: Model, name: str, source: str) -> Model:
    """Return the model with an estimated parameter; unchanged if the estimate equals its value.

    For a sweep a fixed parameter becomes free with its prior, for the next fit.
    """
    before, value = model.parameters[name], answer.parameters[name].value
    if value == before.value:
        return model
    prior = known_prior(name, before)
    if answer.bench != "sweep" or before.free or prior is None:
        return _with_changes(model, name, value=value, source=source)
    return _with_changes(model, name, value=value, source=source, free=True, prior=prior)


def _with_changes(model: Model, name: str, **changes: Any) -> Model:
    parameter = replace(model.parameters[name], **changes)
    return model.with_values(model.parameters.with_replaced(name, parameter))


def _provenance(answer: Explanation, named: tuple[NamedEffect, ...]) -> dict[str, str]:
    nearest, sentence = answer.nearest, answer.sentence
    if nearest is not None:
        share = f"{100.0 * nearest.share_closed:.0f} % of the gap"
        sentence = f"unknown; {nearest.effect.phrase} is only the nearest, and closes {share}"
    facts = {f"parent.{key}": text for key, text in answer.request.loaded.model.provenance.items()}
    facts |= {
        "made_by": f"benchtool {__version__}, benchtool explain, seed {answer.seed}",
        "parent": f"{answer.request.loaded.model.name} ({answer.request.model_file})",
        "parent_sha256": answer.request.model_sha256,
        "verdict": sentence,
    }
    for effect in named:
        facts[f"evidence.{effect.name}"] = (
            f"log-likelihood ratio {effect.log_likelihood_ratio:.4g}, p-value "
            f"{effect.p_value:.2g}, probability {effect.probability:.4g}"
        )
    facts |= {f"sha256.{name}": digest for name, digest in answer.request.hashes.items()}
    return {key: text for key, text in facts.items() if text}
