"""Updated model with the named effects, as a file with provenance."""

from __future__ import annotations

from dataclasses import replace
from math import isclose
from typing import Any

from benchtool import __version__
from benchtool.explain.answer import ExplainResult
from benchtool.explain.engine.parameters import known_prior
from benchtool.explain.engine.verdict import NamedEffect
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model
from benchtool.physics.model_file import LoadedModel, model_to_toml

MODEL = "model.toml"  # name of the new model's file in the folder of an answer
NEAREST = "model_nearest.toml"  # model with the effect nearest to something unknown
NOTHING = 1e-15  # what an optimiser leaves of a zero, in any unit; assumed


def added_model(answer: ExplainResult, rig: str = "", effects_file: str = "") -> str:
    """Return a model file's text: the parent's with the named effects at their values.

    Other effects stay as the parent states them: what lies within tolerance does not matter. Of a
    class the likeliest member is added.

    Args:
        rig: how the new file names the rig; as the parent did when empty.
        effects_file: file of user-defined effects, in the same folder.
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
    new = LoadedModel(
        model=model,
        columns=loaded.columns,
        row_filter=loaded.row_filter,
        imperfections=loaded.imperfections,
        effects_file=effects_file or loaded.effects_file,
        plate_slide_s=loaded.plate_slide_s,
    )
    return model_to_toml(new, rig or loaded.rig_name or None)


def with_nearest_effect(answer: ExplainResult) -> ExplainResult | None:
    """Return the answer as if the nearest effect of something unknown were the one; None without.

    Its model is the best that the library has, for a simulation meanwhile.
    """
    verdict, near = answer.verdict, answer.verdict.nearest
    if near is None or near.effect is None:
        return None
    only = replace(verdict, kind="effect", effects=(near.effect,), parameters=near.parameters)
    return replace(answer, explanation=replace(answer.explanation, verdict=only))


def model_with_effects(answer: ExplainResult) -> Model:
    """Return the model with the effects that are added, each number where the recordings put it.

    What moved without being a candidate's is what its owner knows only roughly: inertia, radius,
    the map from pulse to speed. Of a sweep it stays free under what was known of it: held where it
    came to lie, a fit of what was found would state errors many times too small.
    """
    model = answer.request.loaded.model
    candidates = {name.partition(".")[0] for name in answer.verdict.tolerances}
    for name, parameter in answer.verdict.parameters.items():
        owner, dot, _ = name.partition(".")
        if owner in candidates:
            continue
        if dot and name not in model.parameters:
            if parameter.neutral is not None and isclose(
                parameter.value, parameter.neutral, abs_tol=NOTHING
            ):
                continue
            model = model.with_effect(_effect(answer, owner))
        source = (
            f"benchtool explain, within what was known of it; "
            f"{model.parameters[name].value:.6g} before"
        )
        model = _moved(answer, model, name, source)
    for effect in added_effects(answer):
        model = _with(answer, model, effect)
    return model


def own_names(answer: ExplainResult) -> tuple[str, ...]:
    """Return the names of added effects that benchtool does not ship."""
    return tuple(effect.name for effect in added_effects(answer) if effect.name not in EFFECTS)


def added_effects(answer: ExplainResult) -> tuple[NamedEffect, ...]:
    """Return the effects that the new model gets: of a class the likeliest member."""
    effects = answer.verdict.effects
    return effects[:1] if answer.verdict.kind == "class" else effects


def _effect(answer: ExplainResult, name: str) -> Effect:
    user_effects = {effect.name: effect for effect in answer.request.own}
    return user_effects.get(name) or EFFECTS[name]


def _with(answer: ExplainResult, model: Model, effect: NamedEffect) -> Model:
    definition = _effect(answer, effect.name)
    if all(present.name != effect.name for present in model.effects):
        model = model.with_effect(definition)
    source = f"benchtool explain of {', '.join(source.name for source in answer.request.learn)}"
    for shape in definition.parameters:  # what shapes its law comes along
        name = f"{effect.name}.{shape.name}"
        if name in answer.verdict.parameters:
            model = _moved(answer, model, name, source)
    for item in effect.parameters:
        model = _changed(
            model,
            f"{effect.name}.{item.name}",
            value=item.value,
            tolerance=item.tolerance,
            # A sweep can be fitted again from here; a pitch recording is explained again.
            free=answer.verdict.bench == "sweep",
            source=f"{source}: {item.text}",
        )
    return model


def _moved(answer: ExplainResult, model: Model, name: str, source: str) -> Model:
    """Return the model with a number where the recordings put it, where that is elsewhere.

    Of a sweep it is left free for the next fit under what was known of it before; a pitch
    recording is explained again, not fitted. What a fit may move already stays as it is.
    """
    before, value = model.parameters[name], answer.verdict.parameters[name].value
    if value == before.value:
        return model
    prior = known_prior(name, before)
    if answer.verdict.bench != "sweep" or before.free or prior is None:
        return _changed(model, name, value=value, source=source)
    return _changed(model, name, value=value, source=source, free=True, prior=prior)


def _changed(model: Model, name: str, **changes: Any) -> Model:
    parameter = replace(model.parameters[name], **changes)
    return model.with_values(model.parameters.with_replaced(name, parameter))


def _provenance(answer: ExplainResult, named: tuple[NamedEffect, ...]) -> dict[str, str]:
    verdict = answer.verdict
    facts = {f"parent.{key}": text for key, text in answer.request.loaded.model.provenance.items()}
    facts |= {
        "made_by": f"benchtool {__version__}, benchtool explain, seed {answer.seed}",
        "parent": f"{answer.request.loaded.model.name} ({answer.request.model_file})",
        "parent_sha256": answer.request.model_sha256,
        "verdict": verdict.sentence
        if verdict.nearest is None
        else f"unknown; {verdict.nearest.phrase} is only the nearest, and closes "
        f"{100.0 * verdict.nearest.share_closed:.0f} % of the gap",
    }
    for effect in named:
        facts[f"evidence.{effect.name}"] = (
            f"log-likelihood ratio {effect.log_likelihood_ratio:.4g}, p-value "
            f"{effect.p_value:.2g}, probability {effect.probability:.4g}"
        )
    facts |= {f"sha256.{name}": digest for name, digest in answer.hashes.items()}
    return {key: text for key, text in facts.items() if text}
