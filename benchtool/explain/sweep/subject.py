"""Plate sweeps as the subject of an explanation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.core.recording import Recording
from benchtool.explain.engine.explanation import Overlay
from benchtool.explain.engine.subject import ChannelErrors
from benchtool.explain.engine.verdict import NextExperiment
from benchtool.explain.sweep.evidence import SweepEvidence
from benchtool.explain.sweep.gap import RPM, errors, floor
from benchtool.explain.sweep.log import SweepLog, sweep_log
from benchtool.explain.sweep.next_experiment import next_sweep_experiment
from benchtool.explain.sweep.power import Power
from benchtool.physics.effects.effect import BenchKind, Effect
from benchtool.physics.model import Model

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
        """What was repaired in the sweeps, and what they lack."""
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
        """Return errors of a true model with parameters `at` (draws,), by channel."""
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
    """Return a sweep with the supply's load counted as in another, where both have it."""
    if log.power is None or other is None:
        return log
    return replace(log, power=log.power.loaded_as(other))


SAME_LOAD = 0.02
"""Squared speeds within this share of each other are one level, for the picture; a choice."""

FARTHEST_Z_OVER_R = 12.0
"""A plate farther away than this is drawn here: nothing of it shows."""


def overlays(check: SweepEvidence, before: Array, after: Array) -> tuple[Overlay, ...]:
    """Return the first check sweep with parameters before and after (n_parameters,) each.

    Rows are sorted by level and distance; lines break between levels.
    """
    log = check.logs[0]
    sets = np.vstack([before, after])
    running = ~log.tare
    shown = check.thrusts(log.conditions, sets)[running]
    ratio, level = _z_over_R(log, check)[running], _levels(log)[running]
    out = [_overlay("thrust_N", "N", "z_over_R", ratio, level, log.thrust_N[running], shown)]
    if log.power is not None:
        power = log.power
        late = power.late
        out.append(
            _overlay(
                "rpm", "rpm", "time_s", power.time_s[late], power.level[late],
                RPM * power.speed_rad_s[late], RPM * check.predicted(log, sets).mean(axis=0)[late],
            )
        )  # fmt: skip
    return tuple(out)


def _z_over_R(log: SweepLog, check: SweepEvidence) -> Array:
    """Return plate distance over radius (m,), at most `FARTHEST_Z_OVER_R`."""
    ratio = log.conditions.plate_z_m / check.model.rig.propulsion.radius_m
    return np.minimum(ratio, FARTHEST_Z_OVER_R)


def _levels(log: SweepLog) -> NDArray[np.intp]:
    """Return the number of each row's level of throttle (m,)."""
    squares = np.sum(log.conditions.speed_rad_s**2, axis=0)
    order = np.argsort(squares)
    steps = np.diff(squares[order]) > SAME_LOAD * squares[order][1:]
    numbers = np.empty(len(squares), np.intp)
    numbers[order] = np.concatenate([[0], np.cumsum(steps)])
    return numbers


def _overlay(
    channel: str,
    unit: str,
    axis: str,
    at: Array,
    level: NDArray[np.intp],
    measured: Array,
    shown: Array,
) -> Overlay:
    """Return rows in the order of level and place, with nan between levels."""
    pieces = []
    for number in np.unique(level):
        rows = np.flatnonzero(level == number)
        rows = rows[np.argsort(at[rows], kind="stable")]
        pieces.append(np.column_stack([at, measured, shown])[rows])
        pieces.append(np.full((1, 4), np.nan))
    table = np.concatenate(pieces)
    return Overlay(
        channel=channel,
        unit=unit,
        axis=axis,
        at=table[:, 0],
        measured=table[:, 1],
        before=table[:, 2],
        after=table[:, 3],
    )
