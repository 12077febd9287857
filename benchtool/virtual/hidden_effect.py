"""What a virtual bench has and its model not: effects that its address names, to be found."""

from __future__ import annotations

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.physics.catalogue import effect_named
from benchtool.physics.model import Model

EXAMPLE = "coulomb_friction.torque_Nm:0.012"


def with_hidden(model: Model, text: str) -> Model:
    """Return a model with some numbers of effects changed.

    Args:
        model: of the bench.
        text: EFFECT.PARAMETER:VALUE in SI units, several with commas.

    Raises:
        InputError, UnknownChoice: no such effect or parameter, or a value beyond its bounds.
    """
    for each in text.split(","):
        name, _, value = each.partition(":")
        effect, _, parameter = name.partition(".")
        known = [item.name for item in effect_named(effect).parameters]
        if parameter not in known:
            raise UnknownChoice(f"parameter of effect {effect!r}", parameter, known)
        try:
            number = float(value)
        except ValueError:
            raise InputError(
                f"hidden is {each!r}, which ends in no number; write for example hidden={EXAMPLE}"
            ) from None
        if name not in model.parameters:
            model = model.with_effect(effect)
        model = model.fixed(name, number)
    return model
