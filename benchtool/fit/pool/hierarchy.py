"""A hierarchical model of several rigs: each rig's own values scatter about a common mean.

    y_i = theta_i + e_i,          e_i ~ N(0, V_i)      what the fit of rig i says, its covariance
    theta_i = mu + d_i,           d_i ~ N(0, diag(tau^2))

(Gelman et al., Bayesian Data Analysis, 3rd ed., 2013, section 5.4, with V_i a matrix.) A shared
parameter has tau = 0. The mean mu has a flat prior. Each tau has that of DuMouchel (1994),
p(tau) = s/(s + tau)^2 with s^2 the harmonic mean of the rigs' own variances: proper for two rigs,
without a unit, its median s. With u = tau/(s + tau) it is flat on 0 to 1; emcee samples u, where
mu and theta are integrated exactly, and these are drawn exactly for each draw of u.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from emcee.moves import MHMove
from scipy.special import logsumexp

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError, NotConverged
from benchtool.core.plural import pluralize
from benchtool.fit.ensemble import ENSEMBLES, build_sampler, sample_until_converged
from benchtool.fit.sampling import IslandDifference

DRAWS = 20_000
MAX_STEPS = 20_000

GRID = 400  # points of u on which its density at 0 is found, of `GRID_MARGIN` draws of the others
GRID_MARGIN = 64

AT_ZERO = 0.02  # an interval of tau that begins within this part of its end begins at 0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RigValues:
    """Hold what a fit says of one rig: a normal approximation of its likelihood.

    Attributes:
        values, covariance: (n,) and (n, n) of the parameters `names`, in their units.
    """

    name: str
    names: tuple[str, ...]
    values: Array
    covariance: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """State one rig's value less another's, both partially pooled.

    Attributes:
        probability: that it has the sign of its mean.
    """

    rig: str
    other: str
    value: float
    sd: float
    interval_95: tuple[float, float]
    probability: float

    @property
    def real(self) -> bool:
        """Whether the 95 % interval leaves 0 out."""
        return self.interval_95[0] > 0.0 or self.interval_95[1] < 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class PooledEstimates:
    """Hold the posterior of several rigs together.

    Attributes:
        shared: (p,) whether a parameter is the same in all rigs.
        scale: (p,) s of the prior of tau.
        tau, mean: (draws, p) between-rig standard deviation, and common mean.
        own: (draws, rigs, p) each rig's value; nan where its fit has none.
        alike: (p,) probability that tau is 0 where that had even odds before; nan of a shared one.
    """

    rigs: tuple[RigValues, ...]
    names: tuple[str, ...]
    shared: tuple[bool, ...]
    scale: Array
    tau: Array
    mean: Array
    own: Array
    alike: Array

    def values_of(self, name: str) -> list[tuple[int, float, float]]:
        """Return place, value and standard deviation of each rig that has a parameter, unpooled."""
        found = []
        for place, rig in enumerate(self.rigs):
            if name in rig.names:
                k = rig.names.index(name)
                found.append((place, float(rig.values[k]), float(rig.covariance[k, k] ** 0.5)))
        return found

    def tau_95(self, name: str) -> tuple[float, float]:
        """Return the shortest interval that holds 95 % of tau."""
        draws = np.sort(self.tau[:, self.names.index(name)])
        held = int(np.ceil(0.95 * len(draws)))
        begin = int(np.argmin(draws[held - 1 :] - draws[: len(draws) - held + 1]))
        low, high = draws[begin], draws[begin + held - 1]
        return (0.0, float(draws[held - 1])) if low < AT_ZERO * high else (float(low), float(high))

    @cached_property
    def differences(self) -> dict[str, tuple[Difference, ...]]:
        """Differences of all pairs of rigs by parameter, the surest first; none of a shared one."""
        found = {}
        for k, name in enumerate(self.names):
            if self.shared[k]:
                continue
            pairs = combinations([place for place, *_ in self.values_of(name)], 2)
            every = [self._difference(k, one, other) for one, other in pairs]
            found[name] = tuple(sorted(every, key=lambda one: -abs(one.value) / one.sd))
        return found

    def _difference(self, k: int, one: int, other: int) -> Difference:
        draws = self.own[:, one, k] - self.own[:, other, k]
        low, high = np.quantile(draws, [0.025, 0.975])
        above = float(np.mean(draws > 0.0))
        return Difference(
            rig=self.rigs[one].name,
            other=self.rigs[other].name,
            value=float(draws.mean()),
            sd=float(draws.std()),
            interval_95=(float(low), float(high)),
            probability=max(above, 1.0 - above),
        )


def pool_rigs(
    rigs: Sequence[RigValues],
    names: Sequence[str],
    shared: Sequence[str] = (),
    *,
    seed: int = 1,
) -> PooledEstimates:
    """Return the posterior of several rigs together.

    Args:
        rigs: two or more; each parameter is in two of them at least.

    Raises:
        InputError: too few rigs.
        NotConverged: the chains of tau do not agree.
    """
    for name in names:
        have = [rig.name for rig in rigs if name in rig.names]
        if len(have) < 2:
            raise InputError(
                f"{name} is in {pluralize(len(have), 'fit')} of {len(rigs)}; pooling needs 2 or "
                "more"
            )
    model = _Model(rigs, names)
    free = [k for k, name in enumerate(names) if name not in shared]
    rng = np.random.default_rng(seed)
    u = np.zeros((DRAWS, len(names)))
    if free:
        u[:, free] = _sampled(model, free, rng)
    tau = model.tau(u)
    mean, own = model.drawn(tau, rng)
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
        own=own,
        alike=alike,
    )


class _Model:
    """Arrays of all rigs: what a fit does not have is masked."""

    def __init__(self, rigs: Sequence[RigValues], names: Sequence[str]) -> None:
        j, p = len(rigs), len(names)
        self.y = np.zeros((j, p))
        self.has = np.zeros((j, p))
        self.v = np.tile(np.eye(p), (j, 1, 1))
        for i, rig in enumerate(rigs):
            here = [k for k, name in enumerate(names) if name in rig.names]
            there = [rig.names.index(names[k]) for k in here]
            self.has[i, here], self.y[i, here] = 1.0, rig.values[there]
            self.v[i][np.ix_(here, here)] = rig.covariance[np.ix_(there, there)]
        variances = np.einsum("jpp->jp", self.v)
        self.scale: Array = np.sqrt(self.has.sum(0) / (self.has / variances).sum(0))
        self.middle = self.has[:, :, None] * self.has[:, None, :]
        # Numbers near 1: K_b and a coefficient of 1e-5 stand in one matrix.
        self.y = self.y / self.scale
        self.v = np.where(self.middle > 0.0, self.v / np.outer(self.scale, self.scale), self.v)

    def tau(self, u: Array) -> Array:
        """Return tau (w, p) of u (w, p)."""
        return np.asarray(self.scale * u / (1.0 - u), float)

    def _total(self, t: Array) -> tuple[Array, Array]:
        """Return V + T (w, j, p, p) of t = tau/s (w, p), and its inverse, 0 where nothing is."""
        total = self.v + np.einsum("wp,jp,pq->wjpq", t**2, self.has, np.eye(self.y.shape[1]))
        return total, np.linalg.inv(total) * self.middle

    def log_likelihood(self, u: Array) -> Array:
        """Return the log likelihood (w,) of u (w, p) up to a constant, mean and rigs integrated."""
        total, inverse = self._total(u / (1.0 - u))
        a, b = inverse.sum(1), np.einsum("wjpq,jq->wp", inverse, self.y)
        squares = np.einsum("jp,wjpq,jq->w", self.y, inverse, self.y)
        squares -= np.einsum("wp,wp->w", b, np.linalg.solve(a, b[..., None])[..., 0])
        return np.asarray(
            -0.5 * (np.linalg.slogdet(total)[1].sum(1) + np.linalg.slogdet(a)[1] + squares), float
        )

    def drawn(self, tau: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Return the mean (w, p) and each rig's values (w, j, p), one draw for each tau (w, p)."""
        t = tau / self.scale
        (w, p), j = t.shape, len(self.y)
        _, inverse = self._total(t)
        a, b = inverse.sum(1), np.einsum("wjpq,jq->wp", inverse, self.y)
        root = np.linalg.cholesky(np.linalg.inv(a))
        mean = np.linalg.solve(a, b[..., None])[..., 0]
        mean += np.einsum("wpq,wq->wp", root, rng.standard_normal((w, p)))
        # A draw of the prior with data of its own, corrected by how far those are from the data
        # (Matheron's rule): exact, and exact at tau = 0 too.
        own = mean[:, None, :] + t[:, None, :] * rng.standard_normal((w, j, p))
        noise = np.einsum(
            "jpq,wjq->wjp", np.linalg.cholesky(self.v), rng.standard_normal((w, j, p))
        )
        off = np.einsum("wjpq,wjq->wjp", inverse, self.y - own - noise)
        own += t[:, None, :] ** 2 * off
        return mean * self.scale, np.where(self.has > 0.0, own * self.scale, np.nan)

    def alike(self, k: int, u: Array) -> float:
        """Return the probability that tau of parameter k is 0, at even odds before.

        Savage-Dickey: the posterior density of u at 0 over its prior density, which is 1; averaged
        over draws (m, p) of the others.
        """
        grid = (np.arange(GRID) + 0.5) / GRID
        density = 0.0
        for row in u:
            at = np.tile(row, (GRID + 1, 1))
            at[:, k] = [0.0, *grid]
            found = self.log_likelihood(at)
            density += float(np.exp(found[0] - logsumexp(found[1:]) + np.log(GRID))) / len(u)
        return density / (1.0 + density)


