"""Normal priors as residual rows, for both estimators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchtool.core.error_source import ErrorSource, effective_dof
from benchtool.core.errors import EstimationError
from benchtool.core.parameter import Parameters
from benchtool.core.units import Array


@dataclass(frozen=True, slots=True, eq=False)
class JointPrior:
    """Joint prior on several parameters.

    Attributes:
        parts: error sources of the first parameter, each with its share of the standard deviation
            as columns (1, 1). Their degrees of freedom make the prior normal or Student's t.
    """

    names: tuple[str, ...]  # (p,) full names
    mean: Array  # (p,) in the parameters' units
    covariance: Array  # (p, p) positive definite
    source: str = ""  # provenance (for example a calibration with date)
    parts: tuple[ErrorSource, ...] = ()


@dataclass(frozen=True, eq=False)
class PriorRows:
    """All priors as rows (q,) = matrix (q, n) @ (values - mean).

    Rows have variance one; a row with finite `dof` is Student's t with scale one.
    """

    matrix: Array
    mean: Array
    log_norm: float  # constant of the log density
    parts: tuple[tuple[ErrorSource, ...], ...]  # (q,) error sources of each row; may be empty

    @cached_property
    def dof(self) -> Array:
        """Degrees of freedom of each row's variance (q,)."""
        shares = [np.array([part.columns.item() for part in row]) for row in self.parts]
        dofs = [np.array([part.dof for part in row]) for row in self.parts]
        return np.array([effective_dof(*row) for row in zip(shares, dofs, strict=True)])

    @cached_property
    def estimated(self) -> tuple[Array, ...]:
        """Indices of the rows with finite `dof`, grouped by a common scatter estimate."""
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

    A joint prior is conditioned on the values of its fixed parameters.
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
                f"allowed: variances above 0 and correlations between -1 and 1"
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
    """Return mean and covariance of the free parameters, given the values of the fixed ones."""
    free_index = [prior.names.index(name) for name in free]
    fixed_index = [i for i in range(len(prior.names)) if i not in free_index]
    covariance = prior.covariance
    if not fixed_index:
        return prior.mean[free_index], covariance[np.ix_(free_index, free_index)]
    inverse = np.linalg.inv(covariance[np.ix_(fixed_index, fixed_index)])
    gain = covariance[np.ix_(free_index, fixed_index)] @ inverse
    values = np.array([parameters[prior.names[i]].value for i in fixed_index])
    shift = values - prior.mean[fixed_index]
    return (
        prior.mean[free_index] + gain @ shift,
        covariance[np.ix_(free_index, free_index)]
        - gain @ covariance[np.ix_(fixed_index, free_index)],
    )
