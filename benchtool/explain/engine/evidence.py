"""Evidence about model parameters: adjustable parameters, residuals, smooth discrepancies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import inf
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchtool.core.parameter import Parameter, Parameters, Prior
from benchtool.core.units import Array
from benchtool.physics.catalogue import EFFECTS, candidates
from benchtool.physics.effects.effect import BenchKind, Effect, Subsystem
from benchtool.physics.model import Model
from benchtool.physics.tolerances import model_tolerances


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaledParameter:
    """Adjustable parameter; a scaled value of 0 is the model as given, 1 is one `scale` above."""

    name: str  # full name of the model's parameter ("hinge_spring.stiffness_Nm_per_rad")
    unit: str
    effect: str  # "" for roughly known parameters (inertia, map from pulse width to speed)
    start: float  # value in the model as given
    scale: float  # tolerance of an effect's parameter; standard error of any other
    lower: float = -inf
    upper: float = inf
    held: bool = False  # roughly known: limited by its prior, without a tolerance
    first: float = 0.0  # initial value of a search, in scales

    @property
    def least(self) -> float:
        """Lower bound, in scales."""
        return (self.lower - self.start) / self.scale

    @property
    def most(self) -> float:
        """Upper bound, in scales."""
        return (self.upper - self.start) / self.scale

    def value(self, scaled: float) -> float:
        """Return the value of a scaled value."""
        return self.start + self.scale * scaled


def owner_parameter(
    name: str, item: Parameter, sd: float, lower: float, first: float = 0.0
) -> ScaledParameter:
    """Return a parameter of the bench, not of an effect; `sd` is its scale."""
    return ScaledParameter(
        name=name, unit=item.unit, effect="", start=item.value, scale=sd, lower=lower,
        upper=item.upper, held=True, first=first,
    )  # fmt: skip


def parameters_at(
    parameters: Parameters, moved: Sequence[ScaledParameter], scaled: Array
) -> Parameters:
    """Return parameters with some set to scaled values (n_parameters,), clipped to their bounds.

    Adjusted parameters that are not in the model belong to the bench and are ignored.
    """
    values = {
        item.name: min(max(item.value(z), item.lower), item.upper)
        for item, z in zip(moved, scaled.tolist(), strict=True)
    }
    return Parameters(
        (name, _with_value(item, values[name]) if name in values else item)
        for name, item in parameters.items()
    )


_with_value = lru_cache(maxsize=256)(Parameter.with_value)  # sets mostly differ in one parameter


def effect_parameters(
    model: Model,
    bench: BenchKind,
    extra: Sequence[Effect],
    min_values: Mapping[str, float] = MappingProxyType({}),
) -> list[ScaledParameter]:
    """Return the parameters of candidate effects that have a tolerance on a bench.

    `min_values` are lower bounds by full name that are above the parameters' own.
    """
    limits = model_tolerances(model, bench)
    names = {effect.name for effect in (*candidates(bench), *extra)}
    return [
        ScaledParameter(
            name=name,
            unit=item.unit,
            effect=name.split(".")[0],
            start=item.value,
            scale=limits[name],
            lower=max(item.lower, min_values.get(name, item.lower)),
            upper=item.upper,
        )
        for name, item in model.parameters.items()
        if name.split(".")[0] in names and name in limits
    ]


# Relative standard error of a fixed R_m without prior; two of them are 5 % of (R/4z)^2
RADIUS_KNOWN = 0.0125


def with_every_effect(model: Model, bench: BenchKind, extra: Sequence[Effect] = ()) -> Model:
    """Return the model with every adjustable effect of a bench, new ones at their neutral value."""
    present = {effect.name for effect in model.effects}
    for effect in moved_effects(bench, extra):
        if effect.name not in present:
            neutral = {p.name: p.neutral for p in effect.parameters if p.neutral is not None}
            model = model.with_effect(effect, **neutral)
    for effect in model.effects:
        shapes = shape_names(model, effect, bench)
        is_set = any(model.parameters[name].value != 0.0 for name in shapes)
        if effect.rig_values is None or (effect.name in present and (is_set or not shapes)):
            continue
        for name, value in effect.rig_values(model.rig).items():
            model = model.with_fixed(f"{effect.name}.{name}", value)
    return model


def moved_effects(bench: BenchKind, extra: Sequence[Effect] = ()) -> tuple[Effect, ...]:
    """Return the candidate effects, then those that are only adjusted."""
    adjusted = [effect for effect in EFFECTS.values() if bench in effect.adjusted_on]
    return (*candidates(bench), *sorted(adjusted, key=lambda effect: effect.name), *extra)


def shape_names(model: Model, effect: Effect, bench: BenchKind) -> list[str]:
    """Return full names of an effect's roughly known parameters, limited by their priors.

    Shape parameters of a candidate's law, or all parameters of an effect that is only adjusted.
    """
    limits = {} if bench in effect.adjusted_on else model_tolerances(model, bench)
    full = [f"{effect.name}.{p.name}" for p in effect.parameters if p.prior.kind == "normal"]
    return [name for name in full if name not in limits]


def all_shape_names(model: Model, bench: BenchKind, extra: Sequence[Effect] = ()) -> list[str]:
    """Return those of every effect on a bench: first of the adjusted ones, then by name."""
    effects = moved_effects(bench, extra)
    effects = tuple(sorted(effects, key=lambda effect: (bool(effect.benches), effect.name)))
    return [name for effect in effects for name in shape_names(model, effect, bench)]


RADIUS_FITTED = 0.05  # relative sd of R_m if fitted; assumed
K_KNOWN, K_FITTED = 0.01, 0.1  # relative sd of k: scale of the load cell, or fitted

_SHARES = {"k": (K_KNOWN, K_FITTED), "R_m": (RADIUS_KNOWN, RADIUS_FITTED)}


def known_prior(name: str, item: Parameter) -> Prior | None:
    """Return a parameter's normal prior in a sweep; else an assumed one for k and R_m, or None."""
    if item.prior.kind == "normal":
        return item.prior
    if name not in _SHARES:
        return None
    share = _SHARES[name][item.free]
    source = f"assumed by benchtool explain: {100.0 * share:g} % where none is stated"
    return Prior("normal", item.value, share * item.value, source)


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
        absent = [np.zeros(len(rows), bool) for rows in speed_masks]
        pairs = list(zip(regimes, absent, strict=True))
        names = dict.fromkeys(name for part in regimes for name in part)
        masks = {name: np.concatenate([p.get(name, none) for p, none in pairs]) for name in names}
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
