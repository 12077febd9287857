"""How the thrust increment grows with the covered area: free factors instead of a straight line.

The paper takes the increment as linear in the covered area of the disc (after Seo et al. 2010).
Free factors at the measured coverages let data test that. They are monotone by construction:
between one knot and the next the factor takes a share of what is left up to one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import (
    BenchKind,
    Derived,
    Effect,
    Flow,
    Hooks,
    Quantity,
    all_in_order,
    expression,
    number,
)

TOLERANCE = 0.1  # a tenth of the increment does not matter; assumed
MOST_KNOTS = 16  # more area factors than this carry no tolerance of their own


@expression
def coverage(p: tuple[Quantity, ...], i: int, flow: Flow, fraction: Quantity) -> Quantity:
    """Return the effective fraction: piecewise linear through the factors at the knots."""
    n = (len(p) - 1) // 2
    fraction = fraction * p[2 * n]
    reached = 0.0
    effective = 0.0
    start = 0.0
    for k in range(n):
        step = p[k] * (1.0 - reached)
        width = p[n + k] - start
        effective = effective + step * np.minimum(np.maximum((fraction - start) / width, 0.0), 1.0)
        reached = reached + step
        start = p[n + k]
    last = np.minimum(np.maximum((fraction - start) / (1.0 - start), 0.0), 1.0)
    return effective + (1.0 - reached) * last


def factors(shares: Sequence[float]) -> tuple[float, ...]:
    """Return the area factors at the knots that these shares stand for."""
    reached = 0.0
    out = []
    for share in shares:
        reached += share * (1.0 - reached)
        out.append(reached)
    return tuple(out)


PARTIAL_COVERAGE = "partial_coverage"


def factor_table(
    values: Mapping[str, float], sds: Mapping[str, float]
) -> tuple[Array, Array, Array]:
    """Return covered area, factor and its standard deviation at each knot, by rising area (k,).

    Args:
        sds: of the `derived` factors, by full name; nan where one is missing.
    """
    numbers = range(1, 1 + sum(name.startswith(f"{PARTIAL_COVERAGE}.knot_") for name in values))
    knots = np.array([values[f"{PARTIAL_COVERAGE}.knot_{k}"] for k in numbers])
    found = np.array(factors([values[f"{PARTIAL_COVERAGE}.share_{k}"] for k in numbers]))
    sd = np.array([sds.get(f"{PARTIAL_COVERAGE}.factor_{k}", np.nan) for k in numbers])
    order = np.argsort(knots)
    return knots[order], found[order], sd[order]


def derived(names: Sequence[str]) -> tuple[Derived, ...]:
    """Return the area factors that free shares (full names) stand for, one for each knot."""
    shares = [name for name in names if "share_" in name]

    def factor(upto: int) -> Callable[[Mapping[str, Any]], Any]:
        def of(values: Mapping[str, Any]) -> Any:
            left: Any = 1.0
            for name in shares[:upto]:
                left = left * (1.0 - values[name])
            return 1.0 - left

        return of

    return tuple(
        Derived(name.replace("share", "factor"), "1", factor(k)) for k, name in enumerate(shares, 1)
    )


def with_knots(coverages: Sequence[float]) -> Effect:
    """Return the effect with its factors at these coverages, increasing between 0 and 1."""
    edges = [0.0, *coverages, 1.0]
    if len(edges) < 3 or any(b - a < 1e-3 for a, b in pairwise(edges)):
        raise InputError(
            f"area factors need coverages that increase between 0 and 1, got {list(coverages)}; "
            f"leave out 0 and 1 and sort the others"
        )
    shares = tuple(
        number(
            f"share_{k}", "1", (b - a) / (1.0 - a),
            f"share of the remaining increment taken up to {b:.3g} of the disc",
            neutral=(b - a) / (1.0 - a), within=(0.0, 1.0),
            source="neutral value: the straight line (paper, section 3.1)",
        )
        for k, (a, b) in enumerate(pairwise(edges[:-1]), start=1)
    )  # fmt: skip
    knots = tuple(
        number(
            f"knot_{k}", "1", b, "covered fraction at the knot", within=(0.0, 1.0),
            source="coverage as measured",
        )
        for k, b in enumerate(coverages, start=1)
    )  # fmt: skip
    reached = number(
        "share", "1", 1.0, "how much of the stated coverage there is", neutral=1.0,
        within=(0.0, 1.0),
    )  # fmt: skip
    return Effect(
        name=PARTIAL_COVERAGE,
        headline="factor_",
        title="Partial-area factors",
        description="The increment of a partly covered disc departs from a straight line in area.",
        subsystem="rpm_to_thrust",
        order=50,
        law=(
            "f = 1 + g(a) (F - 1), g piecewise linear through the factors, g(0) = 0, g(1) = 1, "
            "a = share * stated"
        ),
        numbers=all_in_order,
        parameters=(*shares, *knots, reached),
        hooks=Hooks(coverage=coverage),
        shows="lateral plate positions at a near distance",
        source="linearity: paper section 3.1 after Seo et al. 2010; the free factors are ours",
        confused_with={"body_lift": "a full cover at the same distance separates them"},
        derived=derived,
        tolerance_of=tolerance_of,
        knots_setting="coverages",
        configure=configured,
    )


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return a tenth of the increment: of each factor on a sweep, of the whole on a hinge.

    On a hinge the plate is all the way in or parked, so that factors between do not show.
    """
    if bench == "pitch":
        return {"share": TOLERANCE}
    return {f"share_{k}": TOLERANCE for k in range(1, MOST_KNOTS + 1)}


def configured(settings: Mapping[str, Any]) -> Effect:
    """Return the effect for the settings of a model file: `coverages = [...]`."""
    unknown = set(settings) - {"coverages"}
    if unknown:
        raise InputError(
            f"partial_coverage has no setting {sorted(unknown)[0]!r}; it has: coverages"
        )
    given = settings.get("coverages", (0.25, 0.5, 0.75))
    try:
        return with_knots([float(value) for value in given])
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"coverages is {given!r:.80}; give a list of numbers between 0 and 1"
        ) from error


EFFECT = with_knots((0.25, 0.5, 0.75))
