"""Hierarchical model of several rigs: the values of each rig scatter about a common mean.

    y_i = theta_i + e_i,          e_i ~ N(0, V_i)      estimate of rig i, its covariance
    theta_i = mu + d_i,           d_i ~ N(0, diag(tau^2))

(Gelman et al., Bayesian Data Analysis, 3rd ed., 2013, section 5.4, with V_i a matrix.) A shared
parameter has tau = 0. The mean mu has a flat prior. Each tau has that of DuMouchel (1994),
p(tau) = s/(s + tau)^2 with s^2 the harmonic mean of the rigs' variances: proper for two rigs,
scale-free, with median s. It is flat in u = tau/(s + tau) on 0 to 1. emcee samples u with mu and
theta integrated analytically; they are then drawn exactly for each draw of u.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from emcee.moves import MHMove
from scipy.special import logsumexp

from benchtool.core.errors import InputError, NotConverged
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.fit.ensemble import ENSEMBLES, sample_until_converged
from benchtool.fit.sampling import IslandDifference

DRAWS = 20_000
MAX_STEPS = 20_000

GRID = 400  # points of u for its density at 0
GRID_MARGIN = 64  # draws of the other u that the density is averaged over

AT_ZERO = 0.02  # an interval of tau with lower end / upper end below this starts at 0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RigValues:
    """Fit of one rig: normal approximation of its likelihood."""

    name: str
    names: tuple[str, ...]  # (n,) of parameters
    values: Array  # (n,) in the parameters' units
    covariance: Array  # (n, n)


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """Difference of the partially pooled values of two rigs (`rig` less `other`)."""

    rig: str
    other: str
    value: float
    sd: float
    interval_95: tuple[float, float]
    probability: float  # that the difference has the sign of its mean

    @property
    def is_significant(self) -> bool:
        """True if the 95 % interval excludes 0."""
        return self.interval_95[0] > 0.0 or self.interval_95[1] < 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class PooledEstimates:
    """Joint posterior of several rigs."""

    rigs: tuple[RigValues, ...]
    names: tuple[str, ...]  # (p,) of parameters
    shared: tuple[bool, ...]  # (p,) True if a parameter is the same in all rigs
    scale: Array  # (p,) s of the prior of tau
    tau: Array  # (draws, p) standard deviation between rigs
    mean: Array  # (draws, p) common mean
    rig_values: Array  # (draws, rigs, p); nan if the rig's fit lacks the parameter
    identical_probability: Array  # (p,) posterior of tau = 0 at prior 0.5; nan if shared

    def find_values(self, name: str) -> list[tuple[int, float, float]]:
        """Return index, unpooled value and standard deviation of each rig with a parameter."""
        rows = []
        for index, rig in enumerate(self.rigs):
            if name in rig.names:
                k = rig.names.index(name)
                rows.append((index, float(rig.values[k]), float(rig.covariance[k, k] ** 0.5)))
        return rows

    def tau_95(self, name: str) -> tuple[float, float]:
        """Return the shortest interval with 95 % of the draws of tau."""
        draws = np.sort(self.tau[:, self.names.index(name)])
        m = int(np.ceil(0.95 * len(draws)))
        first = int(np.argmin(draws[m - 1 :] - draws[: len(draws) - m + 1]))
        low, high = draws[first], draws[first + m - 1]
        return (0.0, float(draws[m - 1])) if low < AT_ZERO * high else (float(low), float(high))

    @cached_property
    def differences(self) -> dict[str, tuple[Difference, ...]]:
        """Differences of all pairs of rigs by unshared parameter, the most significant first."""
        differences = {}
        for k, name in enumerate(self.names):
            if self.shared[k]:
                continue
            pairs = combinations([rig_index for rig_index, *_ in self.find_values(name)], 2)
            pooled = [self._difference(k, *pair) for pair in pairs]
            differences[name] = tuple(sorted(pooled, key=lambda pair: -abs(pair.value) / pair.sd))
        return differences

    def _difference(self, k: int, rig_index: int, other_index: int) -> Difference:
        draws = self.rig_values[:, rig_index, k] - self.rig_values[:, other_index, k]
        low, high = np.quantile(draws, [0.025, 0.975])
        above = float(np.mean(draws > 0.0))
        return Difference(
            rig=self.rigs[rig_index].name,
            other=self.rigs[other_index].name,
            value=float(draws.mean()),
            sd=float(draws.std()),
            interval_95=(float(low), float(high)),
            probability=max(above, 1.0 - above),
        )


def pool_rigs(
    rigs: Sequence[RigValues], names: Sequence[str], shared: Sequence[str] = (), *, seed: int = 1
) -> PooledEstimates:
    """Return the joint posterior of several rigs.

    Each parameter must be in at least two rigs. NotConverged is raised if the chains of tau do not
    agree.
    """
    for name in names:
        names_with = [rig.name for rig in rigs if name in rig.names]
        if len(names_with) < 2:
            raise InputError(
                f"{name} is in {pluralize(len(names_with), 'fit')} of {len(rigs)}; pooling needs "
                "2 or more"
            )
    model = _Model(rigs, names)
    free = [k for k, name in enumerate(names) if name not in shared]
    rng = np.random.default_rng(seed)
    u = np.zeros((DRAWS, len(names)))
    if free:
        u[:, free] = _sample_u(model, free, rng)
    tau = model.tau(u)
    mean, rig_values = model.drawn(tau, rng)
    alike = np.full(len(names), np.nan)
    for k in free:
        alike[k] = model.alike(k, u[rng.integers(len(u), size=GRID_MARGIN)])
    return PooledEstimates(
        rigs=tuple(rigs),
        names=tuple(names),
        shared=tuple(name in shared for name in names),
        scale=model.scale,
        tau=tau,
        mean=mean,
        rig_values=rig_values,
        identical_probability=alike,
    )


class _Model:
    """Arrays of all rigs; parameters that a fit lacks are masked."""

    def __init__(self, rigs: Sequence[RigValues], names: Sequence[str]) -> None:
        j, p = len(rigs), len(names)
        self.y = np.zeros((j, p))
        self.has = np.zeros((j, p))
        self.v = np.tile(np.eye(p), (j, 1, 1))
        for i, rig in enumerate(rigs):
            present = [k for k, name in enumerate(names) if name in rig.names]
            columns = [rig.names.index(names[k]) for k in present]
            self.has[i, present], self.y[i, present] = 1.0, rig.values[columns]
            self.v[i][np.ix_(present, present)] = rig.covariance[np.ix_(columns, columns)]
        variances = np.einsum("jpp->jp", self.v)
        self.scale: Array = np.sqrt(self.has.sum(0) / (self.has / variances).sum(0))
        self.middle = self.has[:, :, None] * self.has[:, None, :]
        # Scaled to values near 1: K_b and a coefficient of 1e-5 are in one matrix.
        self.y = self.y / self.scale
        self.v = np.where(self.middle > 0.0, self.v / np.outer(self.scale, self.scale), self.v)

    def tau(self, u: Array) -> Array:
        """Return tau (w, p) of u (w, p)."""
        return np.asarray(self.scale * u / (1.0 - u), float)

    def _total(self, t: Array) -> tuple[Array, Array]:
        """Return V + T (w, j, p, p) of t = tau/s (w, p), and its inverse, 0 where masked."""
        total = self.v + np.einsum("wp,jp,pq->wjpq", t**2, self.has, np.eye(self.y.shape[1]))
        return total, np.linalg.inv(total) * self.middle

    def log_likelihood(self, u: Array) -> Array:
        """Return the log marginal likelihood (w,) of u (w, p), up to a constant."""
        total, inverse = self._total(u / (1.0 - u))
        a, b = inverse.sum(1), np.einsum("wjpq,jq->wp", inverse, self.y)
        squares = np.einsum("jp,wjpq,jq->w", self.y, inverse, self.y)
        squares -= np.einsum("wp,wp->w", b, np.linalg.solve(a, b[..., None])[..., 0])
        return np.asarray(
            -0.5 * (np.linalg.slogdet(total)[1].sum(1) + np.linalg.slogdet(a)[1] + squares), float
        )

    def drawn(self, tau: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Return draws of the mean (w, p) and the rigs' values (w, j, p), one per tau (w, p)."""
        t = tau / self.scale
        (w, p), j = t.shape, len(self.y)
        _, inverse = self._total(t)
        a, b = inverse.sum(1), np.einsum("wjpq,jq->wp", inverse, self.y)
        root = np.linalg.cholesky(np.linalg.inv(a))
        mean = np.linalg.solve(a, b[..., None])[..., 0]
        mean += np.einsum("wpq,wq->wp", root, rng.standard_normal((w, p)))
        # A prior draw with simulated data, corrected by the difference to the data (Matheron's
        # rule): exact, also at tau = 0.
        rig_values = mean[:, None, :] + t[:, None, :] * rng.standard_normal((w, j, p))
        noise = np.einsum(
            "jpq,wjq->wjp", np.linalg.cholesky(self.v), rng.standard_normal((w, j, p))
        )
        correction = np.einsum("wjpq,wjq->wjp", inverse, self.y - rig_values - noise)
        rig_values += t[:, None, :] ** 2 * correction
        return mean * self.scale, np.where(self.has > 0.0, rig_values * self.scale, np.nan)

    def alike(self, k: int, u: Array) -> float:
        """Return the posterior probability of tau = 0 for parameter k, at prior 0.5.

        Savage-Dickey ratio: posterior density of u at 0 over its prior density of 1, averaged over
        draws (m, p) of the other parameters.
        """
        grid = (np.arange(GRID) + 0.5) / GRID
        density = 0.0
        for row in u:
            rows = np.tile(row, (GRID + 1, 1))
            rows[:, k] = [0.0, *grid]
            log_likelihoods = self.log_likelihood(rows)
            log_density = log_likelihoods[0] - logsumexp(log_likelihoods[1:]) + np.log(GRID)
            density += float(np.exp(log_density)) / len(u)
        return density / (1.0 + density)


