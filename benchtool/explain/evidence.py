"""The seam between data and hypotheses: what recordings say about a model's numbers.

Evidence turns knobs into whitened residuals: with the right numbers they are independent, of mean
0 and standard deviation 1, as far as the stated noise is right. Hypotheses know nothing else.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchtool.explain.knob import Knob

Array = NDArray[np.float64]


class Evidence(Protocol):
    """Say how well a model's numbers fit data."""

    @property
    def knobs(self) -> tuple[Knob, ...]:
        """What can be turned, in a fixed order."""
        ...

    def residuals(self, turned: Array) -> Array:
        """Return whitened residuals (n_rows, n_sets) for sets of knobs (n_sets, n_knobs)."""
        ...
