"""A wall beside the rotors: a guess, because no formula was found."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.effects.laws import law


@law.expression
def denominator(p: Any, i: int, flow: law.Flow) -> law.Quantity:
    """Return 1 - 1/G, G = 1 + Ca exp(-Cb z/R), z from the rotor's axis to the wall."""
    return law.term_of(1.0 + p.Ca * np.exp(-p.Cb * law.z_over_R(i, flow)))


GUESS = "a guess; free"

EFFECT = law.law_effect(
    name="wall",
    title="Wall beside the rotors",
    description=(
        "A wall changes a rotor's thrust little, up or down. The form is a guess, both its numbers "
        "are free. The pull toward the wall and the moment are not in it."
    ),
    formula="1 + Ca exp(-Cb z/R), z from the rotor's axis to the wall",
    parameters=(
        law.unverified(
            law.number(
                "Ca",
                "1",
                0.0,
                "change of the ratio at z = 0, lost thrust below 0",
                neutral=0.0,
                within=(-0.9, 2.0),
                tolerance=0.01,
                source=GUESS,
            )
        ),
        law.unverified(law.decay(1.0, GUESS)),
    ),
    denominator=denominator,
    source=(
        "a guess; that walls act on small multirotors: Experimental evaluation of wall effect for "
        "multi-rotors (unibz, abstract alone seen)"
    ),
    distance_law=law.DistanceLaw(
        basis="not stated",
        tested="nowhere",
        seen="no formula",
        compared=("Ca", "Cb"),
        surface="beside",
    ),
    acts_in_flight=False,
)