def _sample_u(model: _Model, free: list[int], rng: np.random.Generator) -> Array:
    """Return draws (DRAWS, n_free) of u."""
    n = len(free)

    def probability(walkers: Array) -> Array:
        is_inside = np.all((walkers >= 0.0) & (walkers < 1.0), axis=1)
        u = np.zeros((len(walkers), len(model.scale)))
        u[:, free] = np.where(is_inside[:, None], walkers, 0.5)
        return np.where(is_inside, model.log_likelihood(u), -np.inf)

    def propose_uniform(coords: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        return random.uniform(size=coords.shape), np.zeros(len(coords))

    walkers = max(16, 2 * n + 2)
    start = rng.uniform(0.02, 0.98, (ENSEMBLES * walkers, n))
    moves = [(IslandDifference(ENSEMBLES), 0.7), (MHMove(propose_uniform), 0.3)]
    with np.errstate(all="ignore"):
        _, chains, convergence = sample_until_converged(
            probability, start, moves, int(rng.integers(2**32)), MAX_STEPS
        )
    if not convergence.is_converged:
        raise NotConverged(
            f"after {MAX_STEPS} steps the chains of tau do not agree (R-hat "
            f"{np.max(convergence.rhat):.3f}); pool fewer parameters at once with --of"
        )
    draws = chains.reshape(-1, n)
    return draws[rng.integers(len(draws), size=DRAWS)]
