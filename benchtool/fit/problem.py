"""Estimation problem of both estimators: data, prediction, parameters and priors.

An estimator is a function from a problem to a `FitResult`. It does not modify the problem, is
deterministic for a seed, orders estimates as `Problem.free_names`, reports convergence in the
outcome, and raises `EstimationError` only without any result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.error_source import ErrorSource, Whitening, effective_dof
from benchtool.core.errors import InputError
from benchtool.core.parameter import Parameters
from benchtool.core.units import Array
from benchtool.physics.effects.effect import Effect

IntArray = NDArray[np.intp]

# predict(values) -> prediction: values (n_shape,) or (n_shape, w, 1), real or complex, in the order
# of `Problem.shape_names`; prediction (m,) or (w, m).
Predict = Callable[[Any], Any]

# Noise parameters change errors only; all others are shape parameters.
NOISE_SCALE = "noise.scale"  # multiplies standard errors of points and of scaled error sources
NOISE_SD = "noise.sd"  # prefix; adds in quadrature
NOISE_PLACE = "noise.place_m"  # standard deviation of a separate error source


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """Estimation problem: observations, prediction, parameters, priors.

    Attributes:
        groups: (m,) setting number of each point; `compare` holds out a setting together.
        covariates: (m,) each, for trends of residuals ("z_over_R", "time_s").
        error_sources: errors shared by points, in addition to `standard_error`.
        prior_parts: by parameter, the error sources of its prior (of a calibration), each with its
            share of the standard deviation as columns (1, 1). Their degrees of freedom make the
            prior normal or Student's t.
        facts: copied into the result (counts, hashes).
        missing: missing(covariate) -> effects that can explain a trend of residuals over it.
    """

    model: str  # name for results
    parameters: Parameters  # all parameters; the free ones are estimated
    predict: Predict  # see `Predict`
    observed: Array  # (m,) observations
    standard_error: Array  # (m,) stated standard errors, above 0 and independent
    error_sources: tuple[ErrorSource, ...] = ()
    basis: str = "joint"  # quantity at which thrusts are compared, or "joint"
    labels: tuple[str, ...] = ()  # (m,) names of the points for messages; numbered by default
    groups: IntArray | None = None
    covariates: Mapping[str, Array] = field(default_factory=dict)
    prior_parts: Mapping[str, tuple[ErrorSource, ...]] = field(default_factory=dict)
    facts: Mapping[str, str | int | float | bool | None] = field(default_factory=dict)
    missing: Callable[[str], Sequence[Effect]] = lambda covariate: ()

    def __post_init__(self) -> None:
        m = len(self.observed)
        sizes = {
            "standard_error": len(self.standard_error),
            "labels": len(self.labels) or m,
            "groups": m if self.groups is None else len(self.groups),
            **{name: len(column) for name, column in self.covariates.items()},
            **{source.name: len(source.columns) for source in self.error_sources},
        }
        for name, size in sizes.items():
            if size != m:
                raise InputError(f"{m} points were observed, but {name} has {size} entries")
        if not self.shape_names:
            raise InputError(
                f"model {self.model!r} has no free parameter that changes its prediction; free one "
                f"of: {', '.join(name for name in self.parameters if not _is_noise(name))}"
            )
        if sum(_is_noise(name) for name in self.parameters.free_names) > 1:
            free = [name for name in self.parameters.free_names if _is_noise(name)]
            raise InputError(f"{' and '.join(free)} are both free; allowed: one; fix the other")
        if self.noise_name == NOISE_PLACE and not any(
            source.parameter == NOISE_PLACE for source in self.error_sources
        ):
            raise InputError(
                f"{NOISE_PLACE} is free, but no point depends on the plate position; fix it, or "
                f"measure nearer to the plate"
            )
        for i in np.flatnonzero(~np.isfinite(self.observed))[:1]:
            raise InputError(
                f"observation of {self.label(int(i))} is {self.observed[i]}; remove the point"
            )
        bad = ~(np.isfinite(self.standard_error) & (self.standard_error > 0.0))
        for i in np.flatnonzero(bad)[:1]:
            raise InputError(
                f"standard error of {self.label(int(i))} is {self.standard_error[i]:g}; allowed: "
                f"above 0; use the scatter of repeats, or 1 with noise.scale free"
            )

    def __len__(self) -> int:
        return len(self.observed)

    def label(self, point: int) -> str:
        """Return the name of a point for messages."""
        return self.labels[point] if self.labels else f"point {point + 1}"

    # --- parameters -----------------------------------------------------------------------

    @cached_property
    def free_names(self) -> tuple[str, ...]:
        """Full names of all free parameters (n_free,), in the order of every result."""
        return self.parameters.free_names

    @cached_property
    def shape_names(self) -> tuple[str, ...]:
        """Free parameters that change the prediction (n_shape,), in order."""
        return tuple(name for name in self.parameters.free_names if not _is_noise(name))

    @cached_property
    def noise_name(self) -> str | None:
        """The free noise parameter, if there is one."""
        return next((name for name in self.free_names if _is_noise(name)), None)

    @cached_property
    def shape_index(self) -> IntArray:
        """Positions of the shape parameters among the free ones (n_shape,)."""
        return np.array([self.free_names.index(name) for name in self.shape_names], np.intp)

    @cached_property
    def start(self) -> Array:
        """Initial values of the shape parameters (n_shape,)."""
        return self.parameters.pack()[self.shape_index]

    @cached_property
    def shape_bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the shape parameters, (n_shape,) each."""
        lower, upper = self.parameters.bounds()
        return lower[self.shape_index], upper[self.shape_index]

    @cached_property
    def priors(self) -> PriorRows:
        """All normal priors on the shape parameters; those of calibrations first."""
        free, parameters = self.shape_names, self.parameters
        names = [name for name in free if parameters[name].prior.kind == "normal"]
        names.sort(key=lambda name: not name.startswith("calibration."))
        matrix, mean, parts = np.zeros((len(names), len(free))), np.zeros(len(free)), []
        for row, name in enumerate(names):
            position, prior = free.index(name), parameters[name].prior
            matrix[row, position], mean[position] = 1.0 / prior.sd, prior.mean
            source = ErrorSource(
                name=name, kind="B", unit=parameters[name].unit, columns=np.eye(1),
                sd=1.0 / float(matrix[row, position]), origin=prior.source or "prior of the model",
            )  # fmt: skip
            parts.append(self.prior_parts.get(name) or (source,))
        return PriorRows(tuple(names), matrix, mean, tuple(parts))

    @cached_property
    def dof(self) -> int:
        """Rows (points and normal priors) less shape parameters."""
        return len(self) + len(self.priors) - len(self.shape_names)

    # --- residuals ------------------------------------------------------------------------

    def _scale_and_sd(self, noise: float | None) -> tuple[float, float]:
        scale, extra_sd = 1.0, 0.0
        for name, parameter in self.parameters.items():
            if _is_noise(name):
                value = noise if noise is not None and name == self.noise_name else parameter.value
                if name == NOISE_SCALE:
                    scale = value
                elif name != NOISE_PLACE:
                    extra_sd = value
        return scale, extra_sd

    def sigma(self, noise: float | None = None) -> Array:
        """Return the independent errors (m,) at a value of the free noise parameter.

        None means its initial value. Fixed noise parameters keep their value.
        """
        scale, extra_sd = self._scale_and_sd(noise)
        if extra_sd == 0.0:
            return self.standard_error * scale
        quadrature: Array = np.hypot(self.standard_error * scale, extra_sd)
        return quadrature

    def shared_by_source(self, noise: float | None = None) -> list[Array]:
        """Return the columns (m, r) of each error source at a value of the free noise parameter."""
        scale, _ = self._scale_and_sd(noise)
        columns = []
        for source in self.error_sources:
            factor = scale if source.scaled else 1.0
            if source.parameter and source.parameter == self.noise_name:
                value = self.parameters[source.parameter].value if noise is None else noise
                factor = value / source.sd
            columns.append(source.columns * factor)
        return columns

    def shared(self, noise: float | None = None) -> Array:
        """Return the columns (m, r) of all error sources, see `shared_by_source`."""
        return np.concatenate([np.empty((len(self), 0)), *self.shared_by_source(noise)], axis=1)

    def whitening(self, noise: float | None = None, factor: float = 1.0) -> Whitening:
        """Return the whitening of residuals at a value of the free noise parameter.

        Independent errors are multiplied by `factor`.
        """
        scale, extra_sd = self._scale_and_sd(noise)
        if extra_sd or self.noise_name == NOISE_PLACE or any(s.scaled for s in self.error_sources):
            return Whitening(factor * self.sigma(noise), self.shared(noise))
        return self._stated_whitening.scaled(factor * scale)

    @cached_property
    def _stated_whitening(self) -> Whitening:
        """Whitening at a scale of 1, without further independent errors."""
        return Whitening(self.standard_error, self.shared())

    def split(self, values: Array) -> tuple[Array, float | None]:
        """Return shape values (n_shape,) and noise of all free values (n_free,)."""
        if self.noise_name is None:
            return values, None
        return values[self.shape_index], float(values[self.free_names.index(self.noise_name)])

    def residuals(self, values: Array) -> Array:
        """Return observed less predicted (m,) at all free values (n_free,)."""
        return self.observed - self.predicted(self.split(values)[0])

    @property
    def stated_noise(self) -> float:
        """Value of the free noise parameter at which errors equal the stated ones."""
        if self.noise_name == NOISE_PLACE:
            return self.parameters[NOISE_PLACE].value
        return 1.0 if self.noise_name == NOISE_SCALE else 0.0

    def quality(self, values: Array) -> tuple[float, float]:
        """Return chi-square at the stated errors and log likelihood at the fitted ones (n_free,).

        Chi-square includes the priors, the likelihood the points only.
        """
        (shape, noise), residuals = self.split(values), self.residuals(values)
        rows = self.whitening(self.stated_noise)(residuals)
        prior = self.priors.matrix @ (shape - self.priors.mean)
        fitted = self.whitening(noise)
        density = normal_log_density(fitted(residuals), fitted.sigma)
        return float(rows @ rows + prior @ prior), float(density.sum()) - fitted.log_root_excess

    def predicted(self, shape: Array) -> Array:
        """Return the prediction (m,) at shape values (n_shape,)."""
        return np.broadcast_to(np.asarray(self.predict(shape), float), self.observed.shape)

    def rows(self, shape: Array, whitening: Whitening) -> Array:
        """Return whitened residuals (m + q,): points first, then the rows of the priors."""
        data = whitening(np.asarray(self.predict(shape) - self.observed, float))
        if not len(self.priors):
            return data
        return np.concatenate([data, self.priors.matrix @ (shape - self.priors.mean)])

    # --- variations -----------------------------------------------------------------------

    def at(self, values: Array) -> Problem:
        """Return the problem with these free values (n_free,) as initial values."""
        return replace(self, parameters=self.parameters.with_values(values))

    def fixed(self, name: str, value: float) -> Problem:
        """Return the problem with one free parameter fixed at `value`."""
        parameters = self.parameters.with_replaced(name, self.parameters[name].as_fixed(value))
        if _is_noise(name):
            return replace(self, parameters=parameters)
        position = self.shape_names.index(name)
        predict_free = self.predict

        def predict(values: Any) -> Any:
            return predict_free(np.insert(values, position, value, axis=0))

        return replace(self, parameters=parameters, predict=predict)

    def subset(self, rows: IntArray) -> Problem:
        """Return the problem with a subset of the points."""
        predict_all, m = self.predict, len(self)

        def predict(values: Any) -> Any:
            whole = np.asarray(predict_all(values))
            return np.broadcast_to(whole, (*whole.shape[:-1], m))[..., rows]

        return replace(
            self,
            predict=predict,
            observed=self.observed[rows],
            standard_error=self.standard_error[rows],
            error_sources=tuple(source.select(rows) for source in self.error_sources),
            labels=tuple(self.label(int(i)) for i in rows),
            groups=None if self.groups is None else self.groups[rows],
            covariates={name: column[rows] for name, column in self.covariates.items()},
        )


