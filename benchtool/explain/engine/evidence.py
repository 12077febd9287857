"""Interfaces of the engine: evidence about model parameters, and kinds of bench."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.explain.engine.parameters import ScaledParameter
from benchtool.explain.engine.verdict import NextExperiment
from benchtool.explain.law_search.search import ResidualSummary
from benchtool.physics.effects.effect import BenchKind, Subsystem
from benchtool.physics.model import Model

if TYPE_CHECKING:
    from benchtool.explain.engine.judgement import CandidateEffect

LATE, EARLY = "late in the run", "early in the run"  # regimes of time: weak hints to a cause


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RowGroups:
    """Masks (n_rows,) of the rows of each stage and of each regime.

    Errors of a stage (subsystem) without rows appear in rows of others. Regimes may overlap.
    """

    stages: Mapping[Subsystem, NDArray[np.bool_]]
    regimes: Mapping[str, NDArray[np.bool_]]

    @classmethod
    def concatenate(
        cls,
        other: Subsystem,
        speed_masks: Sequence[NDArray[np.bool_]],
        regimes: Sequence[Mapping[str, NDArray[np.bool_]]],
    ) -> RowGroups:
        """Concatenate the masks (n,) of all recordings.

        Args:
            other: stage of rows that are not rotor speeds.
            regimes: masks by name for each recording; absent if it has no rows of a regime.
        """
        is_speed = np.concatenate(speed_masks)
        stages: dict[Subsystem, NDArray[np.bool_]] = {other: ~is_speed}
        if is_speed.any():
            stages = {"pwm_to_rpm": is_speed, **stages}
        masks = dict[str, NDArray[np.bool_]]()
        for name in dict.fromkeys(name for part in regimes for name in part):
            pairs = zip(regimes, speed_masks, strict=True)
            parts = [part.get(name, np.zeros(len(rows), bool)) for part, rows in pairs]
            masks[name] = np.concatenate(parts)
        return cls(stages=stages, regimes=masks)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Discrepancy:
    """Smooth deviation of the data from every law in the model.

    Linear in the residuals with a Gaussian prior (Kennedy and O'Hagan, J. R. Stat. Soc. B 63,
    2001): a low-rank addition to their covariance. Within its tolerance it is part of every
    hypothesis, like effects within theirs; beyond, it competes with them as an unnamed effect.
    """

    name: str
    stage: Subsystem
    phrase: str  # its meaning beyond tolerance, within a sentence
    columns: Array  # (n_rows, r) change of the whitened residuals by each of r independent draws
    shares: Array  # (n_rows, r) the same, as a share of readings
    readings: Array | None = None  # (n_rows, r) the same, in readings; None if unknown
    always: bool = True  # present within its tolerance; False: only beyond


class Evidence(Protocol):
    """Fit of model parameters to data."""

    model: Model  # with every candidate, neutral unless set in the user's model
    parameters: tuple[ScaledParameter, ...]  # adjustable ones, in a fixed order

    def residuals(self, scaled: Array) -> Array:
        """Return whitened residuals (n_rows, n_sets) for sets (n_sets, n_parameters)."""
        ...

    def groups(self) -> RowGroups:
        """Return the masks of the rows of each stage and regime."""
        ...

    def discrepancies(self) -> tuple[Discrepancy, ...]:
        """Return the possible deviations of the data from the model's laws."""
        ...

    def varied(self, changes: Array) -> Array:
        """Return smooth variations (n_rows, r) of an effect's changes of residuals (n_rows,)."""
        ...


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ChannelErrors:
    """Prediction errors of one channel."""

    unit: str  # of the root mean square
    squares: Array  # (n_blocks, n_sets) mean squared errors, by block of validation recordings


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Overlay:
    """Measurement and predictions of one channel on a validation recording."""

    channel: str
    unit: str  # of the values
    axis: str  # quantity of `at` ("time_s", "z_over_R")
    at: Array  # (n,) values of that axis; nan between windows, to break lines
    measured: Array  # (n,)
    before: Array  # (n,) by the model adjusted within tolerance
    after: Array  # (n,) with the named effects; equal to `before` without any


class Log(Protocol):
    """Recording to compare with a model, with repairs and missing columns."""

    @property
    def name(self) -> str: ...
    @property
    def remarks(self) -> tuple[str, ...]: ...


class Subject(ABC):
    """Recordings of one kind of bench with a model."""

    kind: BenchKind
    training: Sequence[Log]
    validation: Sequence[Log]
    evidence: Evidence  # training recordings
    all_evidence: Evidence  # training and validation recordings
    missed_by: ClassVar[Callable[..., Sequence[ResidualSummary]]]
    next_by: ClassVar[Callable[..., NextExperiment]]

    @property
    def window_s(self) -> float:
        """Length of a prediction; 0 for steady-state predictions."""
        return 0.0

    @property
    def remarks(self) -> tuple[str, ...]:
        """Repairs of the recordings, and missing columns."""
        logs = (*self.training, *self.validation)
        return tuple(dict.fromkeys(f"{log.name}: {line}" for log in logs for line in log.remarks))

    @property
    def free_law(self) -> str:
        """Data needed to separate a law of distance from an effect; "" if available."""
        return ""

    def summarize_residuals(self, at: Array, active: Sequence[str]) -> Sequence[ResidualSummary]:
        """Return residuals at parameters (n_parameters,), over all variables of a possible law.

        Active effects may exceed their tolerances.
        """
        return self.missed_by(self.all_evidence, at, active)

    @abstractmethod
    def errors(self, sets: Array, changes: Array) -> Mapping[str, ChannelErrors]:
        """Return errors on the validation recordings by channel, for sets (n_sets, n_parameters).

        `changes` (n_validation, n_sets) are expected changes of readings, where known.
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

    def next_experiment(
        self,
        rivals: Sequence[CandidateEffect],
        rng: np.random.Generator,
        refused: Subsystem | None = None,
        minutes: float | None = None,
    ) -> NextExperiment | None:
        """Return the experiment that is expected to separate rivals; None for fewer than two.

        Args:
            refused: stage of an unnamed effect, or None.
            minutes: longest duration; None for the default.
        """
        if len({rival.name for rival in rivals}) < 2:
            return None
        return self.next_by(self.all_evidence, rivals, rng, refused, minutes)
