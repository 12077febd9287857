"""Thrust increment against covered area: free factors in place of a straight line.

The paper assumes an increment linear in the covered area of the disc (after Seo et al. 2010).
Free factors at the measured coverages test that. They are monotone by construction: each knot
adds a share of the remaining increment.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.physics.effects.effect import (
    BenchKind,
    Derived,
    Effect,
    Flow,
    Hooks,
    Quantity,
    as_tuple,
    number,
)

TOLERANCE = 0.1  # of the increment; assumed
MAX_KNOTS = 16  # factors beyond this number have no default tolerance


def coverage(p: tuple[Quantity, ...], i: int, flow: Flow, fraction: Quantity) -> Quantity:
    """Return the effective fraction: piecewise linear through the factors at the knots."""
    n = (len(p) - 1) // 2
    fraction = fraction * p[2 * n]
    factor = 0.0  # at the knot `start`
    effective = 0.0
    start = 0.0
    for k in range(n):
        step = p[k] * (1.0 - factor)
        width = p[n + k] - start
        effective = effective + step * np.minimum(np.maximum((fraction - start) / width, 0.0), 1.0)
        factor = factor + step
        start = p[n + k]
    last = np.minimum(np.maximum((fraction - start) / (1.0 - start), 0.0), 1.0)
    return effective + (1.0 - factor) * last


def factors(shares: Sequence[float]) -> tuple[float, ...]:
    """Return the area factors at the knots, from shares of the remaining increment."""
    factor = 0.0
    values = []
    for share in shares:
        factor += share * (1.0 - factor)
        values.append(factor)
    return tuple(values)


PARTIAL_COVERAGE = "partial_coverage"


def factor_table(
    values: Mapping[str, float], sds: Mapping[str, float]
) -> tuple[Array, Array, Array]:
    """Return covered area, factor and its standard deviation at each knot, by rising area (k,).

    Args:
        sds: standard deviations of the `derived` factors by full name; missing ones become nan.
    """
    numbers = range(1, 1 + sum(name.startswith(f"{PARTIAL_COVERAGE}.knot_") for name in values))
    knots = np.array([values[f"{PARTIAL_COVERAGE}.knot_{k}"] for k in numbers])
    area_factors = np.array(factors([values[f"{PARTIAL_COVERAGE}.share_{k}"] for k in numbers]))
    sd = np.array([sds.get(f"{PARTIAL_COVERAGE}.factor_{k}", np.nan) for k in numbers])
    order = np.argsort(knots)
    return knots[order], area_factors[order], sd[order]


def derived(names: Sequence[str]) -> tuple[Derived, ...]:
    """Return the area factor at each knot as a function of the free shares (full names)."""
    shares = [name for name in names if "share_" in name]

    def factor(n_shares: int) -> Callable[[Mapping[str, Any]], Any]:
        def evaluate(values: Mapping[str, Any]) -> Any:
            remaining: Any = 1.0
            for name in shares[:n_shares]:
                remaining = remaining * (1.0 - values[name])
            return 1.0 - remaining

        return evaluate

    return tuple(
        Derived(name.replace("share", "factor"), "1", factor(k)) for k, name in enumerate(shares, 1)
    )


def with_knots(coverages: Sequence[float]) -> Effect:
    """Return the effect with its factors at these coverages, increasing between 0 and 1."""
    edges = [0.0, *coverages, 1.0]
    if len(edges) < 3 or any(b - a < 1e-3 for a, b in pairwise(edges)):
        raise InputError(
            f"coverages {list(coverages)} do not increase between 0 and 1 (both excluded); remove "
            f"0 and 1 and sort the others"
        )
    shares = tuple(
        number(
            f"share_{k}", "1", (b - a) / (1.0 - a),
            f"share of the remaining increment at coverage {b:.3g}",
            neutral=(b - a) / (1.0 - a), within=(0.0, 1.0),
            source="neutral value: the straight line (paper, section 3.1)",
        )
        for k, (a, b) in enumerate(pairwise(edges[:-1]), start=1)
    )  # fmt: skip
    knots = tuple(
        number(
            f"knot_{k}", "1", b, "coverage at the knot", within=(0.0, 1.0),
            source="measured coverage",
        )
        for k, b in enumerate(coverages, start=1)
    )  # fmt: skip
    scale = number(
        "share", "1", 1.0, "true over nominal coverage", neutral=1.0, within=(0.0, 1.0)
    )  # fmt: skip
    return Effect(
        name=PARTIAL_COVERAGE,
        headline="factor_",
        title="Partial-area factors",
        description="The increment of a partly covered disc is not linear in the covered area.",
        subsystem="rpm_to_thrust",
        order=50,
        law=(
            "f = 1 + g(a) (F - 1), g piecewise linear through the factors, g(0) = 0, g(1) = 1, "
            "a = share * nominal"
        ),
        numbers=as_tuple,
        parameters=(*shares, *knots, scale),
        hooks=Hooks(coverage=coverage),
        shows="lateral plate positions at a small distance",
        source="linearity: paper section 3.1 after Seo et al. 2010; free factors: this project",
        confused_with={"body_lift": "full coverage at the same distance separates them"},
        derived=derived,
        tolerance_of=default_tolerances,
        knots_setting="coverages",
        with_knots=with_knots,
    )


def default_tolerances(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the tolerances: of each share on a sweep, of the whole coverage on a hinge.

    On a hinge the plate is fully inserted or parked, so intermediate factors have no effect.
    """
    if bench == "pitch":
        return {"share": TOLERANCE}
    return {f"share_{k}": TOLERANCE for k in range(1, MAX_KNOTS + 1)}


EFFECT = with_knots((0.25, 0.5, 0.75))
