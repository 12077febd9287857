"""Recordings with a model: prediction errors on the validation part, with the noise floor."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.explain.engine.bounded_least_squares import SharedErrors, solve_covariance
from benchtool.explain.engine.design import Designer
from benchtool.explain.engine.evidence import Discrepancy, Evidence
from benchtool.explain.engine.hypotheses import SMALL, Hypotheses, Hypothesis
from benchtool.explain.findings import ChannelGap, Overlay
from benchtool.explain.law_search import ResidualSummary
from benchtool.explain.recording_checks import check_bench_kind
from benchtool.physics.effects.effect import BenchKind, Effect
from benchtool.physics.model import Model

# Unit of a gap, by channel
CHANNEL_UNITS = {"thrust_N": "N", "theta_rad": "rad", "gyro_rad_s": "rad/s", "rpm": "rpm"}


def build_overlay(channel: str, axis: str, pieces: Iterable[Array]) -> Overlay:
    """Return rows (n, 4) of position, measured, before and after, with nan between pieces."""
    gap = np.full((1, 4), np.nan)
    at, measured, before, after = np.concatenate([row for p in pieces for row in (p, gap)]).T
    return Overlay(
        channel=channel, unit=CHANNEL_UNITS["rpm" if channel.startswith("rpm") else channel],
        axis=axis, at=at, measured=measured, before=before, after=after,
    )  # fmt: skip


class Log(Protocol):
    """Recording to compare with a model, with repairs and missing columns."""

    @property
    def name(self) -> str: ...
    @property
    def remarks(self) -> tuple[str, ...]: ...
    def bench_numbers(self, rig: Rig) -> Mapping[str, float]:
        """Return numbers that are equal for recordings of one bench, by name."""
        ...


class Subject(ABC):
    """Recordings of one kind of bench with a model; sweep and pitch differ in what they predict."""

    kind: ClassVar[BenchKind]
    gather: ClassVar[Callable[..., Evidence]]  # evidence of (model, logs, user-defined effects)
    # Residuals at parameters (evidence, values, active effects), over all variables of a law
    summarize: ClassVar[Callable[..., Sequence[ResidualSummary]]]
    designer: ClassVar[type[Designer[Any]]]  # of the next experiment
    evidence: Evidence  # training recordings
    check_evidence: Evidence  # validation recordings
    all_evidence: Evidence  # training and validation recordings

    def __init__(
        self,
        model: Model,
        training: Sequence[Log],
        validation: Sequence[Log],
        extra: Sequence[Effect] = (),
    ) -> None:
        self.logs = (*training, *validation)
        check_bench_kind([(log.name, log.bench_numbers(model.rig)) for log in self.logs])
        self.evidence = self.gather(model, training, extra)
        self.check_evidence = self.gather(model, validation, extra)
        self.all_evidence = self.gather(model, self.logs, extra)

    @property
    def window_s(self) -> float:
        """Length of a prediction; 0 for steady-state predictions."""
        return 0.0

    @property
    def remarks(self) -> tuple[str, ...]:
        """Repairs of the recordings, and missing columns."""
        return tuple(
            dict.fromkeys(f"{log.name}: {line}" for log in self.logs for line in log.remarks)
        )

    @property
    def free_law(self) -> str:
        """Data needed to separate a law of distance from an effect; "" if available."""
        return ""

    @abstractmethod
    def errors(self, sets: Array, changes: Array) -> Mapping[str, Array]:
        """Return errors on the validation recordings by channel, for sets (n_sets, n_parameters).

        They are mean squares (n_blocks, n_sets), by block of the validation recordings. `changes`
        (n_validation, n_sets) are expected changes of readings, where known.
        """

    @abstractmethod
    def floor(
        self, at: Array, changes: Array, rng: np.random.Generator, spread: Array | None = None
    ) -> Mapping[str, Array]:
        """Return rms errors (draws,) of a true model at parameters (n_parameters,), by channel.

        `changes` (n_validation, draws) are changes of readings, where known. With a covariance
        `spread` (n_parameters, n_parameters) each draw also has its own true parameters.
        """

    @abstractmethod
    def overlays(self, before: Array, after: Array) -> tuple[Overlay, ...]:
        """Return the first validation recording with predictions of two parameter sets."""


FLOOR_QUANTILE = 0.95  # of the draws of the floor; upper end of the noise
CLOSED_SHARE = 0.8  # of the gap above the floor that a correct explanation closes; assumed
RESAMPLES = 1000  # draws of the block bootstrap
FLOOR_DRAWS = 64  # draws of a floor with uncertain parameters


class LearnedDiscrepancies:
    """Prediction of discrepancies within tolerance on the validation recordings.

    Uses the basis of training and validation recordings together, validation rows last: a basis of
    training rows alone is truncated differently, which changes predicted speeds.
    """

    def __init__(
        self, errors: SharedErrors, discrepancies: Iterable[Discrepancy], fit: Hypothesis
    ) -> None:
        self._errors, self._fit, n = errors, fit, len(errors.noise)
        parts = [d for d in discrepancies if d.readings is not None]
        scaled = [fit.amplitudes.get(d.name, float(d.always)) * d.columns[:n] for d in parts]
        self._unscaled = np.hstack([np.empty((n, 0)), *scaled])
        self._columns = self._unscaled / errors.noise[:, None]
        laws = [errors.all_columns[name].T for name in fit.amplitudes if ": law" in name]
        self._with_laws = np.hstack([self._columns, *laws])
        self._readings = [  # of the validation; 0 for discrepancies beyond tolerance
            (0.0 if d.name in fit.amplitudes else float(d.always)) * d.readings[n:]
            for d in parts
            if d.readings is not None
        ]

    def mean(self) -> Array:
        """Return the expected changes (n_validation,) of validation readings, within tolerance."""
        rows = self._errors.rows(self._fit.values)[:, 0]
        weighted = solve_covariance(self._with_laws, rows) / self._errors.noise
        coefficients = self._unscaled.T @ weighted
        total, first = np.zeros(1), 0
        for readings in self._readings:
            last = first + readings.shape[1]
            limit = np.sqrt(np.sum(readings**2, axis=1)) / SMALL
            total = total + np.clip(readings @ coefficients[first:last], -limit, limit)
            first = last
        return total

    def draw(self, rng: np.random.Generator, draws: int) -> Array:
        """Return random deviations (n_validation, draws) from the expected changes."""
        precision = self._columns.T @ solve_covariance(self._with_laws, self._columns)
        variances, axes = np.linalg.eigh(np.eye(len(precision)) - precision)
        root = axes * np.sqrt(np.maximum(variances, 0.0)) @ axes.T  # symmetric: robust to rounding
        readings = np.hstack(self._readings or [np.empty((1, 0))])
        changes: Array = readings @ (root @ rng.standard_normal((len(root), draws)))
        return changes


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ValidationScore:
    """Errors on the validation recordings, by channel."""

    errors: Mapping[str, Array]  # (n_blocks, 3) mean squares: model as given, before, after
    floor: Mapping[str, Array]  # (draws,) if the model with the named effects is true
    uncertain_floor: Mapping[str, Array]  # the same, with uncertain parameters

    @classmethod
    def of(
        cls,
        subject: Subject,
        hypotheses: Hypotheses,
        held_out: Hypotheses,
        fits: tuple[Hypothesis, Hypothesis],
        rng: np.random.Generator,
        draws: int,
    ) -> ValidationScore:
        """Return the errors of two fits: without and with the named effects."""
        null, best = fits
        learned_null, learned = (
            LearnedDiscrepancies(hypotheses.errors, held_out.discrepancies.values(), fit)
            for fit in fits
        )
        sets = np.vstack([np.zeros(len(null.values)), null.values, best.values])
        before = learned_null.mean()
        changes = np.stack([np.zeros_like(before), before, learned.mean()], axis=1)
        drawn, covariance = learned.draw(rng, FLOOR_DRAWS), hypotheses.covariance(best)
        return cls(
            errors=subject.errors(sets, changes),
            uncertain_floor=subject.floor(best.values, drawn, rng, covariance),
            floor=subject.floor(best.values, learned.draw(rng, draws), rng),
        )

    @property
    def remaining_errors(self) -> tuple[float, float]:
        """The largest error over its median floor: of all channels, and of the unclosed ones.

        A channel is unclosed if less than `CLOSED_SHARE` of its gap above the floor is closed.
        """
        ratios, unclosed = [0.0], [0.0]
        for name, squares in self.errors.items():
            _, before, after = np.mean(squares, axis=0)
            floor = float(np.median(self.floor[name])) ** 2
            ratios.append(float(np.sqrt(after / floor)))
            if before - after < CLOSED_SHARE * (before - floor):
                unclosed.append(float(np.sqrt(min(before, after) / floor)))
        return max(ratios), max(unclosed)

    def gaps(self, rng: np.random.Generator) -> tuple[ChannelGap, ...]:
        """Return the gap of each channel."""
        gaps = []
        for name, squares in self.errors.items():
            roots = np.sqrt(np.mean(squares, axis=0))
            blocks = rng.integers(len(squares), size=(RESAMPLES, len(squares)))
            drawn = np.sqrt(np.mean(squares[blocks], axis=1))
            low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
            floor = self.floor[name]
            gaps.append(
                ChannelGap(
                    channel=name,
                    unit=CHANNEL_UNITS[name],
                    as_given=float(roots[0]),
                    before=float(roots[1]),
                    after=float(roots[2]),
                    floor=float(np.median(floor)),
                    floor_low=float(np.quantile(floor, 1.0 - FLOOR_QUANTILE)),
                    floor_high=float(np.quantile(floor, FLOOR_QUANTILE)),
                    before_low=float(low[1]),
                    before_high=float(high[1]),
                    after_low=float(low[2]),
                    after_high=float(high[2]),
                )
            )
        return tuple(gaps)
