"""The seam for estimators: a problem goes in, a result comes out."""

from __future__ import annotations

from typing import Protocol

from benchtool.core.errors import UnknownChoice
from benchtool.core.fit_result import FitResult
from benchtool.fit.problem import Problem

ESTIMATORS = ("least_squares", "emcee")
"""Every estimator by name."""


class Estimator(Protocol):
    """Estimate the free parameters of a problem.

    An estimator leaves the problem as it is, gives the same answer for the same seed, orders its
    estimates as `Problem.free_names`, and says in the outcome how it ended. It raises
    `EstimationError` only where there is no result at all.
    """

    def __call__(self, problem: Problem) -> FitResult:
        """Return the result."""
        ...


def estimator_named(name: str) -> Estimator:
    """Return an estimator with its default settings, or refuse the name with the known ones."""
    if name == "least_squares":
        from benchtool.fit.least_squares import fit_least_squares

        return fit_least_squares
    if name == "emcee":
        from benchtool.fit.ensemble import fit_ensemble

        return fit_ensemble
    raise UnknownChoice("estimator", name, ESTIMATORS)
