"""What the effects of the family of laws have in common."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from benchtool.core.parameter import Parameter
from benchtool.physics.distance_law import DistanceLaw as DistanceLaw
from benchtool.physics.distance_law import term_of as term_of
from benchtool.physics.effects.effect import Effect as Effect
from benchtool.physics.effects.effect import Flow as Flow
from benchtool.physics.effects.effect import Hook, Hooks
from benchtool.physics.effects.effect import Quantity as Quantity
from benchtool.physics.effects.effect import expression as expression
from benchtool.physics.effects.effect import number as number

NEAR_EQ_2 = "a choice: passes near eq. (2) at z/R 0.5 and 1"


@expression
def z_over_R(i: int, flow: Flow) -> Quantity:
    """Return a disc's distance to the surface over the model's R."""
    return flow.height_m[i] / flow.radius_m


@expression
def own_image(i: int, flow: Flow, radius_over_R: Quantity) -> Quantity:
    """Return (R_e/4z)^2, the term of a disc's own image for an effective radius R_e."""
    ratio = 0.25 * radius_over_R / z_over_R(i, flow)
    return ratio * ratio


def law_effect(
    name: str,
    title: str,
    description: str,
    formula: str,
    parameters: tuple[Parameter, ...],
    denominator: Hook,
    source: str,
    distance_law: DistanceLaw,
    **more: Any,
) -> Effect:
    """Return a law of thrust against distance as an effect.

    Args:
        name, title, description, parameters, source: as of every effect.
        formula: T_IGE/T_OGE of one rotor, in plain text.
        denominator: hook that gives 1 - 1/G.
        distance_law: what the law states of itself.
        more: other fields of the effect.
    """
    return Effect(
        name=name,
        title=title,
        description=description,
        subsystem="rpm_to_thrust",
        order=40,
        law=f"T ratio of one rotor {formula}",
        parameters=parameters,
        hooks=Hooks(denominator=denominator),
        shows="thrust against the distance of the plate",
        source=source,
        confused_with={},
        benches=frozenset(),
        distance_law=distance_law,
        **more,
    )


def amplitude(
    name: str, value: float, description: str, source: str, most: float = 10.0
) -> Parameter:
    """Return the number that is 0 where a law is absent."""
    return number(
        name, "1", value, description, neutral=0.0, within=(0.0, most), tolerance=0.01,
        source=source,
    )  # fmt: skip


def decay(value: float, source: str) -> Parameter:
    """Return how fast an exponential law falls off with z/R."""
    return number("Cb", "1", value, "decay Cb per z/R", within=(0.05, 20.0), source=source)


def unverified(item: Parameter) -> Parameter:
    """Return a number left free, because its source was not seen."""
    return replace(item, free=True)
