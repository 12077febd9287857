"""The seams of the engine: evidence about a model's numbers, benches as subjects of a verdict."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.explain.engine.parameters import ScaledParameter
from benchtool.explain.engine.verdict import NextExperiment
from benchtool.physics.effects.effect import BenchKind, Effect, Subsystem
from benchtool.physics.model import Model

LATE, EARLY = "late in the run", "early in the run"
"""Regimes of the clock: they say less of a cause than where the plate was, or how fast it went."""


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
        of_speed: Sequence[NDArray[np.bool_]],
        regimes: Sequence[Mapping[str, NDArray[np.bool_]]],
    ) -> RowGroups:
        """Return labels of rows that come in parts.

        Args:
            other: stage of the rows that are not of rotor speed.
            of_speed: masks (n,), one for each part.
            regimes: masks (n,) by name for each part; a part has none of a regime that it lacks.
        """
        turning = np.concatenate(of_speed)
        names = dict.fromkeys(name for part in regimes for name in part)
        return cls(
            stages={"pwm_to_rpm": turning, other: ~turning} if turning.any() else {other: ~turning},
            regimes={
                name: np.concatenate(
                    [
                        part.get(name, np.zeros(len(rows), bool))
                        for part, rows in zip(regimes, of_speed, strict=True)
                    ]
                )
                for name in names
            },
        )


class Evidence(Protocol):
    """Say how well a model's numbers fit data."""

    model: Model  # with every candidate in it, neutral unless the user's model says otherwise
    parameters: tuple[ScaledParameter, ...]  # what can be moved, in a fixed order

    def residuals(self, scaled: Array) -> Array:
        """Return whitened residuals (n_rows, n_sets) for sets (n_sets, n_parameters)."""
        ...

    def groups(self) -> RowGroups:
        """Return labels of the rows."""
        ...


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ChannelErrors:
    """Hold prediction errors of one channel."""

    unit: str  # of their roots
    squares: Array  # (n_blocks, n_sets) mean squared error of each block of the check recordings


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Overlay:
    """Hold measurement and predictions of one channel on a check recording."""

    channel: str  # its name
    unit: str  # of the values
    axis: str  # what `at` counts ("time_s", "z_over_R")
    at: Array  # (n,) places on that axis; nan between windows, so that lines break there
    measured: Array  # (n,)
    before: Array  # (n,) the model as calibrated within tolerance
    after: Array  # (n,) with the named effects; equal to `before` where nothing is named


class Log(Protocol):
    """A recording that is held against a model: its name, what was repaired, what it lacks."""

    @property
    def name(self) -> str: ...
    @property
    def remarks(self) -> tuple[str, ...]: ...


class Subject(ABC):
    """Hold recordings of one kind of bench against a model.

    Attributes:
        learn, check: recordings to learn from and to verify on.
        closed_enough: share of a gap from which an effect counts as its cause, whatever is left;
            inf: never.
    """

    kind: BenchKind  # which bench it is
    learn: Sequence[Log]
    check: Sequence[Log]
    evidence: Evidence  # what the recordings to learn from say
    closed_enough: float
    temperature: float  # divides differences of log-likelihood before they become probabilities

    @property
    def window_s(self) -> float:
        """Length of a prediction; 0 where predictions are settled."""
        return 0.0

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was repaired in the recordings, and what they lack."""
        logs = (*self.learn, *self.check)
        return tuple(dict.fromkeys(f"{log.name}: {line}" for log in logs for line in log.remarks))

    def allowed_leftover(self, at: Array, rng: np.random.Generator) -> float:
        """Return what variance whitened residuals of a stage may have `at` (n_parameters,).

        What a true model would leave, and what small imperfections add; inf where it says nothing.
        """
        return float("inf")

    def law_error(self, effect: Effect) -> float:
        """Return the standard error of an effect's law, over the effect's departure from neutral.

        It joins what the data leave open in the intervals of the effect's parameters.
        """
        return 0.0

    @abstractmethod
    def errors(self, sets: Array) -> Mapping[str, ChannelErrors]:
        """Return errors on the check recordings by channel, for sets (n_sets, n_parameters)."""

    @abstractmethod
    def floor(
        self, at: Array, rng: np.random.Generator, draws: int, spread: Array | None = None
    ) -> Mapping[str, Array]:
        """Return errors (draws,) of a true model `at` (n_parameters,), by channel, rms.

        With `spread` (n_parameters, n_parameters) the truth of each draw lies as far from the model
        that predicts as its parameters are uncertain.
        """

    @abstractmethod
    def overlays(self, before: Array, after: Array) -> tuple[Overlay, ...]:
        """Return the first check recording with predictions, parameters (n_parameters,) each."""

    @abstractmethod
    def next_experiment(
        self,
        rivals: Sequence[tuple[str, Array]],
        rng: np.random.Generator,
        refused: Subsystem | None = None,
    ) -> NextExperiment | None:
        """Return the experiment that separates hypotheses best, each with its (n_parameters,).

        Args:
            rivals: likeliest first.
            rng: of simulated noise.
            refused: the stage in which nothing in the library explains what is there.
        """
