"""Normal priors as residual rows, for both estimators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.error_source import ErrorSource, effective_dof
from benchtool.core.parameter import Parameters


@dataclass(frozen=True, eq=False)
class PriorRows:
    """All priors as rows (q,) = matrix (q, n) @ (values - mean).

    Rows have variance one; a row with finite `dof` is Student's t with scale one.
    """

    names: tuple[str, ...]  # (q,) parameter of each row
    matrix: Array
    mean: Array
    parts: tuple[tuple[ErrorSource, ...], ...]  # (q,) error sources of each row

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
        return len(self.names)


def prior_rows(
    parameters: Parameters, free: Sequence[str], parts: Mapping[str, tuple[ErrorSource, ...]]
) -> PriorRows:
    """Return the rows of all normal priors on the free parameters (n,).

    Args:
        parts: error sources of priors by parameter; see `Problem`.
    """
    names = [name for name in free if parameters[name].prior.kind == "normal"]
    names.sort(key=lambda name: not name.startswith("calibration."))
    matrix, mean = np.zeros((len(names), len(free))), np.zeros(len(free))
    all_parts = []
    for row, name in enumerate(names):
        position, prior = free.index(name), parameters[name].prior
        matrix[row, position], mean[position] = 1.0 / prior.sd, prior.mean
        source = ErrorSource(
            name=name, kind="B", unit=parameters[name].unit, sd=1.0 / float(matrix[row, position]),
            columns=np.eye(1), origin=prior.source or "prior of the model",
        )  # fmt: skip
        all_parts.append(parts.get(name) or (source,))
    return PriorRows(tuple(names), matrix, mean, tuple(all_parts))
