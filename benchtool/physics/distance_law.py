"""What a law of thrust against distance states of itself: the family that `rotor_images` heads.

A law gives T_IGE/T_OGE of one rotor as a function G of z/R. It enters the sum of eqs. (2) to (4) as
1 - 1/G, which for eq. (2) is (R/4z)^2, so that neighbours' images, body lift and partial coverage
combine with every law as they do with eq. (2). A model has one law: it is applied once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from benchtool.core.rig import Surface
from benchtool.physics import VALIDITY_Z_OVER_R
from benchtool.physics.expression import Quantity, expression

Basis = Literal["equal induced power", "equal commanded thrust", "not stated"]
"""What is held equal between the two thrusts of a law's ratio."""

CONTACT_Z_OVER_R = 1e-3  # contact: at 0 eq. (4) has no body images under a single rotor


@dataclass(frozen=True, slots=True, kw_only=True)
class DistanceLaw:
    """State what a law holds for, and what is known of its origin.

    Attributes:
        basis: what its source holds equal.
        far: what the ratio tends to far away, in words.
        tested: range of z/R and of vehicles for which its source gives it, in words.
        seen: what of its source was seen.
        singular: z/R at which one rotor's ratio is infinite, from the effect's own numbers by
            name; None where it is finite down to contact, which makes it valid there.
        compared: its own numbers that a comparison of laws frees.
        same_as: the law that it is by another parameter, for one rotor; empty for none.
        surface: where the surface lies whose distance it is of; terms of the sum that are images
            in a surface below do not act beside a law of another.
        whole_vehicle: whether neighbours and body are in its numbers.
    """

    basis: Basis = "not stated"
    far: str = "1"
    tested: str
    seen: str
    singular: Callable[[Mapping[str, float]], float] | None = None
    compared: tuple[str, ...] = ()
    same_as: str = ""
    whole_vehicle: bool = False
    surface: Surface = "below"

    @property
    def nearest_z_over_R(self) -> float:
        """Least z/R at which the law is trusted."""
        return CONTACT_Z_OVER_R if self.singular is None else VALIDITY_Z_OVER_R


@expression
def denominator_term(ratio: Quantity) -> Quantity:
    """Return 1 - 1/G, by which a law G of T_IGE/T_OGE enters the sum of eqs. (2) to (4)."""
    return 1.0 - 1.0 / ratio


def nearest_z_over_R(laws: Iterable[DistanceLaw | None]) -> float:
    """Return the least z/R at which all of these laws are trusted; that of eq. (2) without any."""
    return max((law.nearest_z_over_R for law in laws if law is not None), default=VALIDITY_Z_OVER_R)
