"""Properties of a law of thrust against distance; the reference law is `rotor_images`.

A law is T_IGE/T_OGE of one rotor as a function G of z/R. It enters the sum of eqs. (2) to (4) as
1 - 1/G, which for eq. (2) is (R/4z)^2. Neighbour images, body lift and partial coverage therefore
combine with every law as with eq. (2). A model has one law.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from benchtool.core.choices import Surface
from benchtool.physics import VALIDITY_Z_OVER_R
from benchtool.physics.expression import Quantity, expression

# Quantity that is equal in and out of ground effect for the thrust ratio of a law
Basis = Literal["equal induced power", "equal commanded thrust", "not stated"]

CONTACT_Z_OVER_R = 1e-3  # stands for contact; at 0 the body images of a single rotor are undefined


@dataclass(frozen=True, slots=True, kw_only=True)
class DistanceLaw:
    """Validity and origin of a law."""

    basis: Basis = "not stated"  # quantity that the source takes as equal
    far: str = "1"  # limit of the ratio at large distances, as text
    tested: str  # range of z/R and vehicles in the source, as text
    seen: str  # source that was actually read
    # z/R at which the ratio of one rotor is infinite, from the effect's parameters by name; None
    # for a law that is finite, and therefore valid, down to contact
    singular: Callable[[Mapping[str, float]], float] | None = None
    compared: tuple[str, ...] = ()  # parameters that a comparison of laws frees
    same_as: str = ""  # equivalent law with another parameter, for one rotor; empty for none
    whole_vehicle: bool = False  # whether the parameters include neighbours and body
    # Position of the surface; images of a surface below are ignored for other positions
    surface: Surface = "below"

    @property
    def nearest_z_over_R(self) -> float:
        """Minimum z/R at which the law is valid."""
        return CONTACT_Z_OVER_R if self.singular is None else VALIDITY_Z_OVER_R


@expression
def denominator_term(ratio: Quantity) -> Quantity:
    """Return 1 - 1/G, the term of a law G = T_IGE/T_OGE in the sum of eqs. (2) to (4)."""
    return 1.0 - 1.0 / ratio


def nearest_z_over_R(laws: Iterable[DistanceLaw | None]) -> float:
    """Return the minimum z/R at which all laws are valid; that of eq. (2) without laws."""
    return max((law.nearest_z_over_R for law in laws if law is not None), default=VALIDITY_Z_OVER_R)
