"""Laws of thrust against distance, one function each. A model has one law.

A function returns the law's term in the denominator of eqs. (2) to (4): 1 - 1/G for a thrust ratio
G. Its docstring is the effect's description.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.parameter import Parameter
from benchtool.physics.distance_law import DistanceLaw, denominator_term
from benchtool.physics.effects.effect import (
    Effect,
    Flow,
    Hook,
    Hooks,
    Numbers,
    Quantity,
    as_tuple,
    expression,
    number,
)
from benchtool.physics.effects.rotor_images import EFFECT as ROTOR_IMAGES

LAWS: dict[str, Effect] = {}

NEAR_EQ_2 = "assumed: close to eq. (2) at z/R 0.5 and 1"
FROM_MEMORY = "from memory, unverified: a1 6.924, a2 0.0378 m for R 0.12 m; free"
ASSUMED = "assumed; free"
KNOTS = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0)  # z/R, denser at small distances; assumed


def law_effect(
    hook: Hook, title: str, formula: str, source: str, *parameters: Parameter, free: bool = False,
    **fields: Any,
) -> Effect:  # fmt: skip
    """Return a law of thrust against distance as an effect.

    Args:
        hook: returns 1 - 1/G; name and docstring are the effect's name and description.
        formula: T_IGE/T_OGE of one rotor, in plain text.
        free: whether a fit adjusts the parameters by default, for laws without a verified source.
        fields: of the effect and of its `DistanceLaw`; `compared` defaults to all parameters.
    """
    law_fields: dict[str, Any] = {"compared": tuple(item.name for item in parameters)}
    law_fields |= {name: fields.pop(name) for name in DistanceLaw.__slots__ if name in fields}
    return Effect(
        name=hook.__name__, title=title, description=" ".join((hook.__doc__ or "").split()),
        subsystem="rpm_to_thrust", order=40, law=f"T ratio of one rotor {formula}",
        parameters=tuple(replace(item, free=free) for item in parameters),
        hooks=Hooks(denominator=hook), shows="thrust against plate distance", source=source,
        benches=frozenset(), distance_law=DistanceLaw(**law_fields), **fields,
    )  # fmt: skip


def law(*arguments: Any, **fields: Any) -> Callable[[Hook], Hook]:
    """Register the decorated function as a law, with the arguments of `law_effect`."""

    def register(hook: Hook) -> Hook:
        LAWS[hook.__name__] = law_effect(hook, *arguments, **fields)
        return hook

    return register


def amplitude(
    name: str, value: float, description: str, source: str, upper: float = 10.0
) -> Parameter:
    """Return the amplitude of a law; 0 means no effect."""
    return number(
        name, "1", value, description, neutral=0.0, within=(0.0, upper), tolerance=0.01,
        source=source,
    )  # fmt: skip


def decay(value: float, source: str) -> Parameter:
    """Return the decay rate of an exponential law over z/R."""
    return number("Cb", "1", value, "decay rate Cb over z/R", within=(0.05, 20.0), source=source)


@expression
def z_over_R(i: int, flow: Flow) -> Quantity:
    """Return a disc's distance to the surface over the model's R."""
    return flow.height_m[i] / flow.radius_m


@expression
def own_image(i: int, flow: Flow, radius_over_R: Quantity) -> Quantity:
    """Return (R_e/4z)^2, the term of a disc's own image with effective radius R_e."""
    ratio = 0.25 * radius_over_R / z_over_R(i, flow)
    return ratio * ratio


