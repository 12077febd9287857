"""Whether chains have converged: autocorrelation time and split R-hat over the ensembles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from emcee.autocorr import integrated_time

from benchtool.core.array import Array

TAU_LENGTHS = 50
"""A chain must be this many autocorrelation times long (emcee's own advice)."""

RHAT_LIMIT = 1.01
"""Largest split R-hat (Vehtari et al., Bayesian Analysis 16, 2021, section 4)."""


@dataclass(frozen=True, slots=True, eq=False)
class Convergence:
    """Hold what the chains say.

    Attributes:
        tau_steps: (n,) integrated autocorrelation time of each parameter.
        rhat: (n,) split R-hat over the ensembles.
        steps: steps after the discarded ones, which both were taken from.
    """

    tau_steps: Array
    rhat: Array
    steps: int

    @property
    def slowest_tau_steps(self) -> float:
        """Largest autocorrelation time; inf when it could not be estimated."""
        largest = float(np.max(self.tau_steps))
        return largest if np.isfinite(largest) else float("inf")

    @property
    def long_enough(self) -> bool:
        """Whether the steps are `TAU_LENGTHS` autocorrelation times."""
        return self.steps >= TAU_LENGTHS * self.slowest_tau_steps

    @property
    def mixed(self) -> bool:
        """Whether the ensembles agree."""
        return bool(np.all(self.rhat < RHAT_LIMIT))

    @property
    def reached(self) -> bool:
        """Whether both tests are met."""
        return self.long_enough and self.mixed


def split_rhat(chains: Array) -> Array:
    """Return split R-hat (n,) of chains (steps, ensembles, walkers, n).

    Each ensemble is cut into an early and a late half, pooled over its walkers: walkers of one
    ensemble move together and are not chains of their own.
    """
    steps, ensembles, walkers, n = chains.shape
    half = steps // 2
    parts = chains[: 2 * half].reshape(2, half, ensembles, walkers, n)
    pooled = parts.transpose(0, 2, 1, 3, 4).reshape(2 * ensembles, half * walkers, n)
    within = pooled.var(axis=1, ddof=1).mean(axis=0)
    between = pooled.mean(axis=1).var(axis=0, ddof=1)
    length = half * walkers
    with np.errstate(all="ignore"):
        rhat: Array = np.sqrt((length - 1.0) / length + between / within)
    return np.where(np.isfinite(rhat), rhat, np.inf)


def convergence_of(chains: Array) -> Convergence:
    """Judge chains (steps, ensembles, walkers, n)."""
    steps, ensembles, walkers, n = chains.shape
    with np.errstate(all="ignore"):
        tau = integrated_time(chains.reshape(steps, ensembles * walkers, n), tol=0, quiet=True)
    usable = np.isfinite(tau) & (tau > 0.0)
    return Convergence(
        tau_steps=np.where(usable, tau, np.inf), rhat=split_rhat(chains), steps=steps
    )
