"""Hypotheses about what a model lacks, from "nothing that matters" upward.

The null is composite: every effect may be there within its tolerance, and what the owner knows
only roughly may be anywhere its uncertainty allows. An effect is named only where its own
tolerance must break. A bench with ten small real imperfections is still a bench on which nothing
is missing; a test against exactly zero would name one of them on every record.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np
from scipy.stats import chi2

from benchtool.core.array_type import Array
from benchtool.explain.engine.evidence import Evidence
from benchtool.explain.engine.shared_errors import AMPLITUDES, PRIOR_WIDTH_FACTOR, SharedErrors
from benchtool.fit.bounded_least_squares import (
    BoundedRegion,
    Linearisation,
    MinimizationResult,
    slopes,
)
from benchtool.fit.identifiability import evidence_against
from benchtool.tasks import run_tasks

NOTHING: Mapping[str, float] = MappingProxyType({})

SMALL = 1.0 / 3.0  # prior sd of an effect within tolerance, in tolerances; assumed
REACH = 2.0  # how many standard errors a number that the owner knows roughly may be off
MAX_DETECTION_LIMIT = 2.0  # tolerances; an effect that needs more to show is not judged
FIRST_STEPS = 1  # steps of every candidate from the base's neighbourhood
FINISHED = 4  # how many of the best go on
MAX_COST_GAP = 60.0  # sum of squares behind the best at which a candidate is dropped
MIN_PREDICTED_DECREASE = (
    2.0  # promised decrease of the sum of squares below which nothing is fitted
)
OTHER_LAW_SIZE = 10.0  # of a law's tolerance: as much as the effect where that is 10 %; assumed
BLOCK = 250  # draws of a task of the bootstrap: most of a second
MIN_PARALLEL_DRAWS = 2000  # draws; worker processes take 2 s to start


@dataclass(frozen=True, slots=True, kw_only=True)
class Bootstrap:
    """State how many records are drawn from the null, and on which cluster (this machine: None)."""

    draws: int = 0
    cluster: str | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Hypothesis:
    """Hold a set of effects and discrepancies that may break their tolerances, and its best fit."""

    active: tuple[str, ...]
    values: Array  # (n_parameters,) the best numbers, in scales
    linearisation_point: (
        Array  # (n_parameters,) where the neighbourhood is known that its evidence comes from
    )
    cost: float  # sum of squares there, penalties included
    converged: bool  # whether the search came to rest
    amplitudes: Mapping[str, float]  # how many times its usual size each discrepancy may be


class Hypotheses:
    """Fit hypotheses to evidence.

    Residuals are independent but for discrepancies, a low-rank addition to their covariance.
    """

    def __init__(self, evidence: Evidence) -> None:
        self.evidence = evidence
        parameters = evidence.parameters
        self._limits = (
            np.array([parameter.least for parameter in parameters]),
            np.array([parameter.most for parameter in parameters]),
        )
        self.effects = tuple(
            dict.fromkeys(parameter.effect for parameter in parameters if parameter.effect)
        )
        self.errors = SharedErrors(evidence)
        self.discrepancies = self.errors.discrepancies

    @property
    def noise(self) -> Array:
        """How large the noise of each row is over the stated one (n_rows,), 1 at least."""
        return self.errors.noise

    @property
    def n_rows(self) -> int:
        """How many residuals there are."""
        return self.errors.n_rows

    def near(self, at: Array, widened: Mapping[str, float]) -> Linearisation:
        """Return the neighbourhood of a point; the same one is worked out once."""
        return self.errors.near(at, widened)

    def region(self, opened: Iterable[str]) -> BoundedRegion:
        """Return bounds and penalties under which only some effects may break their tolerance."""
        names = set(opened)
        parameters = self.evidence.parameters
        wide = np.array([parameter.effect in names for parameter in parameters])
        held = np.array([parameter.held for parameter in parameters])
        limit = np.asarray(np.where(held, REACH, 1.0), float)
        reach = np.asarray(np.where(wide, np.inf, limit), float)
        return BoundedRegion(
            lower=np.asarray(np.maximum(self._limits[0], -reach), float),
            upper=np.asarray(np.minimum(self._limits[1], reach), float),
            penalty=np.asarray(
                np.where(wide, 1.0 / PRIOR_WIDTH_FACTOR, np.where(held, 1.0, 1.0 / SMALL)), float
            ),
        )

    def missed(self, at: Array, opened: Iterable[str]) -> tuple[Array, Array, Array]:
        """Return what a model that is linear about parameters (n_parameters,) misses (n_rows,).

        Then what may vary, with `opened` effects as large as they like: parameters (n_rows,
        n_parameters) and departures (n_rows, r), by one standard deviation each. All over the
        noise.
        """
        upper = np.array([parameter.most for parameter in self.evidence.parameters])
        rows, jacobian = slopes(self.evidence.residuals, at, upper)
        noise, penalty = self.errors.noise, self.region(opened).penalty
        slope = jacobian / noise[:, None] / np.maximum(penalty, 1e-3)
        return (rows - jacobian @ at) / noise, slope, self.errors.columns({})

    def log_evidence(self, one: Hypothesis) -> float:
        """Return the log marginal likelihood of a hypothesis, up to what all of them share.

        Laplace's approximation about its best numbers, exact where the model is linear.
        """
        penalty = self.region(one.active).penalty
        curvature = self.near(one.linearisation_point, one.amplitudes).curvature
        ridge = 1e-9 * np.eye(len(curvature))
        _, log_total = np.linalg.slogdet(curvature + np.diag(penalty**2) + ridge)
        log_occam = np.sum(np.log(penalty)) - 0.5 * log_total
        log_noise = self.errors.log_root(one.amplitudes)
        return float(-0.5 * one.cost + log_occam - log_noise)

    def spread(self, one: Hypothesis) -> Array:
        """Return the covariance of all parameters at a hypothesis, in scales.

        (n_parameters, n_parameters). From the curvature, the noise as large as the residuals say,
        and the penalties; a parameter at the end of its tolerance counts as if it could move on.
        """
        region = self.region(one.active)
        curvature = self.near(one.linearisation_point, one.amplitudes).curvature
        ridge = 1e-9 * np.eye(len(curvature))
        return np.asarray(np.linalg.inv(curvature + np.diag(region.penalty**2) + ridge), float)

    def unseen(self, one: Hypothesis) -> dict[str, float]:
        """Return effects that the data cannot show: by how many tolerances each would have to act.

        Its tolerance and three standard deviations of the parameter that shows best, if that is
        more than `MAX_DETECTION_LIMIT`.
        """
        curvature = self.near(one.linearisation_point, one.amplitudes).curvature
        out = {}
        for name in self.effects:
            own = [parameter.effect == name for parameter in self.evidence.parameters]
            penalty = np.where(own, 0.0, self.region(one.active).penalty)  # data alone
            total = curvature + np.diag(penalty**2) + 1e-9 * np.eye(len(curvature))
            spread = np.sqrt(np.diag(np.linalg.inv(total)))
            needed = 1.0 + 3.0 * np.min(spread[own])
            if needed > MAX_DETECTION_LIMIT:
                out[name] = float(needed)
        return out

    def evidence_against(self, one: Hypothesis, rival: str) -> float:
        """Return how clearly such data speak against a rival in the last place, were `one` true.

        Twice the log-likelihood ratio on average, from the hypothesis' own Fisher information; the
        effect whose place it is lies within its tolerance, as all others do.
        """
        region = self.region((*one.active[:-1], rival))
        matrix = self.near(one.linearisation_point, one.amplitudes).curvature
        return evidence_against(matrix, one.values, region.lower, region.upper)

    def null(self) -> Hypothesis:
        """Return the best numbers with nothing open, from the model as given."""
        return self.fitted((), self.errors.null_start)

    def fitted(
        self, opened: tuple[str, ...], start: Array, widened: Mapping[str, float] = NOTHING
    ) -> Hypothesis:
        """Return the best numbers with those open, from given ones (n_parameters,) on."""
        region = self.region(opened)
        near = self.near(region.clipped(start), widened)
        found = self.errors.search(widened).minimum(start, region, known=near)
        return _of(opened, found, widened)

    def without(self, one: Hypothesis, name: str) -> Hypothesis:
        """Return the best fit without one of a hypothesis' members."""
        rest = tuple(other for other in one.active if other != name)
        widened = {
            key: value
            for key, value in one.amplitudes.items()
            if key != name and not key.startswith(f"{name}: law")
        }
        return self.fitted(rest, one.values, widened)

    def estimate_discrepancy(self, one: Hypothesis, name: str) -> tuple[Array, Array]:
        """Return what a discrepancy takes up at a hypothesis: of residuals, as a share of readings.

        (n_rows,) each, the mean of its posterior.
        """
        discrepancy, factor = self.discrepancies[name], one.amplitudes.get(name, 1.0)
        draws = factor**2 * (discrepancy.columns.T @ self.errors.left(one.values, one.amplitudes))
        return discrepancy.columns @ draws, discrepancy.shares @ draws

    def size(self, one: Hypothesis) -> float:
        """Return how large the effect opened last is, in tolerances of its largest parameter."""
        own = np.array([item.effect == one.active[-1] for item in self.evidence.parameters])
        return float(np.max(np.abs(one.values[own])))

    def contribution(self, one: Hypothesis, names: Collection[str]) -> Array:
        """Return what named effects change in the residuals (n_rows,) of a hypothesis."""
        own = np.array([parameter.effect in names for parameter in self.evidence.parameters])
        rows = self.errors.rows(np.vstack([one.values, np.where(own, 0.0, one.values)]))
        return np.asarray(rows[:, 0] - rows[:, 1], float)

    def add_candidates(self, base: Hypothesis) -> list[Hypothesis]:
        """Return the base with each other effect and discrepancy opened in turn, best first."""
        near, search = self.near(base.values, base.amplitudes), self.errors.search(base.amplitudes)
        out = []
        for name in self.effects:
            if name in base.active:
                continue
            opened = (*base.active, name)
            region = self.region(opened)
            _, promised = near.step(region)
            if base.cost - promised < MIN_PREDICTED_DECREASE:
                out.append(replace(base, active=opened))
                continue
            found = search.minimum(base.values, region, known=near, most_steps=FIRST_STEPS)
            out.append(_of(opened, found, base.amplitudes, base.values))
        out.sort(key=lambda item: item.cost)
        above = np.inf
        for place, one in enumerate(out[:FINISHED]):
            if not one.converged:
                region = self.region(one.active)
                found = search.minimum(one.values, region, above=above)
                out[place] = _of(one.active, found, base.amplitudes, base.values)
            above = min(above, out[place].cost + MAX_COST_GAP)
        out += [self._widened(base, name) for name in self.discrepancies if name not in base.active]
        return sorted(out, key=self.log_evidence, reverse=True)

    def add_law_discrepancies(self, tried: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Return hypotheses whose last effects follow their laws only roughly.

        What the laws may be off by is known from what each effect does at its best numbers.
        """
        laws = []
        for one in tried:
            name = one.active[-1]
            law = f"{name}: law {self.errors.n_columns}"
            changes = self.contribution(one, [name]) * self.noise
            self.errors.add(law, self.evidence.varied(changes) / self.noise[:, None])
            laws.append(law)
        out = []
        for one, law in zip(tried, laws, strict=True):
            widened, region = {**one.amplitudes, law: 1.0}, self.region(one.active)
            at, cost = self.near(one.values, widened).step(region)
            out.append(
                replace(
                    one, values=at, linearisation_point=one.values, cost=cost, amplitudes=widened
                )
            )
        return out

    def by_other_law(self, one: Hypothesis) -> float:
        """Return the log evidence of a hypothesis whose last effect follows quite another law."""
        law = f"{one.active[-1]}: law"
        if not any(name.startswith(law) for name in one.amplitudes):
            (one,) = self.add_law_discrepancies([one])
        widened = {
            name: OTHER_LAW_SIZE if name.startswith(law) else size
            for name, size in one.amplitudes.items()
        }
        at, cost = self.near(one.linearisation_point, widened).step(self.region(one.active))
        return self.log_evidence(replace(one, values=at, cost=cost, amplitudes=widened))

    def near_fit(self, one: Hypothesis) -> Hypothesis:
        """Return a hypothesis about other rows fitted to these, by one neighbourhood.

        Laws are taken to be exact.
        """
        widened = {
            name: size for name, size in one.amplitudes.items() if name in self.discrepancies
        }
        at, cost = self.near(one.values, widened).step(self.region(one.active))
        return replace(
            one, values=at, linearisation_point=one.values, cost=cost, amplitudes=widened
        )

    def converge(self, one: Hypothesis) -> Hypothesis:
        """Return a hypothesis whose best numbers were followed to the end."""
        return self.fitted(one.active, one.values, one.amplitudes)

    def _widened(self, base: Hypothesis, name: str) -> Hypothesis:
        """Return the base with a discrepancy beyond tolerance, as large as suits it best."""
        region, tried = self.region(base.active), []
        for factor in AMPLITUDES:
            widened = {**base.amplitudes, name: factor}
            at, cost = self.near(base.values, widened).step(region)
            opened = (*base.active, name)
            tried.append(
                replace(
                    base,
                    active=opened,
                    values=at,
                    linearisation_point=base.values,
                    cost=cost,
                    amplitudes=widened,
                )
            )
        return max(tried, key=self.log_evidence)

    def refit(self, base: Hypothesis, others: Iterable[Hypothesis]) -> Hypothesis:
        """Return the base refitted from others' optima, so that it is not above a feasible one.

        A candidate whose optimum lies inside its tolerance is itself a point of the base; one
        outside, moved back to the tolerance's edge, is a start that the base may not have seen.
        """
        region, search = self.region(base.active), self.errors.search(base.amplitudes)
        best = base
        above = base.cost + MAX_COST_GAP
        for other in others:
            start = region.clipped(other.values)
            near = self.near(start, base.amplitudes)
            found = search.minimum(start, region, known=near, above=above)
            if found.cost < best.cost:
                best = _of(base.active, found, base.amplitudes)
        return best

    def null_gains(self, base: Hypothesis, draws: Bootstrap, rng: np.random.Generator) -> Array:
        """Return the largest gain of any candidate (draws,) when the base is the truth.

        Errors drawn about the base, the shared ones among them, move the gradient of its
        neighbourhood; there every candidate's bounded problem is solved exactly.
        """
        curvature = self.near(base.values, base.amplitudes).curvature
        regions = [self.region((*base.active, e)) for e in self.effects if e not in base.active]
        drawn = partial(_drawn_gains, base.values, curvature, self.region(base.active), regions)
        blocks = {
            str(start): (int(rng.integers(2**63)), min(start + BLOCK, draws.draws) - start)
            for start in range(0, draws.draws, BLOCK)
        }
        processes = None if draws.draws >= MIN_PARALLEL_DRAWS else 0
        found = dict(run_tasks(drawn, blocks, cluster=draws.cluster, processes=processes))
        return np.concatenate([found[name] for name in blocks])


def _drawn_gains(
    at: Array,
    curvature: Array,
    own: BoundedRegion,
    regions: Sequence[BoundedRegion],
    block: tuple[int, int],
) -> list[float]:
    """Return the largest gains of a block of draws: its seed, and how many."""
    seed, draws = block
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(curvature + 1e-9 * np.eye(len(curvature)))
    out = []
    for _ in range(draws):
        drawn = Linearisation(
            at=at, cost=0.0, gradient=root @ rng.standard_normal(len(root)), curvature=curvature
        )
        _, least = drawn.step(own)
        out.append(max(least - drawn.step(region)[1] for region in regions))
    return out


def _of(
    opened: tuple[str, ...],
    found: MinimizationResult,
    widened: Mapping[str, float],
    about: Array | None = None,
) -> Hypothesis:
    return Hypothesis(
        active=opened,
        values=found.at,
        linearisation_point=found.at if about is None else about,
        cost=found.cost,
        converged=found.converged,
        amplitudes=widened,
    )


def p_value(
    hypotheses: Hypotheses,
    base: Hypothesis,
    one: Hypothesis,
    bootstrap: Bootstrap,
    rng: np.random.Generator,
) -> float:
    """Return the p-value of a candidate's gain over its base, for the largest of all candidates.

    Asymptotic: a chi-squared law of as many degrees of freedom as the effect has numbers, times the
    number of candidates (Bonferroni); the tolerance makes it conservative. With `bootstrap` draws
    it is counted: residuals with all their errors are drawn about the base, and every candidate is
    fitted to each by the base's own neighbourhood.
    """
    gain = base.cost - one.cost
    name = one.active[-1]
    numbers = sum(parameter.effect == name for parameter in hypotheses.evidence.parameters)
    if bootstrap.draws <= 0:
        return float(min(1.0, len(hypotheses.effects) * chi2.sf(max(gain, 0.0), numbers)))
    drawn = hypotheses.null_gains(base, bootstrap, rng)
    return float((1 + np.sum(drawn >= gain)) / (bootstrap.draws + 1))
