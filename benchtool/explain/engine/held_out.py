"""The gap on the check recordings: as given, before, after, and the floor of a true model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchtool.core.array_type import Array
from benchtool.explain.engine.evidence import ChannelErrors, Evidence, Subject
from benchtool.explain.engine.hypotheses import SMALL, Hypotheses, Hypothesis
from benchtool.explain.engine.shared_errors import solve_covariance
from benchtool.explain.engine.verdict import ChannelGap

UPPER = 0.95  # quantile of the floor's draws that counts as the upper end of noise
CLOSED = 0.8  # share of the gap above the floor that a right explanation closes; assumed
RESAMPLES = 1000  # draws of the block bootstrap
FLOOR_DRAWS = 64  # draws of a floor with uncertain numbers


class Learned:
    """Predict departures within tolerance where they were not learned from.

    In the basis of all recordings, which the learned ones alone need not share: roots of a
    covariance are cut off, and predictions of speed feel where.

    Args:
        every: those and the check recordings, theirs last.
    """

    def __init__(self, hypotheses: Hypotheses, every: Evidence) -> None:
        self._errors = hypotheses.errors
        self._parts = [part for part in every.discrepancies() if part.readings is not None]
        self._learned = hypotheses.n_rows

    def mean(self, fit: Hypothesis) -> Array:
        """Return by what readings of the check recordings are expected to be changed (n_rows,).

        Each departure as far as its tolerance, without what is beyond.
        """
        draws = self._columns(fit).T @ self._left(fit)
        total, first = np.zeros(1), 0
        for part in self._parts:
            assert part.readings is not None
            readings = part.readings[self._learned :]
            last = first + readings.shape[1]
            if part.name not in fit.amplitudes:
                limit = np.sqrt(np.sum(readings**2, axis=1)) / SMALL
                total = total + np.clip(readings @ draws[first:last], -limit, limit)
            first = last
        return total

    def drawn(self, fit: Hypothesis, rng: np.random.Generator, draws: int) -> Array:
        """Return changes (n_rows, draws) as uncertain as they are, about the expected ones."""
        columns = self._columns(fit) / self._errors.noise[:, None]
        precision = columns.T @ solve_covariance(self._every(fit), columns)
        size, axes = np.linalg.eigh(np.eye(len(precision)) - precision)
        root = axes * np.sqrt(np.maximum(size, 0.0)) @ axes.T  # the one that rounding leaves alone
        drawn: Array = self._readings(fit) @ (root @ rng.standard_normal((len(size), draws)))
        return drawn

    def _every(self, fit: Hypothesis) -> Array:
        """Return the columns of all that is there over the noise, laws of effects among them."""
        laws = [self._errors.law(name) for name in fit.amplitudes if ": law" in name]
        return np.hstack([self._columns(fit) / self._errors.noise[:, None], *laws])

    def _left(self, fit: Hypothesis) -> Array:
        """Return V^-1 r (n_learned,) of what a hypothesis leaves."""
        return (
            solve_covariance(self._every(fit), self._errors.rows(fit.values)[:, 0])
            / self._errors.noise
        )

    def _factors(self, fit: Hypothesis) -> list[float]:
        return [fit.amplitudes.get(part.name, float(part.always)) for part in self._parts]

    def _columns(self, fit: Hypothesis) -> Array:
        """Return columns (n_learned, r) as large as the hypothesis has them."""
        parts = [
            factor * part.columns[: self._learned]
            for factor, part in zip(self._factors(fit), self._parts, strict=True)
        ]
        return np.hstack([np.empty((self._learned, 0)), *parts])

    def _readings(self, fit: Hypothesis) -> Array:
        """Return changes of readings (n_check_rows, r), 0 for what is beyond tolerance."""
        if not self._parts:
            return np.empty((1, 0))
        return np.hstack(
            [
                (0.0 if part.name in fit.amplitudes else factor) * part.readings[self._learned :]
                for factor, part in zip(self._factors(fit), self._parts, strict=True)
                if part.readings is not None
            ]
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ValidationScore:
    """Errors on the validation recordings.

    Attributes:
        errors: by channel; columns are the model as given, before, after.
        floor: (draws,) by channel, of the model with the named effects taken for true.
        doubt: the same, the model's numbers as uncertain as they are.
    """

    errors: dict[str, ChannelErrors]
    floor: dict[str, Array]
    doubt: dict[str, Array]

    @classmethod
    def of(
        cls,
        subject: Subject,
        hypotheses: Hypotheses,
        null: Hypothesis,
        best: Hypothesis,
        rng: np.random.Generator,
        draws: int,
    ) -> ValidationScore:
        """Predict with the numbers before (`null`) and after (`best`)."""
        training = Learned(hypotheses, subject.all_evidence)
        sets = np.vstack([np.zeros(len(null.values)), null.values, best.values])
        before = training.mean(null)
        changes = np.stack([np.zeros_like(before), before, training.mean(best)], axis=1)

        drawn = training.drawn(best, rng, FLOOR_DRAWS)
        return cls(
            errors=dict(subject.errors(sets, changes)),
            doubt=dict(subject.floor(best.values, drawn, rng, hypotheses.spread(best))),
            floor=dict(subject.floor(best.values, training.drawn(best, rng, draws), rng)),
        )

    @property
    def left(self) -> tuple[float, float]:
        """The largest error over the median of its floor: of all channels, of those hardly gained.

        A channel hardly gains where less than `CLOSED` of its gap above the floor is closed.
        """
        ratios, unclosed = [0.0], [0.0]
        for name, channel in self.errors.items():
            _, before, after = np.mean(channel.squares, axis=0)
            floor = float(np.median(self.floor[name])) ** 2
            ratios.append(float(np.sqrt(after / floor)))
            if before - after < CLOSED * (before - floor):
                unclosed.append(float(np.sqrt(min(before, after) / floor)))
        return max(ratios), max(unclosed)

    def gaps(self, rng: np.random.Generator) -> tuple[ChannelGap, ...]:
        """Return the gap of each channel."""
        out = []
        for name, channel in self.errors.items():
            roots = np.sqrt(np.mean(channel.squares, axis=0))
            blocks = rng.integers(len(channel.squares), size=(RESAMPLES, len(channel.squares)))
            drawn = np.sqrt(np.mean(channel.squares[blocks], axis=1))
            low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
            floor = self.floor[name]
            out.append(
                ChannelGap(
                    channel=name,
                    unit=channel.unit,
                    as_given=float(roots[0]),
                    before=float(roots[1]),
                    after=float(roots[2]),
                    floor=float(np.median(floor)),
                    floor_low=float(np.quantile(floor, 1.0 - UPPER)),
                    floor_high=float(np.quantile(floor, UPPER)),
                    before_low=float(low[1]),
                    before_high=float(high[1]),
                    after_low=float(low[2]),
                    after_high=float(high[2]),
                )
            )
        return tuple(out)
