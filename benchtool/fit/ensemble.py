"""Posterior sampling with emcee: four ensembles, run until they agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from emcee import EnsembleSampler
from emcee.autocorr import integrated_time

from benchtool.core.errors import EstimationError, InputError
from benchtool.core.fit_result import FitResult, Outcome
from benchtool.core.parameter import Parameter
from benchtool.core.units import Array
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.problem import Problem
from benchtool.fit.sampling import (
    IslandDifference,
    log_probability,
    proposal_around_least_squares,
    start_walkers,
)
from benchtool.fit.statistics import from_draws

Progress = Callable[[int, int], None]  # progress(steps done, steps expected)
ENSEMBLES = 4
FIRST_STEPS = 400
REPORT_EVERY = 100
BURN_IN_SHARE = 0.25  # share of the steps discarded as burn-in

MAX_DRAWS = 20_000

BOUND_REACH, BOUND_SHARE = 0.1, 0.01  # at bound: this share of draws is within BOUND_REACH sd


def fit_ensemble(
    problem: Problem,
    *,
    walkers: int = 32,
    max_steps: int = 20_000,
    seed: int = 1,
    progress: Progress = lambda done, expected: None,
) -> FitResult:
    """Sample the posterior until four independently started ensembles agree.

    The number of steps follows from the autocorrelation time. The outcome `not_converged` contains
    a remedy. Samples (n_samples, n_free) are ordered by step, then ensemble, then walker, so that
    they reshape to (-1, facts["ensembles"], facts["walkers"], n_free).
    """
    n_free = len(problem.free_names)
    if walkers % 2 or walkers < 2 * n_free + 2:
        raise InputError(
            f"{walkers} walkers are invalid for {n_free} free parameters; allowed: even numbers "
            f"from {2 * n_free + 2}"
        )
    rng = np.random.default_rng(seed)
    try:
        least_squares = fit_least_squares(problem)
    except EstimationError:
        least_squares = None
    probability = log_probability(problem)
    with np.errstate(all="ignore"):
        start = start_walkers(problem, least_squares, probability, ENSEMBLES, walkers, rng)
        moves = [
            (IslandDifference(ENSEMBLES), 0.5),
            (proposal_around_least_squares(problem, least_squares), 0.5),
        ]
        seed_of_moves = int(rng.integers(2**32))
        sampler, chains, convergence = sample_until_converged(
            probability, start, moves, seed_of_moves, max_steps, progress
        )
        best = sampler.get_chain(flat=True)[int(np.argmax(sampler.get_log_prob(flat=True)))]
        if least_squares is not None and np.all(np.isfinite(least_squares.values)):
            maximum = probability(least_squares.values[None, :])[0]
            if maximum >= np.max(sampler.get_log_prob(flat=True)):
                best = least_squares.values
    tau = convergence.slowest_tau_steps
    thin = max(1, int(tau / 5.0) if np.isfinite(tau) else 1)
    draws = chains[::thin].reshape(-1, n_free)
    stride = max(thin, -(-chains.shape[0] * len(start) // MAX_DRAWS))
    estimates, warnings = [], []
    for name, column in zip(problem.free_names, draws.T, strict=True):
        parameter = problem.parameters[name]
        side, end = _reached_bound(parameter, column)
        bound = f"reaches its {side} bound" if side else ""
        estimates.append(from_draws(name, parameter, column, bound))
        if side:
            warnings.append(
                f"the posterior of {name} {bound} {f'{end:g} {parameter.unit}'.removesuffix(' 1')} "
                f"and is truncated, which biases other estimates: widen the bound or fix the "
                f"parameter"
            )
    chi2, log_likelihood = problem.quality(best)
    steps = int(sampler.iteration)
    return FitResult(
        method="emcee",
        basis=problem.basis,
        model=problem.model,
        estimates=tuple(estimates),
        covariance=np.atleast_2d(np.cov(draws, rowvar=False)),
        chi2=chi2,
        dof=problem.dof,
        log_likelihood=log_likelihood,
        outcome=_outcome(problem, convergence, steps, max_steps, steps * len(start)),
        warnings=tuple(warnings),
        samples=np.ascontiguousarray(chains[::stride].reshape(-1, n_free)),
        facts={
            **problem.facts,
            "points": len(problem),
            "prior_rows": len(problem.priors),
            "seed": seed,
            "ensembles": ENSEMBLES,
            "walkers": walkers,
            "steps": steps,
            "steps_kept": convergence.steps,
            "tau_steps": tau,
            "rhat": float(np.max(convergence.rhat)),
            "acceptance": float(np.mean(sampler.acceptance_fraction)),
        },
    )


def sample_until_converged(
    probability: Callable[[Array], Array],
    start: Array,
    moves: Any,
    seed: int,
    max_steps: int,
    progress: Progress = lambda done, expected: None,
) -> tuple[Any, Array, Convergence]:
    """Return emcee's sampler, the chains after burn-in, and their convergence at the last step.

    Initial positions are (ensembles * walkers, n), chains (steps, ensembles, walkers, n).
    """
    sampler: Any = EnsembleSampler(*start.shape, probability, moves=moves, vectorize=True)
    sampler.random_state = np.random.MT19937(seed).state
    done, target = 0, min(FIRST_STEPS, max_steps)
    state: Any = start
    while True:
        steps = sampler.sample(state, iterations=target - done, skip_initial_state_check=True)
        for step, latest in enumerate(steps, 1):
            state = latest
            if step % REPORT_EVERY == 0:
                progress(done + step, target)
        done = target
        chain = sampler.get_chain()[int(BURN_IN_SHARE * done) :]
        chains = chain.reshape(chain.shape[0], ENSEMBLES, -1, chain.shape[2])
        convergence = check_convergence(chains)
        if convergence.is_converged or done >= max_steps:
            return sampler, chains, convergence
        needed_steps = 1.05 * TAU_LENGTHS / (1.0 - BURN_IN_SHARE) * convergence.slowest_tau_steps
        target = int(min(max(needed_steps, 1.3 * done), max_steps, 4.0 * done))


def _reached_bound(parameter: Parameter, draws: Array) -> tuple[str, float]:
    """Return side and value of the bound where a posterior (n,) accumulates; "" without one."""
    margin = BOUND_REACH * float(np.std(draws))
    for side, bound in (("lower", parameter.lower), ("upper", parameter.upper)):
        if np.mean(np.abs(draws - bound) < margin) > BOUND_SHARE:
            return side, bound
    return "", np.nan


def _outcome(
    problem: Problem, convergence: Convergence, steps: int, max_steps: int, evaluations: int
) -> Outcome:
    if convergence.is_converged:
        return Outcome(
            "converged",
            f"{ENSEMBLES} ensembles agree (R-hat {np.max(convergence.rhat):.4f}) over "
            f"{convergence.steps} steps; autocorrelation time: "
            f"{convergence.slowest_tau_steps:.0f} steps",
            evaluations,
        )
    worst = problem.free_names[int(np.argmax(convergence.rhat))]
    if not convergence.is_mixed:
        reason = (
            f"after {steps} steps the ensembles still disagree about {worst} (R-hat "
            f"{np.max(convergence.rhat):.3f}, limit {RHAT_LIMIT})"
        )
    else:
        slowest = problem.free_names[int(np.argmax(convergence.tau_steps))]
        reason = (
            f"{convergence.steps} steps after burn-in are "
            f"{convergence.steps / convergence.slowest_tau_steps:.0f} autocorrelation times of "
            f"{slowest}; minimum: {TAU_LENGTHS}"
        )
    return Outcome(
        "not_converged",
        f"{reason}; allow more than {max_steps} steps, or fix a parameter or state a prior for "
        f"parameters that least squares reports as inseparable",
        evaluations,
    )


TAU_LENGTHS = 50  # minimum chain length in autocorrelation times (recommended by emcee)
RHAT_LIMIT = 1.01  # largest split R-hat (Vehtari et al., Bayesian Analysis 16, 2021, section 4)


@dataclass(frozen=True, slots=True, eq=False)
class Convergence:
    """Convergence diagnostics of chains."""

    tau_steps: Array  # (n,) integrated autocorrelation time of each parameter
    rhat: Array  # (n,) split R-hat over the ensembles
    steps: int  # steps after burn-in

    @property
    def slowest_tau_steps(self) -> float:
        """Largest autocorrelation time; inf when it could not be estimated."""
        return float(np.max(self.tau_steps))

    @property
    def is_mixed(self) -> bool:
        """True if the ensembles agree."""
        return bool(np.all(self.rhat < RHAT_LIMIT))

    @property
    def is_converged(self) -> bool:
        """True if the ensembles agree over `TAU_LENGTHS` autocorrelation times."""
        return self.is_mixed and self.steps >= TAU_LENGTHS * self.slowest_tau_steps


def split_rhat(chains: Array) -> Array:
    """Return split R-hat (n,) of chains (steps, ensembles, walkers, n).

    Each ensemble is split into an early and a late half, pooled over its walkers: the walkers of an
    ensemble are not independent chains.
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


def check_convergence(chains: Array) -> Convergence:
    """Return convergence diagnostics of chains (steps, ensembles, walkers, n)."""
    steps, ensembles, walkers, n = chains.shape
    with np.errstate(all="ignore"):
        tau = integrated_time(chains.reshape(steps, ensembles * walkers, n), tol=0, quiet=True)
    usable = np.isfinite(tau) & (tau > 0.0)
    return Convergence(
        tau_steps=np.where(usable, tau, np.inf), rhat=split_rhat(chains), steps=steps
    )
