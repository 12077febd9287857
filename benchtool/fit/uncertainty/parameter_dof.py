"""Degrees of freedom of each fitted parameter, by the sources of its error."""

from __future__ import annotations

import numpy as np

from benchtool.core.array import Array
from benchtool.core.error_source import Whitening, effective_dof
from benchtool.fit.problem import Problem


def parameter_dof(
    problem: Problem, jacobian: Array, covariance: Array, whitening: Whitening
) -> Array:
    """Return the effective degrees of freedom (n_shape,) of shape parameters; inf where stated.

    Points count with those that a free noise parameter leaves, shared errors and priors with
    their own (Welch-Satterthwaite, GUM G.2b).

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
        return np.full(len(covariance), base)
    known = np.where(np.isfinite(covariance), covariance, 0.0)  # others have no interval
    m, gain = len(problem), known @ jacobian.T
    sd = [np.linalg.norm(gain[:, :m] @ whitening(one.columns), axis=1) for one in sources]
    sd += [np.abs(gain[:, m + row]) for row in rows]
    rest = np.sqrt(np.maximum(np.diag(known) - np.sum(np.square(sd), axis=0), 0.0))
    dof = np.array([*(one.dof for one in sources), *priors.dof[rows], base])
    return np.array([effective_dof(column, dof) for column in np.array([*sd, rest]).T])
