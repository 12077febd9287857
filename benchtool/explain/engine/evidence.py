"""The seam between data and hypotheses: what recordings say about a model's numbers.

Evidence turns knobs into whitened residuals: with the right numbers they are independent, of mean
0 and standard deviation 1, as far as the stated noise is right. Hypotheses know nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchtool.explain.engine.knob import Knob
from benchtool.physics.effects.effect import Subsystem
from benchtool.physics.model import Model

Array = NDArray[np.float64]


LATE, EARLY = "late in the run", "early in the run"
"""Regimes of the clock: they say less of a cause than where the plate was, or how fast it went."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RowGroups:
    """Label the rows of evidence.

    Attributes:
        stages: stage whose disagreement shows in a group of rows, with the mask (n_rows,). A stage
            may be missing: what it does wrong shows in another's rows.
        regimes: parts of the recordings in words, with masks (n_rows,); they may overlap.
    """

    stages: Mapping[Subsystem, NDArray[np.bool_]]
    regimes: Mapping[str, NDArray[np.bool_]]


class Evidence(Protocol):
    """Say how well a model's numbers fit data."""

    @property
    def model(self) -> Model:
        """The model with every candidate in it, neutral unless the user's model says otherwise."""
        ...

    @property
    def knobs(self) -> tuple[Knob, ...]:
        """What can be turned, in a fixed order."""
        ...

    def residuals(self, turned: Array) -> Array:
        """Return whitened residuals (n_rows, n_sets) for sets of knobs (n_sets, n_knobs)."""
        ...

    def groups(self) -> RowGroups:
        """Return labels of the rows."""
        ...
