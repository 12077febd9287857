"""What an estimator returns: values with their uncertainty, and how it ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan
from typing import Literal

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.parameter import resolve_name

Status = Literal["converged", "stopped_early", "not_converged"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Say how an estimate ended; a fit that stopped early still has one.

    Attributes:
        status: converged, stopped_early (a result to look at) or not_converged (do not use).
        message: one sentence that says what happened and what to do next.
        evaluations: how often the model was evaluated.
    """

    status: Status
    message: str
    evaluations: int = 0


@dataclass(frozen=True, slots=True)
class Estimate:
    """One fitted parameter: value, standard deviation and intervals in its own unit.

    Attributes:
        sd, interval_68, interval_95: statistical, as the fit alone has them.
        combined_sd, combined_95: with every source of the uncertainty budget; nan without one.
        bound: "at its upper bound", or where a motor constant holds, printed wherever the value is;
            empty inside.
        open: why the data do not determine it, printed in place of the value; empty where they do.
    """

    name: str
    unit: str
    value: float
    sd: float
    interval_68: tuple[float, float]
    interval_95: tuple[float, float]
    bound: str = ""
    open: str = ""
    combined_sd: float = nan
    combined_95: tuple[float, float] = (nan, nan)


@dataclass(frozen=True, slots=True, eq=False)
class FitResult:
    """Carry one fit across packages.

    Attributes:
        method: "least_squares" or "emcee".
        basis: what is held equal when thrust is compared ("equal_rpm2", "equal_pwm",
            "equal_power") or "joint" for thrust fitted in newtons.
        model: name of the model; the model file is stored beside the result.
        estimates: (n_free,) in the order of `covariance`.
        derived: quantities computed from the estimates, with the same fields.
        covariance: (n_free, n_free), units of the estimates.
        chi2, dof: weighted sum of squares at the best point and its degrees of freedom.
        log_likelihood: at the best point.
        warnings: sentences for the user.
        samples: (n_samples, n_free) posterior draws, empty for least squares.
        facts: data hash, seed, versions, counts: text and numbers for result.json.
    """

    method: Literal["least_squares", "emcee"]
    basis: str
    model: str
    estimates: tuple[Estimate, ...]
    covariance: Array
    chi2: float
    dof: int
    log_likelihood: float
    outcome: Outcome
    derived: tuple[Estimate, ...] = ()
    warnings: tuple[str, ...] = ()
    samples: Array = field(default_factory=lambda: np.empty((0, 0)))
    facts: Mapping[str, str | int | float | bool | None] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Estimate:
        known = {estimate.name: estimate for estimate in (*self.estimates, *self.derived)}
        return known[resolve_name(name, known, "fitted parameter")]

    @property
    def values(self) -> Array:
        """Fitted values (n_free,)."""
        return np.array([estimate.value for estimate in self.estimates], float)

    @property
    def chi2_per_dof(self) -> float:
        """Reduced chi-square; nan when no degree of freedom is left."""
        return self.chi2 / self.dof if self.dof > 0 else float("nan")
