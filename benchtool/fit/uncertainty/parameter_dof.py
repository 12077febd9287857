"""Degrees of freedom of each fitted parameter, by the sources of its error."""

from __future__ import annotations

import numpy as np

from benchtool.core.array import Array
from benchtool.core.error_source import Whitening, effective_dof
from benchtool.fit.problem import Problem


def parameter_dof(
    problem: Problem, jacobian: Array, covariance: Array, whitening: Whitening
) -> tuple[Array, Array]:
    """Return the effective degrees of freedom (n_shape,) of shape parameters, and what widens them.

    Points count with those that a free noise parameter leaves, shared errors and priors with
    their own (Welch-Satterthwaite, GUM G.2b); inf where errors are stated. Priors of few degrees
    of freedom that compete (two load cells, each known by five masses) are weighted by variances
    that are estimates themselves, which the covariance does not know: the factor on standard
    deviations is that of Kackar and Harville, J. Am. Stat. Assoc. 79 (1984) 853; for a weighted
    mean Meier, Biometrics 9 (1953) 59. It is 1 where a prior has no rival.

    Args:
        jacobian: (m + q, n_shape) of the whitened rows.
        covariance: (n_shape, n_shape) that it makes.
        whitening: that it was whitened with.
    """
    base = np.inf if problem.noise_name is None else float(problem.dof)
    sources = [one for one in problem.error_sources if np.isfinite(one.dof) and not one.scaled]
    priors = problem.priors
    rows = np.flatnonzero(np.isfinite(priors.dof))
    if not sources and not len(rows):
        return np.full(len(covariance), base), np.ones(len(covariance))
    known = np.where(np.isfinite(covariance), covariance, 0.0)  # others have no interval
    m, gain = len(problem), known @ jacobian.T
    sd = [np.linalg.norm(gain[:, :m] @ whitening(one.columns), axis=1) for one in sources]
    sd += [np.abs(gain[:, m + row]) for row in rows]
    rest = np.sqrt(np.maximum(np.diag(known) - np.sum(np.square(sd), axis=0), 0.0))
    dof = np.array([*(one.dof for one in sources), *priors.dof[rows], base])
    effective = np.array([effective_dof(column, dof) for column in np.array([*sd, rest]).T])
    variance, growth = np.diag(known), np.ones(len(known))
    for row in rows:
        left = 1.0 - float(jacobian[m + row] @ gain[:, m + row])  # variance of its own residual
        share = np.divide(gain[:, m + row] ** 2, variance, np.zeros(len(known)), where=variance > 0)
        growth += 4.0 / priors.dof[row] * max(left, 0.0) * share
    return effective, np.sqrt(growth)
