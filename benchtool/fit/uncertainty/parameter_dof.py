"""Degrees of freedom of each fitted parameter, by the sources of its error."""

from __future__ import annotations

import numpy as np

from benchtool.core.error_source import Whitening, effective_dof
from benchtool.core.units import Array
from benchtool.fit.problem import Problem


def parameter_dof(
    problem: Problem, jacobian: Array, covariance: Array, whitening: Whitening
) -> tuple[Array, Array]:
    """Return effective degrees of freedom and a factor on standard deviations (n_shape,) each.

    Welch-Satterthwaite (GUM G.2b): points have the dof of a free noise parameter, shared errors and
    priors their own; inf for stated errors. Competing priors of few dof (two load cells calibrated
    with five masses each) are weighted by estimated variances, which the covariance neglects. The
    factor corrects this (Kackar and Harville, J. Am. Stat. Assoc. 79 (1984) 853; for a weighted
    mean Meier, Biometrics 9 (1953) 59); it is 1 for a prior without competitor.

    Args:
        jacobian: (m + q, n_shape) of the whitened rows.
        covariance: (n_shape, n_shape) from the Jacobian.
    """
    base = np.inf if problem.noise_name is None else float(problem.dof)
    sources = [s for s in problem.error_sources if np.isfinite(s.dof) and not s.scaled]
    priors = problem.priors
    groups = priors.estimated
    if not sources and not groups:
        return np.full(len(covariance), base), np.ones(len(covariance))
    finite = np.where(np.isfinite(covariance), covariance, 0.0)  # infinite: no interval
    m, gain = len(problem), finite @ jacobian.T
    sd = [np.linalg.norm(gain[:, :m] @ whitening(source.columns), axis=1) for source in sources]
    for row in (row for rows in groups for row in rows):
        sources += priors.parts[row]
        sd += [np.abs(gain[:, m + row]) * source.columns.item() for source in priors.parts[row]]
    remaining_sd = np.sqrt(np.maximum(np.diag(finite) - np.sum(np.square(sd), axis=0), 0.0))
    dof = np.array([*(source.dof for source in sources), base])
    scatters = [*(source.scatter for source in sources), ""]
    effective = [effective_dof(parts, dof, scatters) for parts in np.array([*sd, remaining_sd]).T]
    variance, growth = np.diag(finite), np.ones(len(finite))
    for rows in groups:
        gains = gain[:, m + rows]
        residual_covariance = np.eye(len(rows)) - jacobian[m + rows] @ gains
        excess = np.maximum(np.einsum("nq,qp,np->n", gains, residual_covariance, gains), 0.0)
        share = np.divide(excess, variance, np.zeros(len(finite)), where=variance > 0)
        growth += 4.0 / priors.dof[rows[0]] * share
    return np.array(effective), np.sqrt(growth)
