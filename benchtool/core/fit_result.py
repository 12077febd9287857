"""Result of a fit: estimates with uncertainty, and its outcome."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite, nan

import numpy as np

from benchtool.core.choices import Method, Status
from benchtool.core.errors import InputError
from benchtool.core.parameter import resolve_name
from benchtool.core.units import Array

MAX_DOF = 1e6  # Student's t distribution with more degrees of freedom is normal


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a fit.

    Attributes:
        status: converged, stopped_early (check before use) or not_converged (do not use).
        message: one sentence with result and remedy.
        evaluations: number of model evaluations.
    """

    status: Status
    message: str
    evaluations: int = 0


@dataclass(frozen=True, slots=True, repr=False)
class Estimate:
    """Fitted parameter: value, standard deviation and intervals, in its unit.

    Attributes:
        sd, interval_68, interval_95: statistical part only.
        combined_sd, combined_95: with all sources of the uncertainty budget; nan without budget.
        bound: "at its upper bound", or validity range of a motor constant, printed with the value;
            else empty.
        open: reason why the data do not determine it, printed in place of the value; else empty.
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

    def __repr__(self) -> str:
        low, high = self.interval()
        text = f"{self.value:.5g} ± {self.se:.2g} {self.unit}".removesuffix(" 1")
        return f"{self.name} = {text}, 95 % interval {low:.5g} … {high:.5g}"

    @property
    def se(self) -> float:
        """Standard uncertainty: combined, or statistical without a budget."""
        return self.combined_sd if isfinite(self.combined_sd) else self.sd

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Return the ends of the interval of a probability: combined, or statistical as `se`.

        Other levels than 0.95 scale both sides of the 95 % interval, by Student's t distribution
        of its coverage factor.
        """
        from scipy.special import stdtridf, stdtrit

        if not 0.0 < level < 1.0:
            raise InputError(f"level is {level:g}; give a probability above 0 and below 1")
        low, high = self.combined_95 if isfinite(self.combined_sd) else self.interval_95
        if level == 0.95 or not isfinite(high - low):
            return low, high
        normal, most = (float(stdtrit(dof, 0.975)) for dof in (MAX_DOF, 1.0))
        factor = 0.5 * (high - low) / self.se if self.se > 0.0 else normal
        dof = float(stdtridf(0.975, min(factor, most))) if factor > normal else MAX_DOF
        share = float(stdtrit(dof, 0.5 + 0.5 * level) / stdtrit(dof, 0.975))
        return self.value + share * (low - self.value), self.value + share * (high - self.value)


@dataclass(frozen=True, slots=True, eq=False)
class FitResult:
    """Result of one fit.

    Attributes:
        method: "least_squares" or "emcee".
        basis: quantity held equal when thrust is compared ("equal_rpm2", "equal_pwm",
            "equal_power") or "joint" for thrust fitted in newtons.
        model: name of the model; its file is stored with the result.
        estimates: (n_free,) in the order of `covariance`.
        derived: quantities computed from the estimates, with the same fields.
        covariance: (n_free, n_free), units of the estimates.
        chi2, dof: weighted sum of squares at the best point and its degrees of freedom.
        log_likelihood: at the best point.
        warnings: sentences for the user.
        samples: (n_samples, n_free) posterior draws, empty for least squares.
        facts: data hash, seed, versions, counts: texts and numbers for result.json.
    """

    method: Method
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
        by_name = {estimate.name: estimate for estimate in (*self.estimates, *self.derived)}
        return by_name[resolve_name(name, by_name, "fitted parameter")]

    @property
    def values(self) -> Array:
        """Fitted values (n_free,)."""
        return np.array([estimate.value for estimate in self.estimates], float)

    @property
    def chi2_per_dof(self) -> float:
        """Reduced chi-square; nan without degrees of freedom."""
        return self.chi2 / self.dof if self.dof > 0 else float("nan")
