"""Expected log evidence ratios of an experiment between candidates.

Each candidate predicts the readings of an experiment as a Gaussian. Its covariance has the noise,
the parameter uncertainty after the recordings so far, and the discrepancies. The expected log
evidence ratio of a true candidate over another one is the divergence between their Gaussians
(Kullback and Leibler, Ann. Math. Stat. 22, 1951).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, inf, log, sqrt
from typing import ClassVar, Generic, Protocol, Self, TypeVar

import numpy as np

from benchtool.core.schedule import Schedule
from benchtool.core.units import Array
from benchtool.explain.engine.bounded_least_squares import (
    BoundedRegion,
    Linearisation,
    finite_differences,
)
from benchtool.explain.engine.evidence import Evidence
from benchtool.explain.engine.hypotheses import Hypotheses, Hypothesis
from benchtool.explain.findings import DECISION_PROBABILITY, NextExperiment
from benchtool.physics.effects.effect import Subsystem

ESC_MODE = (  # for an unnamed effect between pulse width and speed
    "speed at a pulse width depends on pulse width, plate and supply, which pulse widths near to "
    "and far from the plate separate; record the ESC's mode as well: a governor holds the speed "
    "against plate and supply, otherwise the ESC sets a voltage and the speed varies"
)

MAX_CONFUSION = 0.01  # expected confusion below which a design is complete; assumed
MIN_LOG_DECREASE = 0.01  # of the expected confusion by an addition; assumed
DRAWS = 64  # simulated experiments for the expected outcome of the selected design
MAX_REPORTED_RATIO = 100.0  # larger expected log evidence ratios depend on a few extreme draws
MIN_DURATION_S = 20.0  # of an addition, in its gain per time; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CandidateEffect:
    """Candidate that an experiment is to separate from others."""

    name: str  # an effect, "none" or "unknown"
    phrase: str  # within a sentence
    fit: Hypothesis
    probability: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CandidatePrediction:
    """Prediction of new rows by one candidate: mean + slopes u, with a Gaussian u."""

    mean: Array  # (n,) over the noise
    slopes: Array  # (n, q)
    precision: Array  # (q, q) of u, from the recordings so far
    bounds: tuple[Array, Array]  # lower and upper, of the first elements of u

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Return random rows (n, count) if this candidate is true."""
        normal = rng.standard_normal((len(self.precision), count))
        u = np.linalg.solve(np.linalg.cholesky(self.precision).T, normal)
        n = len(self.bounds[0])
        u[:n] = np.clip(u[:n], *(bound[:, None] for bound in self.bounds))
        noise = rng.standard_normal((len(self.mean), count))
        return np.asarray(self.mean[:, None] + self.slopes @ u + noise, float)

    def log_evidence(self, rows: Array) -> Array:
        """Return the log evidence (count,) of rows (n, count), up to a common constant."""
        n, count = len(self.bounds[0]), rows.shape[1]
        residuals, square = rows - self.mean[:, None], self.slopes.T @ self.slopes
        precision, projected = self.precision + square, self.slopes.T @ residuals
        stacked = np.column_stack([projected, precision[:, :n]])[n:]
        solved = np.linalg.solve(precision[n:, n:], stacked)
        curvature = precision[:n, :n] - precision[:n, n:] @ solved[:, count:]
        gradient = precision[:n, n:] @ solved[:, :count] - projected[:n]
        cost = np.sum(residuals**2, axis=0) - np.sum(projected[n:] * solved[:, :count], axis=0)
        region = BoundedRegion(lower=self.bounds[0], upper=self.bounds[1], penalty=np.zeros(n))
        costs = [
            Linearisation(np.zeros(n), constant, slope, curvature).step(region)[1]
            for constant, slope in zip(cost, gradient.T, strict=True)
        ]
        return -0.5 * np.array(costs) - 0.5 * self._log_determinant(square)

    def log_ratio(self, other: CandidatePrediction, rng: np.random.Generator | None) -> float:
        """Return the expected log evidence ratio over another candidate if this one is true."""
        if rng is None:
            return self._divergence(other)
        rows = self.draw(DRAWS, rng)
        return float(np.mean(self.log_evidence(rows) - other.log_evidence(rows)))

    def _divergence(self, other: CandidatePrediction) -> float:
        difference, a, b = self.mean - other.mean, self.slopes, other.slopes
        precision = other.precision + b.T @ b
        projected, cross, square = b.T @ difference, b.T @ a, a.T @ a
        covariance = np.linalg.inv(self.precision)
        distance = difference @ difference - projected @ np.linalg.solve(precision, projected)
        inner = precision - other.precision + cross @ covariance @ cross.T
        trace = np.trace(covariance @ square) - np.trace(np.linalg.solve(precision, inner))
        log_determinant = other._log_determinant(b.T @ b)
        return float(0.5 * (distance + trace + log_determinant - self._log_determinant(square)))

    def _log_determinant(self, square: Array) -> float:
        """Return the log determinant of the covariance of the new rows."""
        before = np.linalg.slogdet(self.precision)[1]
        return float(np.linalg.slogdet(self.precision + square)[1] - before)


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedOutcome:
    """Expected outcome between the most probable candidate and each other."""

    ratios: Mapping[str, float]  # log evidence ratios, averaged over which of the two is true
    confusion: float  # bound on the probability that the most probable candidate is not the truth


