"""The law of a bench that follows none: a monotone spline through what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from benchtool.core.errors import InputError
from benchtool.physics.effects.effect import all_in_order
from benchtool.physics.effects.laws import law

KNOTS = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0)
"""z/R of the knots where nobody states any: closer where laws bend; a choice."""


@law.expression
def denominator(p: tuple[law.Quantity, ...], i: int, flow: law.Flow) -> law.Quantity:
    """Return 1 - 1/G, G = 1 + sum_k c_k (1 - I_k(z/R)), I_k integrated hats over the knots."""
    x, n, ratio = law.z_over_R(i, flow), len(p) // 2, 1.0
    for k in range(n):
        ratio = ratio + p[k]
    for k in range(n - 1):
        low, high = p[n + k], p[n + k + 1]
        width, within = high - low, np.minimum(np.maximum(x, low), high)
        falls = (width * width - (high - within) ** 2) / (high - p[n + max(k - 1, 0)])
        rises = (within - low) ** 2 / (p[n + min(k + 2, n - 1)] - low)
        ratio = ratio - (p[k] * falls + p[k + 1] * rises) / width
    return law.term_of(ratio)


def with_knots(knots: Sequence[float]) -> law.Effect:
    """Return the law with its knots at these increasing z/R."""
    if len(knots) < 2 or knots[0] < 0.0 or any(b - a < 1e-3 for a, b in pairwise(knots)):
        raise InputError(
            f"a table needs two z/R or more that increase from 0, got {list(knots)}; sort them and "
            f"leave out doubles"
        )
    steps = [
        law.amplitude(
            f"step_{k}", 0.0, f"fall of the ratio around z/R {x:.3g}", "neutral value", 5.0
        )
        for k, x in enumerate(knots, 1)
    ]
    places = [
        law.number(f"knot_{k}", "1", x, "z/R of the knot", within=(0.0, 1e3), source="as stated")
        for k, x in enumerate(knots, 1)
    ]
    return law.law_effect(
        name="monotone_table",
        title="Monotone table",
        description=(
            "A quadratic I-spline with steps of free height, none below 0: whatever falls with the "
            "distance. It is 1 beyond its last knot and level within the first, so that it says "
            "nothing of what lies nearer than the data."
        ),
        formula="1 + sum_k c_k (1 - I_k(z/R)), c_k >= 0",
        parameters=(*steps, *places),
        denominator=denominator,
        source="Ramsay 1988, Statistical Science 3(4): monotone regression splines",
        distance_law=law.DistanceLaw(
            basis="not stated",
            far="1 beyond the last knot",
            tested="where its data lie",
            seen="nothing but the definition of the spline; a table of yours",
            compared=tuple(item.name for item in steps),
        ),
        numbers=all_in_order,
        knots_setting="z_over_R",
        configure=configured,
    )


def configured(settings: Mapping[str, Any]) -> law.Effect:
    """Return the law for the settings of a model file: `z_over_R = [...]`."""
    if unknown := set(settings) - {"z_over_R"}:
        raise InputError(f"monotone_table has no setting {min(unknown)!r}; it has: z_over_R")
    return with_knots([float(value) for value in settings.get("z_over_R", KNOTS)])


EFFECT = with_knots(KNOTS)
