"""Runs of one sign in a row of residuals: whether they cling together."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Runs:
    """Count the runs of equal sign against what independent residuals would show.

    Attributes:
        starts, lengths: (r,) index of the first residual of each run, and how many it holds.
        signs: (r,) +1 or -1.
        expected, sd: mean and standard deviation of the number of runs for independent signs
            (Wald and Wolfowitz, Ann. Math. Stat. 11, 1940, p. 147); sd is 0 for one sign only.
    """

    starts: NDArray[np.intp]
    lengths: NDArray[np.intp]
    signs: NDArray[np.intp]
    expected: float
    sd: float

    @property
    def count(self) -> int:
        """How many runs there are."""
        return len(self.starts)

    @property
    def verdict(self) -> str:
        """Say in a few words what the count means, at three standard deviations."""
        if self.sd == 0.0 or abs(self.count - self.expected) <= 3.0 * self.sd:
            return "as independent residuals show"
        if self.count < self.expected:
            return "too few: neighbours cling together"
        return "too many: neighbours alternate"


def runs_of_sign(residuals: Array) -> Runs:
    """Find the runs of equal sign in residuals (m,), in order; exact zeros count as positive."""
    signs = np.where(residuals >= 0.0, 1, -1)
    if not signs.size:
        none = np.empty(0, np.intp)
        return Runs(none, none, none, 0.0, 0.0)
    starts = np.flatnonzero(np.r_[True, signs[1:] != signs[:-1]])
    lengths = np.diff(np.r_[starts, signs.size])
    above, below = int((signs > 0).sum()), int((signs < 0).sum())
    total = above + below
    mixed = 2.0 * above * below
    variance = mixed * (mixed - total) / (total**2 * (total - 1)) if total > 1 else 0.0
    return Runs(starts, lengths, signs[starts], 1.0 + mixed / total, sqrt(max(variance, 0.0)))
