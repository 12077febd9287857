"""Interfaces of the engine: evidence about model parameters, and kinds of bench."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.explain.engine.parameters import ScaledParameter
from benchtool.explain.engine.verdict import NextExperiment
from benchtool.explain.law_search.search import ResidualSummary
from benchtool.physics.effects.effect import BenchKind, Subsystem
from benchtool.physics.model import Model

if TYPE_CHECKING:
    from benchtool.explain.engine.judgement import CandidateEffect

LATE, EARLY = "late in the run", "early in the run"  # regimes of the clock say less of a cause


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RowGroups:
    """Label the rows of evidence.

    Attributes:
        stages: stage whose disagreement shows in a group of rows, with the mask (n_rows,). A stage
            may be missing: what it does wrong shows in another's rows.
        regimes: parts of the recordings in words, with masks (n_rows,); they may overlap.
    """

    stages: Mapping[Subsystem, NDArray[np.bool_]]
    regimes: Mapping[str, NDArray[np.bool_]]

    @classmethod
    def joined(
        cls,
        other: Subsystem,
        speed_masks: Sequence[NDArray[np.bool_]],
        regimes: Sequence[Mapping[str, NDArray[np.bool_]]],
    ) -> RowGroups:
        """Return labels of rows that come in parts.

        Args:
            other: stage of the rows that are not of rotor speed.
            of_speed: masks (n,), one for each part.
            regimes: masks (n,) by name for each part; a part has none of a regime that it lacks.
        """
        is_speed = np.concatenate(speed_masks)
        names = dict.fromkeys(name for part in regimes for name in part)
        return cls(
            stages={"pwm_to_rpm": is_speed, other: ~is_speed}
            if is_speed.any()
            else {other: ~is_speed},
            regimes={
                name: np.concatenate(
                    [
                        part.get(name, np.zeros(len(rows), bool))
                        for part, rows in zip(regimes, speed_masks, strict=True)
                    ]
                )
                for name in names
            },
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Discrepancy:
    """Describe one way in which data may depart from every law in the model, smoothly.

    It enters residuals linearly with a Gaussian prior (Kennedy and O'Hagan, J. R. Stat. Soc. B 63,
    2001): a low-rank addition to their covariance. Within its tolerance it is part of every
    hypothesis, as effects within theirs are; beyond, it competes with them as what has no name.
    """

    name: str
    stage: Subsystem  # link of the chain that departs
    phrase: str  # what it means where it is beyond its tolerance, within a sentence
    columns: Array  # (n_rows, r) change of the whitened residuals by each of r independent draws
    shares: Array  # (n_rows, r) the same of the readings, as parts of them
    readings: Array | None = None  # (n_rows, r) the same of the readings; None where it is unknown
    always: bool = True  # whether it is there within its tolerance, else only beyond


class Evidence(Protocol):
    """Fit of model parameters to data."""

    model: Model  # with every candidate in it, neutral unless the user's model says otherwise
    parameters: tuple[ScaledParameter, ...]  # what can be moved, in a fixed order

    def residuals(self, scaled: Array) -> Array:
        """Return whitened residuals (n_rows, n_sets) for sets (n_sets, n_parameters)."""
        ...

    def groups(self) -> RowGroups:
        """Return labels of the rows."""
        ...

    def discrepancies(self) -> tuple[Discrepancy, ...]:
        """Return the ways in which the data may depart from the model's laws."""
        ...

    def varied(self, changes: Array) -> Array:
        """Return smooth variations (n_rows, r) of what an effect changes in residuals (n_rows,)."""
        ...


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ChannelErrors:
    """Prediction errors of one channel."""

    unit: str  # of their roots
    squares: Array  # (n_blocks, n_sets) mean squared error of each block of the check recordings


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Overlay:
    """Measurement and predictions of one channel on a validation recording."""

    channel: str  # its name
    unit: str  # of the values
    axis: str  # what `at` counts ("time_s", "z_over_R")
    at: Array  # (n,) places on that axis; nan between windows, so that lines break there
    measured: Array  # (n,)
    before: Array  # (n,) the model as calibrated within tolerance
    after: Array  # (n,) with the named effects; equal to `before` where nothing is named


class Log(Protocol):
    """Recording to compare with a model, with repairs and missing columns."""

    @property
    def name(self) -> str: ...
    @property
    def remarks(self) -> tuple[str, ...]: ...


class Subject(ABC):
    """Recordings of one kind of bench with a model."""

    kind: BenchKind  # which bench it is
    training: Sequence[Log]
    validation: Sequence[Log]
    evidence: Evidence  # training recordings
    all_evidence: Evidence  # training and validation recordings
    missed_by: ClassVar[Callable[..., Sequence[ResidualSummary]]]
    next_by: ClassVar[Callable[..., NextExperiment]]

    @property
    def window_s(self) -> float:
        """Length of a prediction; 0 where predictions are settled."""
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

    def missing_channels(self, at: Array, opened: Sequence[str]) -> Sequence[ResidualSummary]:
        """Return what readings miss about parameters (n_parameters,), over all it may depend on.

        With `opened` effects as large as they like.
        """
        return self.missed_by(self.all_evidence, at, opened)

    @abstractmethod
    def errors(self, sets: Array, changes: Array) -> Mapping[str, ChannelErrors]:
        """Return errors on the check recordings by channel, for sets (n_sets, n_parameters).

        Readings are expected to be changed by (n_check_rows, n_sets), where that is known.
        """

    @abstractmethod
    def floor(
        self, at: Array, changes: Array, rng: np.random.Generator, spread: Array | None = None
    ) -> Mapping[str, Array]:
        """Return errors (draws,) of a true model `at` (n_parameters,), by channel, rms.

        Readings of each draw are changed by (n_check_rows, draws), where that is known.

        With `spread` (n_parameters, n_parameters) the truth of each draw lies as far from the model
        that predicts as its parameters are uncertain.
        """

    @abstractmethod
    def overlays(self, before: Array, after: Array) -> tuple[Overlay, ...]:
        """Return the first check recording with predictions, parameters (n_parameters,) each."""

    def next_experiment(
        self,
        rivals: Sequence[CandidateEffect],
        rng: np.random.Generator,
        refused: Subsystem | None = None,
        minutes: float | None = None,
    ) -> NextExperiment | None:
        """Return the experiment that is expected to separate rivals; None of fewer than two.

        Args:
            refused: the stage in which nothing in the library explains what is there.
            minutes: that it may take; a usual time when None.
        """
        if len({rival.name for rival in rivals}) < 2:
            return None
        return self.next_by(self.all_evidence, rivals, rng, refused, minutes)
