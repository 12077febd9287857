"""What the owner of a bench knows only roughly: an explanation moves it within its priors."""

from __future__ import annotations

from collections.abc import Sequence

from benchtool.core.parameter import Parameter, Prior
from benchtool.physics.catalogue import EFFECTS, candidates
from benchtool.physics.effects.effect import BenchKind, Effect
from benchtool.physics.model import Model
from benchtool.physics.tolerances import tolerances

RADIUS_KNOWN = 0.0125
"""Standard error of R_m over its value where a model fixes it and states no prior: the increment
(R/4z)^2 known to 5 %, taken for two standard errors."""


def with_every_effect(model: Model, bench: BenchKind, extra: Sequence[Effect] = ()) -> Model:
    """Return the model with every effect that an explanation moves on a bench, at its neutral.

    Args:
        model: as given by the user.
        bench: whose effects count.
        extra: effects of the user's own.
    """
    have = {effect.name for effect in model.effects}
    for effect in moved_effects(bench, extra):
        if effect.name not in have:
            neutral = {p.name: p.neutral for p in effect.parameters if p.neutral is not None}
            model = model.with_effect(effect, **neutral)
    for effect in model.effects:
        shapes = shape_names(model, effect, bench)
        stated = any(model.parameters[name].value != 0.0 for name in shapes)
        if effect.rig_values is None or (effect.name in have and (stated or not shapes)):
            continue
        for name, value in effect.rig_values(model.rig).items():
            model = model.fixed(f"{effect.name}.{name}", value)
    return model


def moved_effects(bench: BenchKind, extra: Sequence[Effect] = ()) -> tuple[Effect, ...]:
    """Return the effects that an explanation may name, then those that it only adjusts."""
    adjusted = [effect for effect in EFFECTS.values() if bench in effect.adjusted_on]
    return (*candidates(bench), *sorted(adjusted, key=lambda effect: effect.name), *extra)


def shape_names(model: Model, effect: Effect, bench: BenchKind) -> list[str]:
    """Return full names of an effect's numbers that nobody knows exactly, held by its priors.

    They shape the law of a candidate, or are all there is of what an explanation only adjusts.
    """
    shown = {} if bench in effect.adjusted_on else tolerances(model, bench)
    full = [f"{effect.name}.{p.name}" for p in effect.parameters if p.prior.kind == "normal"]
    return [name for name in full if name not in shown]


def all_shape_names(model: Model, bench: BenchKind, extra: Sequence[Effect] = ()) -> list[str]:
    """Return those of every effect on a bench: first of what is only adjusted, then by name."""
    effects = sorted(moved_effects(bench, extra), key=lambda one: (one.candidate, one.name))
    return [name for effect in effects for name in shape_names(model, effect, bench)]


RADIUS_FITTED = 0.05
"""Standard error of R_m over its value where a model leaves it to a fit: an effective radius is
within a tenth of the rotor's; a choice."""

K_KNOWN, K_FITTED = 0.01, 0.1
"""The same two for k; a load cell's scale is known to a per cent, a rotor's coefficient is not."""

_SHARES = {"k": (K_KNOWN, K_FITTED), "R_m": (RADIUS_KNOWN, RADIUS_FITTED)}


def known_prior(name: str, item: Parameter) -> Prior | None:
    """Return the normal prior under which a sweep's explanation adjusts a number.

    The stated one, else a share of the value for k and R_m; None for any other without one.
    """
    if item.prior.kind == "normal":
        return item.prior
    if name not in _SHARES:
        return None
    share = _SHARES[name][item.free]
    source = f"assumed by benchtool explain: {100.0 * share:g} % where none is stated"
    return Prior("normal", item.value, share * item.value, source)
