"""Findings of an explanation: effects with parameters, gaps, curves, the next experiment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Literal

from benchtool.core.parameter import Parameters
from benchtool.core.schedule import Schedule
from benchtool.core.units import Array
from benchtool.physics.effects.effect import Subsystem

Unjudged = Literal["too_weak", "no_trace", "not_tried"]  # size: larger; none; no candidate
UNDETECTABLE = 100.0  # tolerances; an effect with a larger detection limit leaves no trace
DECISION_PROBABILITY = 1.0  # min expected log evidence ratio of a decisive experiment; assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundParameter:
    """Parameter of a named effect."""

    name: str  # without the effect ("torque_Nm")
    unit: str  # of all values
    value: float  # most probable value
    std: float  # standard deviation, with all other effects free within their tolerances
    low: float  # of a 95 % interval; if not determined, of the physical range
    high: float
    tolerance: float
    neutral: float  # value without the effect
    determined: bool = True  # False: the data do not reduce the physical range

    @property
    def text(self) -> str:
        """Value with standard deviation and unit."""
        if not self.determined:
            return f"not determined ({self.low:.3g} to {self.high:.3g})"
        return f"{self.value:.4g} ± {self.std:.2g} {self.unit}".removesuffix(" 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedEffect:
    """Effect named by an explanation."""

    name: str  # in the library
    title: str
    phrase: str  # the title within a sentence
    stage: Subsystem
    probability: float  # of the effect beyond its tolerance
    parameters: tuple[FoundParameter, ...]
    log_likelihood_ratio: float  # against the same model with the effect within its tolerance
    p_value: float  # of that ratio under the null


@dataclass(frozen=True, slots=True, kw_only=True)
class AlternativeEffects:
    """Alternatives to one named effect, the other effects given."""

    effect: str  # the most probable one
    probabilities: Mapping[str, float]  # of every effect, "none" and "unknown"; they sum to 1


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceLocation:
    """Location of the gap between model and measurement."""

    stage: Subsystem
    regime: str  # part of the recording with the densest gap, as text
    size: float  # rms of residuals there, in standard deviations of the stated noise
    share: float  # of the whole gap in this regime


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelGap:
    """Prediction error of one channel on the validation recordings, root mean square.

    Intervals before and after are 95 % of a block bootstrap over windows.
    """

    channel: str
    unit: str  # of all values
    as_given: float  # of the model file
    before: float  # of the model adjusted within uncertainties and tolerances
    after: float  # with the named effects added; equal to `before` without any
    floor: float  # of a true model, median over draws of the stated noise
    floor_low: float
    floor_high: float
    before_low: float
    before_high: float
    after_low: float
    after_high: float

    @property
    def share_closed(self) -> float:
        """Share of the gap above the floor closed by the named effects; 0 without a gap."""
        total = self.before**2 - self.floor**2
        if total <= 0.0:
            return 0.0
        return (self.before**2 - self.after**2) / total


@dataclass(frozen=True, slots=True, kw_only=True)
class NearestEffect:
    """Effect that explains most of an unnamed effect."""

    effect: NamedEffect  # with its best parameters
    share_closed: float
    parameters: Parameters  # of the model with it
    after: Mapping[str, float]  # validation errors by channel


@dataclass(frozen=True, slots=True, kw_only=True)
class UnnamedEffect:
    """Discrepancy beyond tolerance that no effect explains."""

    name: str
    stage: Subsystem
    phrase: str  # within a sentence
    probability: float
    share: float  # largest size, as a share of the reading
    tolerances: float  # the same in tolerances
    weight: float  # sum of squared residuals explained

    @property
    def text(self) -> str:
        """Description with size."""
        size = f"{100.0 * self.share:.2g} % of the reading ({self.tolerances:.1f} tolerances)"
        return f"{self.phrase}, up to {size}"


@dataclass(frozen=True, slots=True, kw_only=True)
class UnjudgedEffect:
    """Effect that the data cannot detect."""

    reason: Unjudged
    size: float  # detection limit in tolerances; inf if undetectable

    @classmethod
    def below(cls, size: float) -> UnjudgedEffect:
        """Return an unjudged effect with its detection limit in tolerances."""
        if size > UNDETECTABLE:
            return cls(reason="no_trace", size=inf)
        return cls(reason="too_weak", size=size)


@dataclass(frozen=True, slots=True, kw_only=True)
class NextExperiment:
    """Proposed next experiment."""

    candidates: tuple[str, ...]  # to be separated, most probable first
    title: str  # one line
    reason: str  # why the experiment separates them
    schedule: Schedule | None  # commands of a pitch experiment; None for a sweep
    plan_toml: str  # of a sweep; "" for a pitch experiment
    expected: Mapping[str, float]  # log evidence ratios of the first over each other candidate
    minutes: float = 0.0  # duration

    @property
    def is_decisive(self) -> bool:
        """True if it should separate the most probable candidate from another."""
        return max(self.expected.values()) >= DECISION_PROBABILITY


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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Disagreement:
    """Residuals by regime, for the figure."""

    stage: Subsystem
    by_regime: Mapping[str, float]  # root mean square of the whitened residuals; 1 is noise
    after: Mapping[str, float]  # the same with the named effects
