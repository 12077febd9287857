"""What data can separate: parameters of one fit, and a model from its rival."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky
from scipy.optimize import lsq_linear

from benchtool.core.array_type import Array
from benchtool.core.fit_result import FitResult
from benchtool.fit.jacobian import PART, select_method, spread_of
from benchtool.fit.problem import Problem
from benchtool.fit.solve import row_jacobian
from benchtool.physics.catalogue import EFFECTS

INFLATION = 5.0  # confused: the others make an sd this many times larger (a pair: 0.98)
SHARE = 0.25  # least scaled component of a parameter that belongs to a confused direction
MATTERS = 0.1  # part of a value without tolerance above which a confused sd is reported
BASELINE: dict[frozenset[str], str] = {  # what separates two parameters of no effect
    frozenset({"k", "R_m"}): "reference points without the plate",
    frozenset({"k", "calibration.scale"}): "with a better calibration of the load cell",
}


def separating_measurement() -> dict[frozenset[str], str]:
    """Return what data separate a pair of parameters, from the laws of the effects."""
    return {
        frozenset({f"{effect.name}.{effect.parameters[0].name}", other}): text
        for effect in EFFECTS.values()
        for other, text in effect.separated_by.items()
    } | BASELINE


@dataclass(frozen=True, slots=True)
class Confusion:
    """Name parameters that the data cannot separate."""

    names: tuple[str, ...]  # two or more, the most involved first
    inflation: float  # how many times larger their standard deviation is because of each other
    open_directions: int  # how many combinations the data leave open altogether; 0 for none
    remedy: str  # what data would separate them

    def __str__(self) -> str:
        """Say it in one sentence."""
        if len(self.names) == 1:
            return f"these data say nothing about {self.names[0]}; fix it, or {self.remedy}"
        listed = " and ".join([", ".join(self.names[:-1]), self.names[-1]])
        if not self.open_directions:
            return (
                f"{listed} can hardly be separated (uncertainty {self.inflation:.0f} times larger "
                f"than with the others known); fix one, or {self.remedy}"
            )
        known = len(self.names) - self.open_directions
        return (
            f"{listed} cannot be separated by these data, which determine only {known} "
            f"combination{'s' if known > 1 else ''} of these {len(self.names)}; fix "
            f"{self.open_directions}, or {self.remedy}"
        )


def confusions(problem: Problem, result: FitResult) -> tuple[Confusion, ...]:
    """Return confused parameters of a result, the worst first."""
    shape, noise = problem.split(result.values)
    lower, upper = problem.shape_bounds
    with np.errstate(all="ignore"):
        way = select_method(problem.predict, shape, len(problem), lower, upper)
        jacobian = row_jacobian(problem, way)(shape, problem.whitening(noise))
    names = problem.shape_names
    spread = spread_of(jacobian, way)
    if spread.undetermined:
        return _open(names, spread.directions)
    found: list[Confusion] = []
    norms = np.linalg.norm(jacobian, axis=0)
    inflation = np.sqrt(np.diag(spread.covariance)) * norms
    for part in _weak_directions(jacobian / norms):
        involved = np.abs(part) > SHARE
        worst = float(inflation[involved].max())
        if worst >= INFLATION and _matters(problem, result, names, involved):
            found.append(_named(names, np.abs(part), worst))
    return tuple(found)


def _weak_directions(scaled: Array) -> list[Array]:
    """Return directions of the column-scaled Jacobian that are weak, the weakest first."""
    _, singular, directions = np.linalg.svd(scaled, full_matrices=False)
    weak = singular < 1.0 / INFLATION
    return list(directions[weak][::-1])


def _matters(
    problem: Problem, result: FitResult, names: tuple[str, ...], involved: NDArray[np.bool_]
) -> bool:
    for name in np.array(names)[involved]:
        item, estimate = problem.parameters[str(name)], result[str(name)]
        limit = item.tolerance if item.tolerance is not None else MATTERS * abs(estimate.value)
        if estimate.sd > limit:
            return True
    return False


def _open(names: tuple[str, ...], directions: Array) -> tuple[Confusion, ...]:
    """Return one confusion for each set of parameters that open directions (k, n) share."""
    left = [np.abs(direction) * (np.abs(direction) > PART) for direction in directions]
    found = []
    while left:
        union, count = left.pop(), 1
        while True:
            touching = [i for i, other in enumerate(left) if np.any((other > 0) & (union > 0))]
            if not touching:
                break
            union, count = union + left.pop(touching[0]), count + 1
        found.append(_named(names, union, np.inf, count))
    return tuple(found)


def _named(
    names: tuple[str, ...], involvement: Array, inflation: float, open_directions: int = 0
) -> Confusion:
    limit = 0.0 if open_directions else SHARE
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


UNDETERMINED_HINT = (
    25.0  # twice the mean log-likelihood ratio below which two are a class: 25 may be 10
)


def evidence_against(matrix: Array, sizes: Array, low: Array, high: Array) -> float:
    """Return twice the log-likelihood ratio that the truth has on average, to second order.

    It is taken over the best model within bounds: of rivals that are free, of everything else, the
    true effects too, within its tolerance. Below some units the two cannot be distinguished.

    Args:
        matrix: (k, k) Fisher information, each number in tolerances of its own.
        sizes: (k,) true values, in tolerances past neutral.
        low: (k,) lower bounds of the rival model, in tolerances past neutral.
        high: (k,) upper bounds.
    """
    own = np.diag(matrix)
    scale = 1.0 / np.sqrt(np.where(own > 0.0, own, 1.0))
    root = cholesky(scale[:, None] * matrix * scale + 1e-10 * np.eye(len(sizes)))
    lowest, highest = (low - sizes) / scale, (high - sizes) / scale
    # Equal bounds have no inside; a hair's breadth does no harm.
    highest = np.maximum(highest, lowest + 1e-9)
    best = lsq_linear(root, np.zeros(len(sizes)), bounds=(lowest, highest), method="bvls")
    return 2.0 * float(best.cost)
