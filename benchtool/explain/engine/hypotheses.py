"""Hypotheses about missing effects. The null is composite: every effect within its tolerance.

Roughly known parameters may deviate by `KNOWN_PARAMETER_BOUND` standard errors. An effect is named
only if it must exceed its tolerance. A point null (all effects exactly zero) would be rejected on
every record, because every real bench has small imperfections.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.special import chdtrc

from benchtool.core.units import Array
from benchtool.explain.engine.bounded_least_squares import (
    AMPLITUDES,
    PRIOR_WIDTH_FACTOR,
    BoundedRegion,
    Linearisation,
    SharedErrors,
    evidence_against,
    finite_differences,
    solve_covariance,
)
from benchtool.explain.engine.evidence import Evidence
from benchtool.explain.inputs import ExplainInputs
from benchtool.tasks import run_tasks

NO_AMPLITUDES: Mapping[str, float] = MappingProxyType({})

SMALL = 1.0 / 3.0  # prior sd of an effect within tolerance, in tolerances; assumed
KNOWN_PARAMETER_BOUND = 2.0  # in standard errors of a roughly known parameter
MAX_DETECTION_LIMIT = 2.0  # in tolerances; an effect with a larger limit is unjudged
SCREENING_STEPS = 1  # Gauss-Newton steps in the screening fit of a candidate
MAX_REFINED = 4  # best candidates that are fitted further after screening
MAX_COST_GAP = 60.0  # above the best cost; a search that cannot come closer stops
MIN_PREDICTED_DECREASE = 2.0  # of the cost; candidates with a smaller one are not fitted
RIDGE = 1e-9  # added to curvatures before inversion
OTHER_LAW_SIZE = 10.0  # in tolerances of a law: as large as the effect at 10 %; assumed
DRAWS_PER_TASK = 250  # bootstrap draws; takes just under 1 s
MIN_PARALLEL_DRAWS = 2000  # draws; worker processes take 2 s to start


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Hypothesis:
    """Effects and discrepancies that may exceed their tolerances, with their best fit."""

    active: tuple[str, ...]
    values: Array  # (n_parameters,) best fit, in scales
    linearisation_point: Array  # (n_parameters,) of the log evidence
    cost: float  # sum of squares at the best fit, including penalties
    converged: bool
    amplitudes: Mapping[str, float]  # multiples of the standard amplitude of each discrepancy


class Hypotheses:
    """Fits of hypotheses to evidence.

    Residuals are independent except for discrepancies, a low-rank addition to their covariance.
    """

    def __init__(self, evidence: Evidence) -> None:
        self.evidence = evidence
        parameters = evidence.parameters
        self._lower = np.array([parameter.least for parameter in parameters])
        self._upper = np.array([parameter.most for parameter in parameters])
        self.effects = tuple(
            dict.fromkeys(parameter.effect for parameter in parameters if parameter.effect)
        )
        self.errors = SharedErrors(evidence)
        self.discrepancies = self.errors.discrepancies

    def region(self, active: Iterable[str]) -> BoundedRegion:
        """Return bounds and penalties if only the active effects may exceed their tolerances."""
        names = set(active)
        parameters = self.evidence.parameters
        is_active = np.array([parameter.effect in names for parameter in parameters])
        is_known = np.array([parameter.held for parameter in parameters])
        half_width = np.where(is_known, KNOWN_PARAMETER_BOUND, 1.0)
        half_width = np.where(is_active, np.inf, half_width)
        penalty = np.where(is_known, 1.0, 1.0 / SMALL)
        penalty = np.where(is_active, 1.0 / PRIOR_WIDTH_FACTOR, penalty)
        return BoundedRegion(
            lower=np.asarray(np.maximum(self._lower, -half_width), float),
            upper=np.asarray(np.minimum(self._upper, half_width), float),
            penalty=np.asarray(penalty, float),
        )

    def linearise_residuals(
        self, values: Array, active: Iterable[str]
    ) -> tuple[Array, Array, Array]:
        """Return residuals of the linearised model (n_rows,), extrapolated to zero parameters.

        Also the changes by one prior standard deviation of each parameter (n_rows, n_parameters)
        and of each discrepancy column (n_rows, r). All are divided by the noise.
        """
        table = finite_differences(self.evidence.residuals, values, self._upper)
        noise, penalty = self.errors.noise, self.region(active).penalty
        slope = table[:, 1:] / noise[:, None] / np.maximum(penalty, 1e-3)
        return (table[:, 0] - table[:, 1:] @ values) / noise, slope, self.errors.columns({})

    def log_evidence(self, fit: Hypothesis) -> float:
        """Return the log marginal likelihood of a hypothesis, up to a common constant.

        Laplace approximation at the best fit; exact for a linear model.
        """
        penalty = self.region(fit.active).penalty
        _, log_determinant = np.linalg.slogdet(self._posterior_precision(fit, penalty))
        log_occam = np.sum(np.log(penalty)) - 0.5 * log_determinant
        log_noise = self.errors.kernel(fit.amplitudes)[2]
        return float(-0.5 * fit.cost + log_occam - log_noise)

    def covariance(self, fit: Hypothesis) -> Array:
        """Return the posterior covariance, in scales; a parameter at its bound counts as free."""
        penalty = self.region(fit.active).penalty
        return np.asarray(np.linalg.inv(self._posterior_precision(fit, penalty)), float)

    def _posterior_precision(self, fit: Hypothesis, penalty: Array) -> Array:
        """Return curvature at the estimated noise plus prior precision (a square matrix)."""
        curvature = self.errors.linearise(fit.linearisation_point, fit.amplitudes).curvature
        precision: Array = curvature + np.diag(penalty**2) + RIDGE * np.eye(len(curvature))
        return precision

    def find_unjudged(self, fit: Hypothesis) -> dict[str, float]:
        """Return unjudged effects with their detection limits, in tolerances.

        The limit is the tolerance plus three standard deviations of the best determined parameter.
        Effects with a limit up to `MAX_DETECTION_LIMIT` are judged and not returned.
        """
        limits = {}
        for name in self.effects:
            is_own = [parameter.effect == name for parameter in self.evidence.parameters]
            # The effect itself has no prior: only the data limit it.
            penalty = np.where(is_own, 0.0, self.region(fit.active).penalty)
            sd = np.sqrt(np.diag(np.linalg.inv(self._posterior_precision(fit, penalty))))
            limit = 1.0 + 3.0 * np.min(sd[is_own])
            if limit > MAX_DETECTION_LIMIT:
                limits[name] = float(limit)
        return limits

    def evidence_against(self, fit: Hypothesis, rival: str) -> float:
        """Return the expected evidence against another effect if a hypothesis is true.

        Twice the expected log-likelihood ratio, from the Fisher information of the hypothesis. The
        other effect replaces the last one, which stays within its tolerance.
        """
        region = self.region((*fit.active[:-1], rival))
        information = self.errors.linearise(fit.linearisation_point, fit.amplitudes).curvature
        return evidence_against(information, fit.values, region.lower, region.upper)

    def fit_null(self) -> Hypothesis:
        """Return the best fit of the null, started from the model as given."""
        return self.fit((), self.errors.null_start)

    def fit(
        self,
        active: tuple[str, ...],
        initial_values: Array,
        amplitudes: Mapping[str, float] = NO_AMPLITUDES,
        linearisation_point: Array | None = None,
        **limits: Any,
    ) -> Hypothesis:
        """Return the best fit of active effects from initial values (n_parameters,).

        `linearisation_point` is by default the best fit; `limits` are those of the search.
        """
        search = self.errors.search(amplitudes)
        minimum = search.minimize(initial_values, self.region(active), **limits)
        return Hypothesis(
            active=active,
            values=minimum.values,
            linearisation_point=minimum.values
            if linearisation_point is None
            else linearisation_point,
            cost=minimum.cost,
            converged=minimum.converged,
            amplitudes=amplitudes,
        )

    def fit_without(self, fit: Hypothesis, name: str) -> Hypothesis:
        """Return the best fit without one effect or discrepancy of a hypothesis."""
        remaining = tuple(other for other in fit.active if other != name)
        amplitudes = {
            key: value
            for key, value in fit.amplitudes.items()
            if key != name and not key.startswith(f"{name}: law")
        }
        return self.fit(remaining, fit.values, amplitudes)

    def estimate_discrepancy(self, fit: Hypothesis, name: str) -> tuple[Array, Array]:
        """Return a discrepancy's posterior mean (n_rows,): in residuals, as a share of readings."""
        discrepancy, amplitude = self.discrepancies[name], fit.amplitudes.get(name, 1.0)
        columns, rows = self.errors.columns(fit.amplitudes), self.errors.rows(fit.values)[:, 0]
        weighted_residuals = solve_covariance(columns, rows) / self.errors.noise
        coefficients = amplitude**2 * (discrepancy.columns.T @ weighted_residuals)
        return discrepancy.columns @ coefficients, discrepancy.shares @ coefficients

    def size(self, fit: Hypothesis) -> float:
        """Return the size of the last effect, in tolerances of its largest parameter."""
        effect, parameters = fit.active[-1], self.evidence.parameters
        is_own = np.array([parameter.effect == effect for parameter in parameters])
        return float(np.max(np.abs(fit.values[is_own])))

    def contribution(self, fit: Hypothesis, names: Collection[str]) -> Array:
        """Return the contribution of effects to the residuals (n_rows,) of a hypothesis."""
        is_named = np.array([parameter.effect in names for parameter in self.evidence.parameters])
        rows = self.errors.rows(np.vstack([fit.values, np.where(is_named, 0.0, fit.values)]))
        return np.asarray(rows[:, 0] - rows[:, 1], float)

    def add_candidates(self, base: Hypothesis) -> list[Hypothesis]:
        """Return the base with each further effect or discrepancy added, best first."""
        point, amplitudes = base.values, base.amplitudes
        near = self.errors.linearise(point, amplitudes)
        candidates = []
        for name in self.effects:
            if name in base.active:
                continue
            active = (*base.active, name)
            if base.cost - near.step(self.region(active))[1] < MIN_PREDICTED_DECREASE:
                candidates.append(replace(base, active=active))
                continue
            limits = {"linearisation": near, "max_steps": SCREENING_STEPS}
            candidates.append(self.fit(active, point, amplitudes, point, **limits))
        candidates.sort(key=lambda candidate: candidate.cost)
        max_cost = np.inf
        for index, candidate in enumerate(candidates[:MAX_REFINED]):
            if not candidate.converged:
                candidates[index] = self.fit(
                    candidate.active, candidate.values, amplitudes, point, max_cost=max_cost
                )
            max_cost = min(max_cost, candidates[index].cost + MAX_COST_GAP)
        names = [name for name in self.discrepancies if name not in base.active]
        candidates += [self._with_discrepancy(base, name) for name in names]
        return sorted(candidates, key=self.log_evidence, reverse=True)

    def add_law_discrepancies(self, fits: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Return hypotheses with a law discrepancy (smooth variations) of their last effect."""
        laws = []
        for fit in fits:
            effect = fit.active[-1]
            law = f"{effect}: law {len(self.errors.all_columns)}"
            contribution = self.contribution(fit, [effect]) * self.errors.noise
            self.errors.add(law, self.evidence.varied(contribution) / self.errors.noise[:, None])
            laws.append(law)
        return [
            self._take_linear_step(fit, {**fit.amplitudes, law: 1.0})
            for fit, law in zip(fits, laws, strict=True)
        ]

    def other_law_evidence(self, fit: Hypothesis) -> float:
        """Return the log evidence if the last effect follows a different law."""
        law = f"{fit.active[-1]}: law"
        if not any(name.startswith(law) for name in fit.amplitudes):
            (fit,) = self.add_law_discrepancies([fit])
        amplitudes = {
            name: OTHER_LAW_SIZE if name.startswith(law) else size
            for name, size in fit.amplitudes.items()
        }
        near = self.errors.linearise(fit.linearisation_point, amplitudes)
        values, cost = near.step(self.region(fit.active))
        return self.log_evidence(replace(fit, values=values, cost=cost, amplitudes=amplitudes))

    def refit_linear(self, fit: Hypothesis) -> Hypothesis:
        """Refit a hypothesis of other data by one linear step, without law discrepancies."""
        amplitudes = {
            name: size for name, size in fit.amplitudes.items() if name in self.discrepancies
        }
        return self._take_linear_step(fit, amplitudes)

    def _take_linear_step(self, fit: Hypothesis, amplitudes: Mapping[str, float]) -> Hypothesis:
        """Return a hypothesis with other amplitudes, refitted to the linearisation at its fit."""
        point = fit.values
        values, cost = self.errors.linearise(point, amplitudes).step(self.region(fit.active))
        fit = replace(fit, linearisation_point=point, amplitudes=amplitudes)
        return replace(fit, values=values, cost=cost)

    def converge(self, fit: Hypothesis) -> Hypothesis:
        """Return a hypothesis fitted to convergence."""
        return self.fit(fit.active, fit.values, fit.amplitudes)

    def _with_discrepancy(self, base: Hypothesis, name: str) -> Hypothesis:
        """Return the base with a discrepancy beyond tolerance, at its most probable amplitude."""
        start = replace(base, active=(*base.active, name))  # bounds as the base: no effect is added
        candidates = [
            self._take_linear_step(start, {**base.amplitudes, name: amplitude})
            for amplitude in AMPLITUDES
        ]
        return max(candidates, key=self.log_evidence)

    def refit(self, base: Hypothesis, candidates: Iterable[Hypothesis]) -> Hypothesis:
        """Return the base refitted from the optima of other hypotheses, if one is better.

        An optimum outside the base's bounds is clipped to them. This prevents a local minimum of
        the base from looking like evidence for a candidate.
        """
        max_cost = base.cost + MAX_COST_GAP
        fits = [
            self.fit(base.active, candidate.values, base.amplitudes, max_cost=max_cost)
            for candidate in candidates
        ]
        return min([base, *fits], key=lambda fit: fit.cost)

    def p_value(
        self,
        base: Hypothesis,
        candidate: Hypothesis,
        inputs: ExplainInputs,
        rng: np.random.Generator,
    ) -> float:
        """Return the p-value of a candidate's gain over its base, corrected for all candidates.

        Without bootstrap: chi-squared with one degree of freedom per parameter of the effect,
        Bonferroni corrected; conservative because of the tolerances. With bootstrap: share of draws
        whose largest gain reaches the observed gain. A draw is a random gradient of the
        linearisation with the covariance of all errors, shared ones included. The bounded problem
        of each candidate is solved exactly on it.
        """
        gain, n = base.cost - candidate.cost, inputs.bootstrap
        if n <= 0:
            name = candidate.active[-1]
            dof = sum(parameter.effect == name for parameter in self.evidence.parameters)
            return float(min(1.0, len(self.effects) * chdtrc(dof, max(gain, 0.0))))
        curvature = self.errors.linearise(base.values, base.amplitudes).curvature
        regions = [self.region((*base.active, e)) for e in self.effects if e not in base.active]
        draw = partial(_draw_max_gains, base.values, curvature, self.region(base.active), regions)
        tasks = {
            str(first): (int(rng.integers(2**63)), min(first + DRAWS_PER_TASK, n) - first)
            for first in range(0, n, DRAWS_PER_TASK)
        }
        processes = None if n >= MIN_PARALLEL_DRAWS else 0
        gains = dict(run_tasks(draw, tasks, cluster=inputs.cluster, processes=processes))
        n_reached = sum(np.sum(np.array(part) >= gain) for part in gains.values())
        return float((1 + n_reached) / (n + 1))


def _draw_max_gains(
    values: Array,
    curvature: Array,
    base_region: BoundedRegion,
    regions: Sequence[BoundedRegion],
    task: tuple[int, int],
) -> list[float]:
    """Return the largest gain of each draw of a task (seed, number of draws)."""
    seed, draws = task
    rng = np.random.default_rng(seed)
    factor = np.linalg.cholesky(curvature + RIDGE * np.eye(len(curvature)))
    gains = []
    for _ in range(draws):
        sample = Linearisation(
            point=values,
            cost=0.0,
            gradient=factor @ rng.standard_normal(len(factor)),
            curvature=curvature,
        )
        _, base_cost = sample.step(base_region)
        gains.append(max(base_cost - sample.step(region)[1] for region in regions))
    return gains