@law(
    "Cheeseman and Bennett 1955", "1/(1 - (R_e/4z)^2)",
    "Cheeseman and Bennett 1955, ARC R&M 3021; Sanchez-Cuevas et al. 2017, eq. (2)",
    amplitude("R_e_over_R", 1.0, "effective over rotor radius", "1: as published", 3.0),
    basis="equal induced power", tested="z/R 0.5 to 2, helicopters and single rotors",
    seen=(
        "eq. (2) of the paper; Synetic-Labs/SkyFlow-Dynamics spec/ground_effect.py; "
        "TAARG-Education/F2Rotor GroundEffect.py (uses 1/G as the power ratio at equal thrust, "
        "which is G^(-3/2))"
    ),
    singular=lambda p: 0.25 * p["R_e_over_R"], same_as="rotor_images", proper_noun=True,
)  # fmt: skip
def cheeseman_bennett(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Eq. (2) with an effective radius R_e in the rotor's own image; images of neighbours and body
    use R.
    """
    return own_image(i, flow, p.R_e_over_R)


@law(
    "Li 2015", "1/(1 - c (R/4z)^2)",
    "Li (Danjun) et al. 2015, 34th Chinese Control Conference, as in public code",
    amplitude("c", 8.6, "factor c of the rotor's own image", "8.6: Li et al. 2015", 25.0),
    basis="equal commanded thrust", tested="quadrotors; range unknown",
    seen=(
        "Madhaniitm/Maddy---Flight-Controller-alt-and-pos-hold-with-experiments "
        "experiments/exp_A4_ground_effect.py (c = 3.4); 8.6 in a report that cites Kan"
    ),
    singular=lambda p: 0.25 * p["c"] ** 0.5, same_as="rotor_images", whole_vehicle=True,
    proper_noun=True,
)  # fmt: skip
def li(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Commanded over produced thrust of a quadrotor, T_in/T_out = 1 - c (R/4z)^2; c includes
    neighbours and body. c = 8.6 (Li), 3.4 (refit by Kan et al. 2019).
    """
    return p.c * own_image(i, flow, 1.0)


@law(
    "Nobahari 2014", "1/(1 - (R_e/4z)^2), R_e = 2.5 R", "Nobahari et al. 2014, as in public code",
    amplitude("R_e_over_R", 2.5, "effective over rotor radius", "2.5: as published", 5.0),
    tested="a quadrotor; range unknown",
    seen="aurelappius/offboard app_quad_control/src/compensators.cpp",
    singular=lambda p: 0.25 * p["R_e_over_R"], same_as="rotor_images", whole_vehicle=True,
    proper_noun=True,
)  # fmt: skip
def nobahari(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Cheeseman and Bennett with R_e = 2.5 R for a whole quadrotor; do not combine it with effects
    of neighbours and body, which it includes.
    """
    return own_image(i, flow, p.R_e_over_R)


@law(
    "Hayden 1976", "max(1, 0.9926 + 0.03794 (2R/z)^2)^(2/3)", "Hayden 1976, as in public code",
    amplitude("strength", 1.0, "factor on the term 1 - 1/G", "1: as published", 5.0),
    basis="equal induced power",
    far="1: clipped beyond z/R 4.528, where the published curve decreases below 1, to 0.9951",
    compared=(), tested="z/R 0.5 to 4.5, full-size helicopters",
    seen=(
        "aurelappius/offboard app_quad_control/src/compensators.cpp; induced power is from "
        "memory, unverified"
    ),
    singular=lambda p: 0.0, proper_noun=True,
)  # fmt: skip
def hayden(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Curve fit of flight tests of full-size helicopters: power out of over power in ground effect
    at equal thrust, clipped to at least 1 (beyond z/R 4.528). Unverified: the power is induced
    power.
    """
    x = z_over_R(i, flow)
    power = np.maximum(0.9926 + 0.15176 / (x * x), 1.0)
    return p.strength * denominator_term(power ** (2.0 / 3.0))


@law(
    "Exponential law", "1 + Ca exp(-Cb z/R)",
    "public code that names He, Kou, Calaf, Leang 2019 (ASME J. Dyn. Sys. 141, 071013)",
    amplitude("Ca", 1.7, "increment at contact", NEAR_EQ_2), decay(3.2, NEAR_EQ_2),
    tested="multirotors; range unknown",
    seen=(
        "Madhaniitm/Maddy---Flight-Controller-alt-and-pos-hold-with-experiments "
        "experiments/exp_A4_ground_effect.py and two more public simulators"
    ),
)  # fmt: skip
def exponential_law(p: Numbers, i: int, flow: Flow) -> Quantity:
    """The thrust increment decays exponentially with distance and is finite at contact."""
    return denominator_term(1.0 + p.Ca * np.exp(-p.Cb * z_over_R(i, flow)))


@law(
    "Exponential in the denominator", "1/(1 - Ca exp(-Cb z/R)), Ca < 1",
    "from memory, unverified",
    amplitude("Ca", 0.9, "relative loss of inflow at contact", NEAR_EQ_2, 0.999),
    decay(2.6, NEAR_EQ_2), basis="equal induced power", tested="unknown",
    seen="none; bound Ca < 1 (finite at contact): this project", free=True,
)  # fmt: skip
def exponential_denominator(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Inflow decays exponentially towards the plate at equal T v. Both constants are free."""
    return p.Ca * np.exp(-p.Cb * z_over_R(i, flow))


@law(
    "Inflow exponential", "(1 - Ca exp(-Cb z/R))^(-2/3), Ca < 1",
    "Talbot and Corliss 1977, NASA TM-73254, as in public code; T ratio: this project",
    amplitude("Ca", 0.95, "relative loss of inflow at contact", NEAR_EQ_2, 0.999),
    decay(2.1, NEAR_EQ_2), basis="equal induced power", tested="helicopters; range unknown",
    seen="velocity ratio in Synetic-Labs/SkyFlow-Dynamics, not the report",
)  # fmt: skip
def inflow_exponential(p: Numbers, i: int, flow: Flow) -> Quantity:
    """The induced velocity at equal thrust is kappa = 1 - Ca exp(-Cb z/R) of that out of ground
    effect. The thrust ratio kappa^(-2/3) at equal induced power is derived in this project.
    """
    kappa = 1.0 - p.Ca * np.exp(-p.Cb * z_over_R(i, flow))
    return 1.0 - kappa ** (2.0 / 3.0)


@law(
    "Power law", "1 + a (z/R)^-p", "this project; no publication found",
    amplitude("a", 0.0625, "increment at z/R 1", "1/16: eq. (2) to first order"),
    number("p", "1", 2.0, "exponent p", within=(0.25, 8.0), source="2: eq. (2) to first order"),
    tested="nowhere", seen="p = 2 in Synetic-Labs/SkyFlow-Dynamics spec/ground_effect.py",
    singular=lambda p: 0.0,
)  # fmt: skip
def power_law(p: Numbers, i: int, flow: Flow) -> Quantity:
    """The thrust increment is a power of the distance with a free exponent."""
    return denominator_term(1.0 + p.a * np.exp(-p.p * np.log(z_over_R(i, flow))))


@law(
    "Rational law", "1 + g2/((z/R)^2 + g1)",
    "after Yang et al. 2025, arXiv:2506.19424, as in public code",
    amplitude("g2", 0.1, "strength g2, in R^2", NEAR_EQ_2),
    number(
        "g1", "1", 0.05, "squared distance g1 of saturation, in R^2", within=(1e-3, 10.0),
        source=NEAR_EQ_2,
    ),
    tested="z near 0, multirotors",
    seen=(
        "Madhaniitm/Maddy---Flight-Controller-alt-and-pos-hold-with-experiments "
        "experiments/exp_A4_ground_effect.py, with g2/(h^2 + g1)"
    ),
    free=True,
)  # fmt: skip
def rational_law(p: Numbers, i: int, flow: Flow) -> Quantity:
    """The thrust increment is proportional to 1/z^2 at large distances and finite at contact.
    Public code contains only the fraction, as a force; the added 1 is unverified.
    """
    x = z_over_R(i, flow)
    return denominator_term(1.0 + p.g2 / (x * x + p.g1))


@law(
    "Ceiling", "1/(1 - g (R/(z + a2))^2), g = 1/a1, z to the ceiling",
    "Sanchez-Cuevas et al. 2017 on ceilings, from memory, unverified",
    amplitude("g", 0.1444, "strength g = 1/a1", FROM_MEMORY, 5.0),
    number("a2_over_R", "1", 0.315, "length a2 over R", within=(1e-3, 5.0), source=FROM_MEMORY),
    tested="unknown", seen="none", singular=lambda p: max(0.0, p["g"] ** 0.5 - p["a2_over_R"]),
    surface="above", acts_in_flight=False, free=True,
)  # fmt: skip
def ceiling(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Attraction by a surface above: eq. (2) with a strength and a length added to the distance.
    Both constants are free.
    """
    x = z_over_R(i, flow) + p.a2_over_R
    return p.g / (x * x)


@law(
    "Ceiling by momentum theory", "(1 + sqrt(1 + R^2/(8 z^2)))/2, z to the ceiling",
    "momentum theory, as in public code for a Crazyflie",
    amplitude("strength", 1.0, "factor on the term 1 - 1/G", "1: as in the code", 5.0),
    tested="range unknown; 1.37 at z/R 0.25, 1.11 at 0.5",
    seen="XinLong-Li/cf-frimware-2022-12 src/modules/src/lxl_proximity_effects.c",
    singular=lambda p: 0.0, surface="above", acts_in_flight=False,
)  # fmt: skip
def ceiling_momentum(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Attraction by a surface above, where the inflow enters from the side. Terms of neighbours and
    body are ignored.
    """
    x = z_over_R(i, flow)
    return p.strength * denominator_term(0.5 + 0.5 * np.sqrt(1.0 + 0.125 / (x * x)))


@law(
    "Lateral wall", "1 + Ca exp(-Cb z/R), z from the rotor's axis to the wall",
    (
        "formula assumed; existence of the effect: Experimental evaluation of wall effect for "
        "multi-rotors (unibz, abstract)"
    ),
    number(
        "Ca", "1", 0.0, "change of the ratio at z = 0; negative for a loss", neutral=0.0,
        within=(-0.9, 2.0), tolerance=0.01, source=ASSUMED,
    ),
    decay(1.0, ASSUMED), tested="nowhere", seen="no formula", surface="beside",
    acts_in_flight=False, free=True,
)  # fmt: skip
def wall(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Small change of thrust near a wall, of either sign. The formula is assumed and both constants
    are free; force and moment towards the wall are not modelled.
    """
    return denominator_term(1.0 + p.Ca * np.exp(-p.Cb * z_over_R(i, flow)))


def monotone_table(p: tuple[Quantity, ...], i: int, flow: Flow) -> Quantity:
    """Quadratic I-spline with free non-negative steps, for any decreasing law. The ratio is 1
    beyond the last knot and constant within the first.
    """
    x, n, ratio = z_over_R(i, flow), len(p) // 2, 1.0
    for k in range(n):
        ratio = ratio + p[k]
    for k in range(n - 1):
        low, high = p[n + k], p[n + k + 1]
        width, clipped = high - low, np.minimum(np.maximum(x, low), high)
        falling = (width * width - (high - clipped) ** 2) / (high - p[n + max(k - 1, 0)])
        rising = (clipped - low) ** 2 / (p[n + min(k + 2, n - 1)] - low)
        ratio = ratio - (p[k] * falling + p[k + 1] * rising) / width
    return denominator_term(ratio)


def with_knots(knots: Sequence[float]) -> Effect:
    """Return the monotone table with its knots at these increasing z/R."""
    if len(knots) < 2 or knots[0] < 0.0 or any(b - a < 1e-3 for a, b in pairwise(knots)):
        raise InputError(
            f"z_over_R {list(knots)} is invalid; allowed: two or more increasing values from 0, at "
            f"least 0.001 apart"
        )
    steps = [
        amplitude(f"step_{k}", 0.0, f"decrease of the ratio near z/R {x:.3g}", "neutral value", 5.0)
        for k, x in enumerate(knots, 1)
    ]
    knot_parameters = [
        number(f"knot_{k}", "1", x, "z/R of the knot", within=(0.0, 1e3), source="settings")
        for k, x in enumerate(knots, 1)
    ]
    return law_effect(
        monotone_table, "Monotone table", "1 + sum_k c_k (1 - I_k(z/R)), c_k >= 0",
        "Ramsay 1988, Statistical Science 3(4): monotone regression splines", *steps,
        *knot_parameters, far="1 beyond the last knot", tested="range of its data",
        seen="definition of the spline; data: yours", compared=tuple(item.name for item in steps),
        numbers=as_tuple, knots_setting="z_over_R", with_knots=with_knots,
    )  # fmt: skip


LAWS["monotone_table"] = with_knots(KNOTS)

DEFAULT_LAWS = {"below": ROTOR_IMAGES, "above": LAWS["ceiling_momentum"], "beside": LAWS["wall"]}
