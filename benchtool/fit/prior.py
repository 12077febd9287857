"""Normal priors as residual rows, so that one formula serves both estimators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.error_source import ErrorSource, effective_dof
from benchtool.core.errors import EstimationError
from benchtool.core.parameter import Parameters


@dataclass(frozen=True, slots=True, eq=False)
class JointPrior:
    """State a prior on several parameters at once, with their covariance.

    Attributes:
        parts: sources of the first one's standard deviation, each with its share of it as columns
            (1, 1); by their degrees of freedom the prior is normal or Student's t.
    """

    names: tuple[str, ...]  # (p,) full names
    mean: Array  # (p,) in the parameters' units
    covariance: Array  # (p, p) positive definite
    source: str = ""  # where it comes from (a calibration, by its date)
    parts: tuple[ErrorSource, ...] = ()


@dataclass(frozen=True, eq=False)
class PriorRows:
    """Hold all priors as rows (q,) = matrix (q, n) @ (values - mean).

    Each row has variance one, or the scale of a Student's t where its `dof` are finite.
    `log_norm` is the constant of the log density.
    """

    matrix: Array
    mean: Array
    log_norm: float
    parts: tuple[tuple[ErrorSource, ...], ...]  # (q,) sources of each row; none where it is one

    @cached_property
    def dof(self) -> Array:
        """Degrees of freedom of each row's variance (q,)."""
        shares = [np.array([part.columns.item() for part in row]) for row in self.parts]
        known = [np.array([part.dof for part in row]) for row in self.parts]
        return np.array([effective_dof(*row) for row in zip(shares, known, strict=True)])

    @cached_property
    def estimated(self) -> tuple[Array, ...]:
        """Numbers of the rows of finite `dof`, together where one scatter made their variances."""
        groups: dict[str, list[int]] = {}
        for row in np.flatnonzero(np.isfinite(self.dof)):
            name = next((part.scatter for part in self.parts[row] if part.scatter), f"row {row}")
            groups.setdefault(name, []).append(int(row))
        return tuple(np.array(rows) for rows in groups.values())

    def __len__(self) -> int:
        return int(self.matrix.shape[0])


def prior_rows(
    parameters: Parameters, names: Sequence[str], joint: Sequence[JointPrior]
) -> PriorRows:
    """Return the rows of all normal priors on the free parameters `names` (n,).

    A joint prior speaks for the free ones among its names; fixed ones keep their value, and the
    rest is conditioned on it.
    """
    n = len(names)
    mean = np.zeros(n)
    rows: list[Array] = []
    parts: list[tuple[ErrorSource, ...]] = []
    log_norm = 0.0
    taken: set[str] = set()
    for prior in joint:
        free = [name for name in prior.names if name in names]
        taken.update(free)
        if not free:
            continue
        block_mean, covariance = _conditioned(prior, free, parameters)
        try:
            root = np.linalg.cholesky(covariance)
        except np.linalg.LinAlgError as cause:
            raise EstimationError(
                f"the prior covariance of {', '.join(prior.names)} is not positive definite; "
                f"give variances above 0 and correlations between -1 and 1"
            ) from cause
        block = np.zeros((len(free), n))
        columns = [names.index(name) for name in free]
        block[:, columns] = np.linalg.inv(root)
        mean[columns] = block_mean
        rows.extend(block)
        parts += [prior.parts if name == prior.names[0] else () for name in free]
        log_norm -= float(np.log(np.diag(root)).sum())
    for position, name in enumerate(names):
        single = parameters[name].prior
        if single.kind == "normal" and name not in taken:
            row = np.zeros(n)
            row[position] = 1.0 / single.sd
            mean[position] = single.mean
            rows.append(row)
            parts.append(())
            log_norm -= float(np.log(single.sd))
    matrix = np.array(rows) if rows else np.empty((0, n))
    log_norm -= 0.5 * len(rows) * float(np.log(2.0 * np.pi))
    return PriorRows(matrix, mean, log_norm, tuple(parts))


def _conditioned(
    prior: JointPrior, free: Sequence[str], parameters: Parameters
) -> tuple[Array, Array]:
    """Return mean and covariance of the free ones, given the values of the fixed ones."""
    keep = [prior.names.index(name) for name in free]
    held = [i for i in range(len(prior.names)) if i not in keep]
    covariance = prior.covariance
    if not held:
        return prior.mean[keep], covariance[np.ix_(keep, keep)]
    gain = covariance[np.ix_(keep, held)] @ np.linalg.inv(covariance[np.ix_(held, held)])
    shift = np.array([parameters[prior.names[i]].value for i in held]) - prior.mean[held]
    return (
        prior.mean[keep] + gain @ shift,
        covariance[np.ix_(keep, keep)] - gain @ covariance[np.ix_(held, keep)],
    )