class Design(Protocol):
    """Design of an experiment."""

    @property
    def duration_s(self) -> float: ...
    @property
    def title(self) -> str: ...
    @property
    def schedule(self) -> Schedule | None: ...
    @property
    def plan_toml(self) -> str: ...
    def extend(self) -> Mapping[str, Self]:
        """Return designs with one addition or change each, by its name."""
        ...


D = TypeVar("D", bound=Design)


class Designer(ABC, Generic[D]):
    """Search for the experiment on one kind of bench with the best expected separation."""

    max_minutes: ClassVar[float]  # of an experiment
    evidence: Evidence  # of all recordings so far

    def __init__(
        self, evidence: Evidence, candidates: Sequence[CandidateEffect], rng: np.random.Generator
    ) -> None:
        self.evidence, self._rng = evidence, rng
        self._hypotheses = hypotheses = Hypotheses(evidence)
        self._upper = np.array([parameter.most for parameter in evidence.parameters])
        fits = [hypotheses.refit_linear(candidate.fit) for candidate in candidates]
        fits = [hypotheses.converge(fit) for fit in fits]
        pairs = zip(candidates, fits, strict=True)
        self._candidates = [replace(candidate, fit=fit) for candidate, fit in pairs]
        self.values = fits[0].values  # parameters (n_parameters,) of simulated experiments
        self._before = [
            finite_differences(evidence.residuals, fit.values, self._upper) for fit in fits
        ]
        masks = evidence.groups().stages
        self._noise = {
            stage: float(hypotheses.errors.noise[mask][0]) for stage, mask in masks.items()
        }

    @abstractmethod
    def initial(self, *, ladder: bool) -> D:
        """Return the initial design; `ladder`: with several levels of the pulses."""

    @abstractmethod
    def simulate(self, design: D) -> tuple[Evidence, Evidence]:
        """Return the evidence of an experiment without noise: alone, and after `evidence`."""

    def propose(self, refused: Subsystem | None, minutes: float | None) -> NextExperiment:
        """Return the best experiment of at most `minutes` or `max_minutes`.

        `refused` is the stage of an unnamed effect, or None.
        """
        first = self.initial(ladder=refused == "pwm_to_rpm")
        max_minutes = min(minutes or self.max_minutes, self.max_minutes)
        best = select_design(first, self.expect, 60.0 * max_minutes)
        ratios = self.expect(best, self._rng).ratios
        return NextExperiment(
            candidates=tuple(dict.fromkeys(candidate.name for candidate in self._candidates)),
            title=best.title,
            reason=_format_reason(self._candidates, ratios, refused),
            schedule=best.schedule,
            plan_toml=best.plan_toml,
            expected=ratios,
            minutes=best.duration_s / 60.0,
        )

    def expect(self, design: D, rng: np.random.Generator | None = None) -> ExpectedOutcome:
        """Return the expected outcome of an experiment.

        With `rng` from simulated outcomes with bounded parameters, else from Gaussians without
        bounds, which are quick and sufficient to compare designs.
        """
        first, *others = zip(self._candidates, self._predict(*self.simulate(design)), strict=True)
        a, a_rows = first
        ratios, confusion = dict[str, float](), 0.0
        for b, b_rows in others:
            if a.name == b.name:  # both unnamed
                continue
            ratio = a.probability * a_rows.log_ratio(b_rows, rng)
            ratio += b.probability * b_rows.log_ratio(a_rows, rng)
            ratio /= a.probability + b.probability
            ratios[b.name] = min(ratio, ratios.get(b.name, inf))
            confusion += sqrt(a.probability * b.probability) * exp(-0.25 * ratio)
        return ExpectedOutcome(ratios, confusion)

    def _predict(self, new: Evidence, both: Evidence) -> list[CandidatePrediction]:
        """Return the prediction of an experiment by each candidate."""
        masks = new.groups().stages
        noise = np.ones(len(next(iter(masks.values()))))
        for stage, mask in masks.items():
            noise[mask] = self._noise.get(stage, 1.0)
        noise = np.concatenate([self._hypotheses.errors.noise, noise])
        columns = {part.name: part.columns for part in both.discrepancies()}
        predictions = []
        for candidate, before in zip(self._candidates, self._before, strict=True):
            fit = candidate.fit
            region = self._hypotheses.region(fit.active)
            is_free = (fit.values > region.lower + 1e-9) & (fit.values < region.upper - 1e-9)
            after = finite_differences(new.residuals, fit.values, self._upper)
            table = np.concatenate([before, after])
            factors = self._hypotheses.errors.factors(fit.amplitudes)
            shared = [factor * columns[name] for name, factor in factors.items()]
            for name in fit.active:
                if name in self._hypotheses.effects and columns:
                    is_own = np.array([parameter.effect == name for parameter in both.parameters])
                    sets = np.vstack([fit.values, np.where(is_own, 0.0, fit.values)])
                    residuals = both.residuals(sets)
                    shared.append(both.varied(residuals[:, 0] - residuals[:, 1]))
            n_before, n_free = len(before), int(is_free.sum())
            design = np.hstack([-table[:, 1:][:, is_free], *shared]) / noise[:, None]
            rows = table[:, 0] / noise
            n_shared = design.shape[1] - n_free
            prior = np.concatenate([region.penalty[is_free] ** 2, np.ones(n_shared)])
            precision = design[:n_before].T @ design[:n_before] + np.diag(prior + 1e-9)
            # Parameters are at the best fit; discrepancies are estimated from the residuals.
            projected = design[:n_before, n_free:].T @ rows[:n_before]
            coefficients = np.linalg.solve(precision[n_free:, n_free:], projected)
            lower, upper = region.lower - fit.values, region.upper - fit.values
            predictions.append(
                CandidatePrediction(
                    mean=design[n_before:, n_free:] @ coefficients - rows[n_before:],
                    slopes=design[n_before:],
                    precision=precision,
                    bounds=(lower[is_free], upper[is_free]),
                )
            )
        return predictions