def _sampled(model: _Model, free: list[int], rng: np.random.Generator) -> Array:
    """Return draws (DRAWS, n_free) of u."""
    n = len(free)

    def probability(walkers: Array) -> Array:
        inside = np.all((walkers >= 0.0) & (walkers < 1.0), axis=1)
        u = np.zeros((len(walkers), len(model.scale)))
        u[:, free] = np.where(inside[:, None], walkers, 0.5)
        return np.where(inside, model.log_likelihood(u), -np.inf)

    def anywhere(coords: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        return random.uniform(size=coords.shape), np.zeros(len(coords))

    walkers = max(16, 2 * n + 2)
    start = rng.uniform(0.02, 0.98, (ENSEMBLES * walkers, n))
    moves = [(IslandDifference(ENSEMBLES), 0.7), (MHMove(anywhere), 0.3)]
    with np.errstate(all="ignore"):
        sampler = build_sampler(probability, start, moves, int(rng.integers(2**32)))
        agreed = sample_until_converged(
            sampler, start, walkers, MAX_STEPS, lambda done, expected: None
        )
        chains, verdict = agreed
    if not verdict.reached:
        raise NotConverged(
            f"after {MAX_STEPS} steps the chains of tau do not agree (R-hat "
            f"{np.max(verdict.rhat):.3f}); pool fewer parameters at once with --of"
        )
    draws = chains.reshape(-1, n)
    return draws[rng.integers(len(draws), size=DRAWS)]
