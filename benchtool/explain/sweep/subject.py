"""Plate sweeps as the subject of an explanation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.recording import Recording
from benchtool.explain.engine.explanation import Overlay
from benchtool.explain.engine.subject import ChannelErrors
from benchtool.explain.engine.verdict import NextExperiment
from benchtool.explain.sweep.evidence import SweepEvidence
from benchtool.explain.sweep.gap import errors, floor
from benchtool.explain.sweep.log import SweepLog, sweep_log
from benchtool.explain.sweep.next_sweep import next_sweep_experiment
from benchtool.explain.sweep.overlay import overlays
from benchtool.explain.sweep.power import Power
from benchtool.physics.effects.effect import BenchKind, Effect
from benchtool.physics.model import Model

Array = NDArray[np.float64]

CLOSED_ENOUGH = 0.8
"""An effect whose law is a little off leaves more than noise of a great gap; one that is not the
cause closes less of it. On development records the least a true effect closed was 0.88, the most
that any named one closed of something from outside 0.45."""

TEMPERATURE = 1.0
"""Divides differences of log-likelihood: stated noise and the shape parameters of the laws account
for what development records leave, so that likelihoods count in full. With 1.0 the expected
calibration error on 279 of them was 0.03, with 3.0 it was 0.08."""


class SweepSubject:
    """Hold plate sweeps against a model.

    Args:
        model: as given by the user.
        learn: points to learn from.
        check: points to verify on.
        extra: effects of the user's own.
    """

    kind: BenchKind = "sweep"
    window_s = 0.0
    closed_enough = CLOSED_ENOUGH
    temperature = TEMPERATURE

    def __init__(
        self,
        model: Model,
        learn: Sequence[Recording],
        check: Sequence[Recording],
        extra: Sequence[Effect] = (),
    ) -> None:
        rig = model.rig
        learned = [sweep_log(one, rig) for one in learn]
        first = next((log.power for log in learned if log.power is not None), None)
        self.learn = tuple(_loaded_as(first, log) for log in learned)
        self.check = tuple(_loaded_as(first, sweep_log(one, rig)) for one in check)
        self.evidence = SweepEvidence(model, self.learn, extra)
        self._check = SweepEvidence(model, self.check, extra)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was mended in the sweeps, and what they lack."""
        found = [
            f"{log.name}: {remark}" for log in (*self.learn, *self.check) for remark in log.remarks
        ]
        return tuple(dict.fromkeys(found))

    def allowed_leftover(self, at: Array, rng: np.random.Generator) -> float:
        """Return inf: laws a few per cent off in shape leave more than noise in good sweeps."""
        return float("inf")

    def law_error(self, effect: Effect) -> float:
        """Return 0: laws have shape parameters of their own, which carry what is off in them."""
        return 0.0

    def errors(self, sets: Array) -> Mapping[str, ChannelErrors]:
        """Return errors in each stay of the check sweeps, by channel."""
        return errors(self._check, sets)

    def floor(
        self, at: Array, rng: np.random.Generator, draws: int, spread: Array | None = None
    ) -> Mapping[str, Array]:
        """Return errors of a true model with knobs `at` (draws,), by channel."""
        return floor(self._check, at, spread, rng, draws)

    def overlays(self, before: Array, after: Array) -> tuple[Overlay, ...]:
        """Return the first check sweep: thrust over plate distance, speeds over time."""
        return overlays(self._check, before, after)

    def next_experiment(
        self, rivals: Sequence[tuple[str, Array]], rng: np.random.Generator
    ) -> NextExperiment | None:
        """Return the sweep that separates hypotheses best."""
        return next_sweep_experiment(self.evidence, rivals)


def _loaded_as(other: Power | None, log: SweepLog) -> SweepLog:
    """Return a sweep with the supply's load counted as in another, where both tell it."""
    if log.power is None or other is None:
        return log
    return replace(log, power=log.power.loaded_as(other))
