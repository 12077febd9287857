"""The seam between kinds of benches and the verdict: what a bench must be able to tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchtool.explain.engine.evidence import Evidence
from benchtool.explain.engine.explanation import Overlay
from benchtool.explain.engine.verdict import NextExperiment
from benchtool.physics.effects.effect import BenchKind, Effect

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ChannelErrors:
    """Hold prediction errors of one channel.

    Attributes:
        unit: of their roots.
        squares: (n_blocks, n_sets) mean squared error of each block of the check recordings.
    """

    unit: str
    squares: Array


class Subject(Protocol):
    """Hold recordings of one kind of bench against a model."""

    @property
    def kind(self) -> BenchKind:
        """Which bench it is."""
        ...

    @property
    def evidence(self) -> Evidence:
        """What the recordings to learn from say."""
        ...

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was mended in the recordings, and what they lack."""
        ...

    def allowed_leftover(self, at: Array, rng: np.random.Generator) -> float:
        """Return what variance whitened residuals of a stage may have with knobs `at` (n_knobs,).

        What a true model would leave, and what small imperfections add; inf where it tells nothing.
        """
        ...

    @property
    def closed_enough(self) -> float:
        """Share of a gap from which an effect counts as its cause, whatever is left; inf: never."""
        ...

    @property
    def temperature(self) -> float:
        """What divides differences of log-likelihood before they become probabilities."""
        ...

    @property
    def window_s(self) -> float:
        """Length of a prediction; 0 where predictions are settled."""
        ...

    def law_error(self, effect: Effect) -> float:
        """Return the standard error of an effect's law, over the effect's departure from neutral.

        It joins what the data leave open in the intervals of the effect's parameters.
        """
        ...

    def errors(self, sets: Array) -> Mapping[str, ChannelErrors]:
        """Return errors on the check recordings by channel, for sets of knobs (n_sets, n_knobs)."""
        ...

    def floor(
        self, at: Array, rng: np.random.Generator, draws: int, spread: Array | None = None
    ) -> Mapping[str, Array]:
        """Return errors of a true model with knobs `at` (draws,), by channel, root mean square.

        With `spread` (n_knobs, n_knobs) the truth of each draw lies as far from the model that
        predicts as its knobs are uncertain.
        """
        ...

    def overlays(self, before: Array, after: Array) -> tuple[Overlay, ...]:
        """Return measurement and predictions with knobs before and after (n_knobs,) each."""
        ...

    def next_experiment(
        self, rivals: Sequence[tuple[str, Array]], rng: np.random.Generator
    ) -> NextExperiment | None:
        """Return the experiment that separates hypotheses best; each with its knobs (n_knobs,)."""
        ...