def select_design(first: D, expect: Callable[[D], ExpectedOutcome], max_s: float) -> D:
    """Return the design with the largest decrease of confusion per time, extended greedily."""
    best, expected, rates = first, expect(first), dict[str, float]()
    while expected.confusion > MAX_CONFUSION:
        options = {
            name: option for name, option in best.extend().items() if option.duration_s <= max_s
        }
        outcomes = dict[str, ExpectedOutcome]()
        # The gain of an addition decreases as the design grows: old rates bound new ones.
        while options and (name := max(options, key=lambda k: rates.get(k, inf))) not in outcomes:
            outcomes[name] = expect(options[name])
            decrease = log(expected.confusion / outcomes[name].confusion)
            added_s = max(MIN_DURATION_S, options[name].duration_s - best.duration_s)
            rates[name] = decrease / added_s if decrease > MIN_LOG_DECREASE else 0.0
        if not options or rates[name] <= 0.0:
            break
        best, expected = options[name], outcomes[name]
    return best


def _format_reason(
    candidates: Sequence[CandidateEffect], ratios: Mapping[str, float], refused: Subsystem | None
) -> str:
    """Return the expected log evidence ratios of the first candidate as text."""
    phrases = {candidate.name: candidate.phrase for candidate in reversed(candidates)}
    separated = [name for name, ratio in ratios.items() if ratio >= DECISION_PROBABILITY]
    other = next(iter(separated or ratios))
    ratio = ratios[other]
    size = "above 100" if ratio > MAX_REPORTED_RATIO else f"of {ratio:.1f}"
    reason = (
        f"expected to separate {phrases[candidates[0].name]} from {phrases[other]} by a log "
        f"evidence ratio {size}"
    )
    others = [phrases[name] for name in ratios if name not in separated]
    if separated and others:
        reason = f"{reason}, but not from {', '.join(others)}"
    return f"{ESC_MODE}; {reason}" if refused == "pwm_to_rpm" else reason
