"""Degrees of freedom of each fitted parameter, by the sources of its error."""

from __future__ import annotations

import numpy as np

from benchtool.core.array_type import Array
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
    """
    base = np.inf if problem.noise_name is None else float(problem.dof)
    sources = [one for one in problem.error_sources if np.isfinite(one.dof) and not one.scaled]
    priors = problem.priors
    groups = priors.estimated
    if not sources and not groups:
        return np.full(len(covariance), base), np.ones(len(covariance))
    known = np.where(np.isfinite(covariance), covariance, 0.0)  # others have no interval
    m, gain = len(problem), known @ jacobian.T
    sd = [np.linalg.norm(gain[:, :m] @ whitening(one.columns), axis=1) for one in sources]
    for row in (row for rows in groups for row in rows):
        sources += priors.parts[row]
        sd += [np.abs(gain[:, m + row]) * one.columns.item() for one in priors.parts[row]]
    rest = np.sqrt(np.maximum(np.diag(known) - np.sum(np.square(sd), axis=0), 0.0))
    dof = np.array([*(one.dof for one in sources), base])
    scatters = [*(one.scatter for one in sources), ""]
    effective = [effective_dof(one, dof, scatters) for one in np.array([*sd, rest]).T]
    variance, growth = np.diag(known), np.ones(len(known))
    for rows in groups:
        of_rows = gain[:, m + rows]
        left = np.eye(len(rows)) - jacobian[m + rows] @ of_rows  # covariance of their residuals
        moved = np.maximum(np.einsum("nq,qp,np->n", of_rows, left, of_rows), 0.0)
        share = np.divide(moved, variance, np.zeros(len(known)), where=variance > 0)
        growth += 4.0 / priors.dof[rows[0]] * share
    return np.array(effective), np.sqrt(growth)
