"""Updated model with the named effects, as a file with provenance."""

from __future__ import annotations

from dataclasses import replace
from math import isclose
from typing import Any

from benchtool import __version__
from benchtool.explain.engine.parameters import known_prior
from benchtool.explain.findings import NamedEffect
from benchtool.explain.result import Explanation
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.model import Model
from benchtool.physics.model_file import LoadedModel, model_to_toml

MODEL = "model.toml"  # file of the new model in the folder of an answer
NEAREST = "model_nearest.toml"  # model with the effect nearest to an unnamed one
ZERO_TOLERANCE = 1e-15  # largest rounding error of a zero after optimisation, in any unit; assumed


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
    new = LoadedModel(
        model=model,
        columns=loaded.columns,
        row_filter=loaded.row_filter,
        imperfections=loaded.imperfections,
        effects_file=effects_file or loaded.effects_file,
        plate_slide_s=loaded.plate_slide_s,
    )
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
            neutral = parameter.neutral
            if neutral is not None and isclose(parameter.value, neutral, abs_tol=ZERO_TOLERANCE):
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
