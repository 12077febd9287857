"""What a sweep's readings may be off by: stated errors, and a place that a whole stay shares.

The plate does not stand exactly where it is read (play and quantum of the stage, by the rig's
sheet). What that does to thrust is the same at every level of one stay, so that seven levels at one
place tell hardly more of the place than one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SweepNoise:
    """Hold the covariance of a sweep's thrusts as its root L (m, m), and the inverse of that.

    Attributes:
        root: L, with L L^T the covariance: N.
        whitener: L^-1.
    """

    root: Array
    whitener: Array

    @classmethod
    def of(cls, se_N: Array, stay: NDArray[np.intp], by_place_N: Array) -> SweepNoise:
        """Build the noise.

        Args:
            se_N: (m,) standard error of every thrust.
            stay: (m,) number of its stay.
            by_place_N: (m,) change of thrust by one standard deviation of the place.
        """
        shared = stay[:, None] == stay[None, :]
        covariance = np.where(shared, np.outer(by_place_N, by_place_N), 0.0) + np.diag(se_N**2)
        root = np.linalg.cholesky(covariance)
        return cls(root=root, whitener=np.linalg.inv(root))
