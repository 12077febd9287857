"""Evidence about model parameters: residuals, smooth discrepancies, and the recordings behind."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.explain.engine.parameters import ScaledParameter
from benchtool.explain.findings import NextExperiment, Overlay
from benchtool.explain.law_search.search import ResidualSummary
from benchtool.explain.recording_checks import check_bench_kind
from benchtool.physics.effects.effect import BenchKind, Effect, Subsystem
from benchtool.physics.model import Model

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


WITHIN = 1.0 / 3.0  # prior sd of a discrepancy over its tolerance, as for effects within tolerance
HALF_Z_OVER_R = 3.0  # distance at which a plate discrepancy is halved; assumed

STAGES: Mapping[str, Subsystem] = {  # by channel of a discrepancy
    "thrust": "rpm_to_thrust",
    "speed": "pwm_to_rpm",
    "torque": "hinge",
    "reading": "sensor",
}
VISIT = "thrust: visit"
PHRASES = {  # meaning of a discrepancy beyond tolerance, by name
    "thrust: distance": "a different law of thrust against distance",
    VISIT: "something that changes from visit to visit",
    "torque: distance": "a different law of thrust against distance",
    "torque: angle": "a torque that depends on the angle",
    "torque: rate": "a torque that depends on the rate",
    "torque: thrust": "a torque that depends on the thrust",
    "torque: time": "a torque that changes with time",
    "reading: angle": "an encoder's error that depends on the angle",
    "reading: rate": "a gyro's error that depends on the rate",
}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Discrepancy:
    """Smooth deviation of the data from every law in the model.

    Linear in the residuals with a Gaussian prior (Kennedy and O'Hagan, J. R. Stat. Soc. B 63,
    2001): a low-rank addition to their covariance. Within its tolerance it is part of every
    hypothesis, like effects within theirs; beyond, it competes with them as an unnamed effect.
    """

    name: str  # "channel: variable"
    columns: Array  # (n_rows, r) change of the whitened residuals by each of r independent draws
    shares: Array  # (n_rows, r) the same, as a share of readings
    readings: Array | None = None  # (n_rows, r) the same, in readings; None if unknown

    @property
    def stage(self) -> Subsystem:
        """Stage of its channel."""
        return STAGES[self.name.partition(": ")[0]]

    @property
    def phrase(self) -> str:
        """Its meaning beyond tolerance, within a sentence."""
        channel, _, variable = self.name.partition(": ")
        return PHRASES.get(self.name, f"a {channel} error that depends on {variable}")

    @property
    def always(self) -> bool:
        """True if it is present within its tolerance, too; False: only beyond."""
        return self.name != VISIT


MIN_EIGENVALUE = 1e-4  # of a covariance, over the largest one; smaller ones are dropped
STEP = 0.01  # rounding of points, in correlation lengths


def smooth_root(points: Array, step: float = STEP) -> Array:
    """Return the root (m, r) of the covariance of a unit Gaussian process at points (m, d)."""
    rounded = np.round(np.nan_to_num(points) / step) * step
    unique, rows = np.unique(rounded, axis=0, return_inverse=True)
    result: Array = _root(unique.tobytes(), unique.shape[1])[rows.reshape(-1)]
    return result


@lru_cache(maxsize=64)
def _root(points: bytes, width: int) -> Array:
    """Return the root (n, r) at points (n, width), cached: designs repeat them."""
    unique = np.frombuffer(points).reshape(-1, width)
    squares = np.sum((unique[:, None] - unique[None]) ** 2, axis=2)
    size, axes = np.linalg.eigh(np.exp(-0.5 * squares))
    is_kept = size > MIN_EIGENVALUE * size[-1]
    root: Array = axes[:, is_kept] * np.sqrt(size[is_kept])
    return root


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


# Unit of a gap, by channel
CHANNEL_UNITS = {"thrust_N": "N", "theta_rad": "rad", "gyro_rad_s": "rad/s", "rpm": "rpm"}


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
    # Experiment that separates rivals (evidence, rivals, rng, stage of an unnamed effect, minutes)
    propose: ClassVar[Callable[..., NextExperiment]]
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