def normal_log_density(whitened: Array, sigma: Array) -> Array:
    """Return the log density (m,) of normal residuals of standard deviation sigma (m,)."""
    density: Array = -0.5 * whitened**2 - np.log(sigma) - 0.5 * np.log(2.0 * np.pi)
    return density


def _is_noise(name: str) -> bool:
    return name in (NOISE_SCALE, NOISE_PLACE) or name.startswith(NOISE_SD)


@dataclass(frozen=True, eq=False)
class PriorRows:
    """All priors as rows (q,) = matrix (q, n) @ (values - mean).

    Rows have variance one; a row with finite `dof` is Student's t with scale one.
    """

    names: tuple[str, ...]  # (q,) parameter of each row
    matrix: Array
    mean: Array
    parts: tuple[tuple[ErrorSource, ...], ...]  # (q,) error sources of each row

    @cached_property
    def dof(self) -> Array:
        """Degrees of freedom of each row's variance (q,)."""
        shares = [np.array([part.columns.item() for part in row]) for row in self.parts]
        dofs = [np.array([part.dof for part in row]) for row in self.parts]
        return np.array([effective_dof(*row) for row in zip(shares, dofs, strict=True)])

    @cached_property
    def estimated(self) -> tuple[Array, ...]:
        """Indices of the rows with finite `dof`, grouped by a common scatter estimate."""
        groups: dict[str, list[int]] = {}
        for row in np.flatnonzero(np.isfinite(self.dof)):
            name = next((part.scatter for part in self.parts[row] if part.scatter), f"row {row}")
            groups.setdefault(name, []).append(int(row))
        return tuple(np.array(rows) for rows in groups.values())

    def __len__(self) -> int:
        return len(self.names)
