"""Identifiability: separation of the parameters of one fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.core.fit_result import FitResult
from benchtool.core.units import Array
from benchtool.fit.problem import Problem
from benchtool.fit.solve import PART, derivative_method, estimate_covariance, row_jacobian
from benchtool.physics.catalogue import EFFECTS

INFLATION = 5.0  # minimum ratio of sd with others free and fixed (a pair: correlation 0.98)
MIN_COMPONENT = 0.25  # minimum scaled component of a parameter in a confused direction
MIN_RELATIVE_SD = 0.1  # minimum reported sd relative to a value without tolerance
BASELINE: dict[frozenset[str], str] = {  # remedies for pairs without an effect
    frozenset({"k", "R_m"}): "reference points without the plate",
    frozenset({"k", "calibration.scale"}): "with a better calibration of the load cell",
}


def separating_measurement() -> dict[frozenset[str], str]:
    """Return the remedy that separates each pair of parameters, from the effect definitions."""
    return {
        frozenset({f"{effect.name}.{effect.parameters[0].name}", other}): text
        for effect in EFFECTS.values()
        for other, text in effect.separated_by.items()
    } | BASELINE


@dataclass(frozen=True, slots=True)
class Confusion:
    """Parameters that the data cannot separate."""

    names: tuple[str, ...]  # most involved first; a single one is undetermined
    inflation: float  # ratio of their sd to the sd with the others known
    open_directions: int  # number of undetermined combinations; 0 for none
    remedy: str  # measurement that would separate them

    def __str__(self) -> str:
        """Return one sentence with the remedy."""
        if len(self.names) == 1:
            return f"these data do not determine {self.names[0]}; fix it, or {self.remedy}"
        listed = " and ".join([", ".join(self.names[:-1]), self.names[-1]])
        if not self.open_directions:
            return (
                f"{listed} can hardly be separated (uncertainty {self.inflation:.0f} times larger "
                f"than with the others known); fix one, or {self.remedy}"
            )
        n_determined = len(self.names) - self.open_directions
        return (
            f"{listed} cannot be separated by these data, which determine only {n_determined} "
            f"combination{'s' if n_determined > 1 else ''} of these {len(self.names)}; fix "
            f"{self.open_directions}, or {self.remedy}"
        )


def confusions(problem: Problem, result: FitResult) -> tuple[Confusion, ...]:
    """Return confused parameters of a result, the worst first."""
    shape, noise = problem.split(result.values)
    with np.errstate(all="ignore"):
        method = derivative_method(problem, shape)
        jacobian = row_jacobian(problem, method, shape, problem.whitening(noise))
    names = problem.shape_names
    estimate = estimate_covariance(jacobian, method)
    if estimate.undetermined:
        return _undetermined_groups(names, estimate.directions)
    confused: list[Confusion] = []
    norms = np.linalg.norm(jacobian, axis=0)
    inflation = np.sqrt(np.diag(estimate.covariance)) * norms
    _, singular, directions = np.linalg.svd(jacobian / norms, full_matrices=False)
    for direction in directions[singular < 1.0 / INFLATION][::-1]:  # the weakest first
        involved = np.abs(direction) > MIN_COMPONENT
        worst = float(inflation[involved].max())
        if worst >= INFLATION and _matters(problem, result, names, involved):
            confused.append(_build_confusion(names, np.abs(direction), worst))
    return tuple(confused)


def _matters(
    problem: Problem, result: FitResult, names: tuple[str, ...], involved: NDArray[np.bool_]
) -> bool:
    for name in np.array(names)[involved]:
        parameter, estimate = problem.parameters[str(name)], result[str(name)]
        limit = parameter.tolerance
        if estimate.sd > (MIN_RELATIVE_SD * abs(estimate.value) if limit is None else limit):
            return True
    return False


def _undetermined_groups(names: tuple[str, ...], directions: Array) -> tuple[Confusion, ...]:
    """Return one confusion for each set of parameters that share undetermined directions (k, n)."""
    remaining = [np.abs(direction) * (np.abs(direction) > PART) for direction in directions]
    groups = []
    while remaining:
        union, count = remaining.pop(), 1
        while True:
            hits = [i for i, other in enumerate(remaining) if np.any((other > 0) & (union > 0))]
            if not hits:
                break
            union, count = union + remaining.pop(hits[0]), count + 1
        groups.append(_build_confusion(names, union, np.inf, count))
    return tuple(groups)


def _build_confusion(
    names: tuple[str, ...], involvement: Array, inflation: float, open_directions: int = 0
) -> Confusion:
    limit = 0.0 if open_directions else MIN_COMPONENT
    order = np.argsort(-involvement)
    involved = tuple(names[i] for i in order if involvement[i] > limit)
    remedies = [text for pair, text in separating_measurement().items() if pair <= set(involved)]
    if remedies:
        remedy = f"measure {'; '.join(dict.fromkeys(remedies))}"
    elif len(involved) == 1:
        remedy = "measure where it acts"
    else:
        remedy = "measure at further plate distances and throttle levels, or state a prior"
    return Confusion(involved, inflation, open_directions, remedy)
