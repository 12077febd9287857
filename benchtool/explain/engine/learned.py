"""What the recordings to learn from say of discrepancies in the check recordings."""

from __future__ import annotations

import numpy as np

from benchtool.core.array import Array
from benchtool.explain.engine.hypotheses import SMALL, Hypotheses, Hypothesis
from benchtool.explain.engine.shared_errors import solved
from benchtool.explain.engine.subject import Evidence


class Learned:
    """Predict departures within tolerance where they were not learned from.

    In the basis of all recordings, which the learned ones alone need not share: roots of a
    covariance are cut off, and predictions of speed feel where.

    Args:
        every: those and the check recordings, theirs last.
    """

    def __init__(self, hypotheses: Hypotheses, every: Evidence) -> None:
        self._errors = hypotheses.errors
        self._parts = [one for one in every.discrepancies() if one.readings is not None]
        self._learned = hypotheses.n_rows

    def mean(self, one: Hypothesis) -> Array:
        """Return by what readings of the check recordings are expected to be changed (n_rows,).

        Each departure as far as its tolerance, without what is beyond.
        """
        draws = self._known(one).T @ self._left(one)
        total, first = np.zeros(1), 0
        for part in self._parts:
            assert part.readings is not None
            readings = part.readings[self._learned :]
            last = first + readings.shape[1]
            if part.name not in one.widened:
                limit = np.sqrt(np.sum(readings**2, axis=1)) / SMALL
                total = total + np.clip(readings @ draws[first:last], -limit, limit)
            first = last
        return total

    def drawn(self, one: Hypothesis, rng: np.random.Generator, draws: int) -> Array:
        """Return changes (n_rows, draws) as uncertain as they are, about the expected ones."""
        columns = self._known(one) / self._errors.noise[:, None]
        sure = columns.T @ solved(self._every(one), columns)
        size, axes = np.linalg.eigh(np.eye(len(sure)) - sure)
        root = axes * np.sqrt(np.maximum(size, 0.0)) @ axes.T  # the one that rounding leaves alone
        drawn: Array = self._readings(one) @ (root @ rng.standard_normal((len(size), draws)))
        return drawn

    def _every(self, one: Hypothesis) -> Array:
        """Return the columns of all that is there over the noise, laws of effects among them."""
        laws = [self._errors.law(name) for name in one.widened if ": law" in name]
        return np.hstack([self._known(one) / self._errors.noise[:, None], *laws])

    def _left(self, one: Hypothesis) -> Array:
        """Return V^-1 r (n_learned,) of what a hypothesis leaves."""
        return solved(self._every(one), self._errors.rows(one.at)[:, 0]) / self._errors.noise

    def _factors(self, one: Hypothesis) -> list[float]:
        return [one.widened.get(part.name, float(part.always)) for part in self._parts]

    def _known(self, one: Hypothesis) -> Array:
        """Return columns (n_learned, r) as large as the hypothesis has them."""
        parts = [
            factor * part.columns[: self._learned]
            for factor, part in zip(self._factors(one), self._parts, strict=True)
        ]
        return np.hstack([np.empty((self._learned, 0)), *parts])

    def _readings(self, one: Hypothesis) -> Array:
        """Return changes of readings (n_check_rows, r), 0 for what is beyond tolerance."""
        if not self._parts:
            return np.empty((1, 0))
        return np.hstack(
            [
                (0.0 if part.name in one.widened else factor) * part.readings[self._learned :]
                for factor, part in zip(self._factors(one), self._parts, strict=True)
                if part.readings is not None
            ]
        )
