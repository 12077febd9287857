"""Propagation of a fit's errors to derived quantities and to its budget.

With whitened Jacobian J and covariance C of a fit, the gain C J^T propagates each source's columns
to the estimates. Sources within the fit reproduce its covariance; fixed parameters of uncertain
value and errors of laws are added. Monte Carlo checks the linear propagation (JCGM 101:2008): each
draw adds errors to the prediction of the fitted model and to the priors and refits the full model.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from benchtool.core.error_source import ErrorSource, Whitening
from benchtool.core.errors import EstimationError
from benchtool.core.fit_result import Estimate, FitResult
from benchtool.core.parameter import Parameter
from benchtool.core.units import Array
from benchtool.fit.problem import Problem
from benchtool.fit.solve import (
    DerivativeMethod,
    derivative_method,
    derivatives,
    estimate_covariance,
    row_jacobian,
    select_method,
)
from benchtool.fit.statistics import from_draws, half_widths, interval_around
from benchtool.fit.uncertainty.budget import COVERAGE, Budget, BudgetLine, MonteCarlo
from benchtool.physics.effects.effect import Derived

ORIGINS = {"A": "scatter of the data", "B": "stated by the rig"}  # defaults
POINTS = "scatter of the points"  # name of the scatter shared by `repeat` and bounded sources
MIN_CONTRIBUTION = 1e-4  # of a source, relative to every combined uncertainty

DRAWS = 2000  # ends of the 95 % interval then scatter by some 4 % of its half width
CLOSE = 1e-4  # step of a converged refit, in standard deviations
MAX_STEPS = 20  # Gauss-Newton steps of a refit; two or three are typical


def with_derived(result: FitResult, quantities: Sequence[Derived]) -> FitResult:
    """Return the result with derived quantities.

    Least squares uses the delta method with exact derivatives; emcee evaluates every draw. A
    quantity has notes on inputs at a bound or not determined.
    """
    derived = []
    for quantity in quantities:
        is_sampled = len(result.samples) > 0
        estimate = (_from_draws if is_sampled else _from_covariance)(quantity, result)
        values = _AccessRecorder({item.name: item.value for item in result.estimates})
        quantity.function(values)
        inputs = [item for item in result.estimates if item.name in values.names]
        bound = "; ".join(f"{item.name} {item.bound}" for item in inputs if item.bound)
        open_ = "; ".join(f"{item.name} is not" for item in inputs if item.open) or estimate.open
        derived.append(replace(estimate, bound=bound, open=open_))
    return replace(result, derived=(*result.derived, *derived))


class _AccessRecorder(dict[str, float]):
    """Mapping that records the names of the values that are read."""

    def __init__(self, values: Mapping[str, float]) -> None:
        super().__init__(values)
        self.names: set[str] = set()

    def __getitem__(self, name: str) -> float:
        self.names.add(name)
        return super().__getitem__(name)


def _from_draws(quantity: Derived, result: FitResult) -> Estimate:
    draws = _evaluate(quantity, result, result.samples.T)
    finite = np.broadcast_to(np.asarray(draws, float), (len(result.samples),))
    if not np.all(np.isfinite(finite)):
        raise EstimationError(
            f"{quantity.name} has no finite value for {np.sum(~np.isfinite(finite))} of "
            f"{len(finite)} draws; narrow the bounds of its parameters"
        )
    return from_draws(quantity.name, Parameter(quantity.name, quantity.unit, 0.0), finite)


def _evaluate(quantity: Derived, result: FitResult, values: Any) -> Any:
    """Return a quantity at values (n_free, ...) of the estimates."""
    names = (estimate.name for estimate in result.estimates)
    return np.asarray(quantity.function(dict(zip(names, values, strict=True))))


def delta_gradient(quantity: Derived, result: FitResult) -> Array:
    """Return the gradient (n_free,) of a quantity with respect to the estimates."""
    values, predict = result.values, partial(_evaluate, quantity, result)
    unbounded = np.full(len(values), np.inf)
    method = select_method(predict, values, 1, -unbounded, unbounded)
    gradient: Array = derivatives(predict, values, 1, (-unbounded, unbounded), method)[0]
    return gradient


def _from_covariance(quantity: Derived, result: FitResult) -> Estimate:
    gradient = delta_gradient(quantity, result)
    used = gradient != 0.0
    covariance = result.covariance[np.ix_(used, used)]
    sd = float(np.sqrt(gradient[used] @ covariance @ gradient[used]))
    has_noise = any(estimate.name.startswith("noise.") for estimate in result.estimates)
    return interval_around(
        quantity.name,
        Parameter(quantity.name, quantity.unit, 0.0),
        float(_evaluate(quantity, result, result.values)),
        sd,
        half_widths(result.dof if has_noise else np.inf),
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Propagation:
    """Linear propagation of errors to a fit's quantities: shape parameters, then derived ones."""

    problem: Problem
    items: tuple[Estimate, ...]  # (n,) estimates of the quantities
    derived: tuple[Derived, ...]  # functions of the derived quantities
    shape: Array  # (n_shape,) linearisation point
    sd: Array  # (n_shape,) standard deviations there
    noise: float | None
    whitening: Whitening
    method: DerivativeMethod  # of derivatives
    gain: Array  # (n, m + q) change of the quantities by whitened rows: points, then priors
    outside: tuple[ErrorSource, ...] = ()  # of the observations, not in the fit's covariance
    # Errors by their only quantity; columns (1, 1) in its unit.
    quantity_errors: Mapping[str, ErrorSource] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities (n,)."""
        return tuple(item.name for item in self.items)

    def changes(self, columns: Array) -> Array:
        """Return the changes (n, r) of the quantities by columns (m, r) of the observations."""
        quantity_changes: Array = self.gain[:, : len(self.problem)] @ self.whitening(columns)
        return quantity_changes

    def quantities(self, shapes: Array) -> Array:
        """Return the quantities (w, n) at shape values (w, n_shape)."""
        values = dict(zip(self.problem.shape_names, shapes.T, strict=True))
        derived = [np.broadcast_to(item.function(values), len(shapes)) for item in self.derived]
        return np.column_stack([shapes, *derived])


def propagate(
    problem: Problem, result: FitResult, derived: Sequence[Derived] = ()
) -> Propagation | None:
    """Return the propagation of errors to a result's quantities; None if one is undetermined."""
    shape, noise = problem.split(result.values)
    # A robust loss inflates the independent errors by this factor.
    whitening = problem.whitening(noise, float(result.facts.get("loss_factor") or 1.0))
    method = derivative_method(problem, shape)
    jacobian = row_jacobian(problem, method, shape, whitening)
    uncertainty = estimate_covariance(jacobian, method)
    if uncertainty.undetermined or not np.isfinite(result.covariance).all():
        return None
    index = problem.shape_index
    gradients = [delta_gradient(item, result)[index] for item in derived]
    slopes = np.stack([*np.eye(len(shape)), *gradients])
    return Propagation(
        problem=problem,
        items=(*(result.estimates[i] for i in index), *(result[item.name] for item in derived)),
        derived=tuple(derived),
        shape=shape,
        sd=np.sqrt(np.diag(uncertainty.covariance)),
        noise=noise,
        whitening=whitening,
        method=method,
        gain=slopes @ uncertainty.covariance @ jacobian.T,
    )


def bound_sources(linear: Propagation, sources: Sequence[ErrorSource]) -> tuple[ErrorSource, ...]:
    """Return sources of one column, each reduced to its bound from the residuals if smaller.

    All errors are estimated jointly with their stated priors: of two sources with the same effect
    on residuals, neither is bounded. The error is relative to the fixed value (error 0).
    """
    if not sources:
        return ()
    problem = linear.problem
    columns = np.concatenate([source.columns for source in sources], axis=1)
    residuals = -problem.rows(linear.shape, linear.whitening)
    inflation = max(float(residuals @ residuals) / max(problem.dof, 1), 1.0) ** 0.5
    rows = np.pad(linear.whitening(columns), ((0, len(problem.priors)), (0, 0))) / inflation
    fitted = linear.gain[: len(linear.shape)] / linear.sd[:, None]
    free_rows = rows - np.linalg.pinv(fitted) @ (fitted @ rows)
    posterior = np.linalg.inv(np.eye(len(sources)) + free_rows.T @ free_rows)
    information = np.maximum(1.0 - np.diag(posterior), 1e-300)  # of the residuals on each error
    draw = posterior @ (free_rows.T @ residuals) / inflation / information
    sd = np.sqrt(np.diag(posterior) / information)
    dof = np.inf if problem.noise_name is None else float(problem.dof)
    return tuple(
        source
        if share >= 1.0
        else replace(
            source, kind="A", sd=share * source.sd, columns=share * source.columns, dof=dof,
            distribution="student_t", scatter=POINTS,
            origin=f"residuals of this run: {value * source.sd:.2g} ± {own_sd * source.sd:.2g}; "
            f"without them {source.sd:.2g}, {source.origin}",
        )
        for source, share, value, own_sd in zip(sources, np.hypot(draw, sd), draw, sd, strict=True)
    )  # fmt: skip


def make_budget(linear: Propagation, traceability: Sequence[str] = ()) -> Budget:
    """Return the budget of a fit."""
    parts = [*_fit_sources(linear)]
    parts += [_line(source, linear.changes(source.columns), False) for source in linear.outside]
    for name, source in linear.quantity_errors.items():
        selection = np.array([[1.0 if name == other else 0.0] for other in linear.names])
        parts.append(_line(source, selection @ source.columns, False))
    covariance = sum(changes @ changes.T for _, changes in parts)
    sd = np.sqrt(np.diag(covariance))
    parts = [(line, _) for line, _ in parts if np.any(line.contribution > MIN_CONTRIBUTION * sd)]
    return Budget(
        names=linear.names,
        units=tuple(estimate.unit for estimate in linear.items),
        values=tuple(estimate.value for estimate in linear.items),
        fit_sd=tuple(estimate.sd for estimate in linear.items),
        lines=tuple(line for line, _ in parts),
        correlation=tuple(map(tuple, (covariance / np.outer(sd, sd)).tolist())),
        traceability=tuple(traceability),
    )


def _line(
    source: ErrorSource, changes: Array, in_fit: bool, correlation: str = ""
) -> tuple[BudgetLine, Array]:
    size = np.linalg.norm(changes, axis=1)
    draws = changes.shape[1]
    line = BudgetLine(
        name=source.name,
        kind=source.kind,
        unit=source.unit,
        sd=source.sd,
        # The sum of many errors is normally distributed.
        distribution="normal" if draws > 1 and source.dof == np.inf else source.distribution,
        dof=source.dof,
        scatter=source.scatter,
        correlation=correlation or ("all points share it" if draws == 1 else f"{draws} draws"),
        origin=source.origin or ORIGINS[source.kind],
        in_fit=in_fit,
        contribution=tuple(size.tolist()),
        sensitivity=tuple(((changes[:, 0] if draws == 1 else size) / source.sd).tolist()),
    )
    return line, changes


def _fit_sources(linear: Propagation) -> Iterator[tuple[BudgetLine, Array]]:
    """Yield the sources of the fit's covariance, with their changes (n, r)."""
    problem, m = linear.problem, len(linear.problem)
    sigma = linear.whitening.sigma
    repeat = ErrorSource(
        name="repeat",
        kind="A",
        unit="N" if problem.basis == "joint" else "1",
        sd=float(np.sqrt(np.mean(sigma**2))),
        columns=sigma[:, None],
        origin="stated errors",
    )
    if problem.noise_name is not None:
        repeat = replace(
            repeat, origin=f"scatter of the points: {problem.noise_name} fitted",
            dof=float(problem.dof), distribution="student_t", scatter=POINTS,
        )  # fmt: skip
    # One error per point: gain times the whitened diagonal matrix, without building it.
    changes = linear.whitening((linear.gain[:, :m] * sigma).T).T
    yield _line(repeat, changes, True, "each point its own")
    shared = problem.shared_by_source(linear.noise)
    for source, columns in zip(problem.error_sources, shared, strict=True):
        yield _line(source, linear.changes(columns), True)
    priors = problem.priors
    for row, (name, parts) in enumerate(zip(priors.names, priors.parts, strict=True), m):
        is_calibration = name in problem.prior_parts
        correlation = "all points of the calibration share it" if is_calibration else ""
        for source in parts:
            yield _line(source, linear.gain[:, row, None] @ source.columns, True, correlation)


def monte_carlo(
    linear: Propagation,
    *,
    draws: int = DRAWS,
    seed: int = 1,
    progress: Callable[[str, int, int], None] = lambda what, done, expected: None,
) -> MonteCarlo:
    """Return deviations of refits from the fit's values."""
    rng, problem = np.random.default_rng(seed), linear.problem
    m, shared = len(problem), problem.shared_by_source(linear.noise)
    errors = []
    for _ in range(draws):
        factor = 1.0  # common scale of errors with fitted noise (JCGM 101, 6.4.9)
        if problem.noise_name is not None:
            factor = float(np.sqrt(problem.dof / rng.chisquare(problem.dof)))
        error = factor * linear.whitening.sigma * rng.standard_normal(m)
        scales = {POINTS: factor}
        for source, columns in zip(problem.error_sources, shared, strict=True):
            scale = factor if source.scaled else 1.0
            error += scale * (columns @ draw_source(source, rng))
        for source in linear.outside:
            error += source.columns @ draw_source(source, rng, scales)
        priors = [
            sum((source.columns @ draw_source(source, rng, scales)).item() for source in parts)
            for parts in problem.priors.parts
        ]
        errors.append(np.concatenate([linear.whitening(error), priors]))
    shapes = np.empty((draws, len(linear.shape)))
    for row, error in enumerate(errors):
        progress("Monte Carlo", row, draws)
        shapes[row] = _refit(linear, error)
    deviations = linear.quantities(shapes) - linear.quantities(linear.shape[None])
    for name, source in linear.quantity_errors.items():
        deviations[:, linear.names.index(name)] += [
            (source.columns @ draw_source(source, rng)).item() for _ in range(draws)
        ]
    low, high = np.quantile(deviations, [0.5 - 0.5 * COVERAGE, 0.5 + 0.5 * COVERAGE], axis=0)
    return MonteCarlo(
        draws=draws,
        seed=seed,
        sd=tuple(deviations.std(axis=0, ddof=1).tolist()),
        low=tuple(low.tolist()),
        high=tuple(high.tolist()),
    )


def draw_source(
    source: ErrorSource, rng: np.random.Generator, scales: dict[str, float] | None = None
) -> Array:
    """Return one draw (r,) of a source, of standard uncertainty 1 (JCGM 101, 6.4).

    Args:
        scales: scale of each shared scatter in this draw; updated in place.
    """
    r, scale = source.columns.shape[1], 1.0
    if source.distribution == "uniform":
        draw = rng.uniform(-np.sqrt(3.0), np.sqrt(3.0), r)
    elif source.distribution == "triangular":
        draw = rng.triangular(-np.sqrt(6.0), 0.0, np.sqrt(6.0), r)
    else:
        if np.isfinite(source.dof):
            scale = float(np.sqrt(source.dof / rng.chisquare(source.dof)))
            if source.scatter and scales is not None:
                scale = scales.setdefault(source.scatter, scale)
        draw = scale * rng.standard_normal(r)
    return np.asarray(draw, float)


def _refit(linear: Propagation, error: Array) -> Array:
    """Return the least-squares shape (n_shape,) for errors of the whitened rows (m + q,)."""
    problem, whitening = linear.problem, linear.whitening
    lower, upper = problem.shape_bounds
    target = problem.rows(linear.shape, whitening) + error
    shape = linear.shape
    for _ in range(MAX_STEPS):
        rows = problem.rows(shape, whitening) - target
        slopes = row_jacobian(problem, linear.method, shape, whitening)
        norms = np.linalg.norm(slopes, axis=0)
        step = np.linalg.lstsq(slopes / norms, -rows, rcond=None)[0] / norms
        next_shape: Array = np.clip(shape + step, lower, upper)
        if np.all(np.abs(next_shape - shape) <= CLOSE * linear.sd):
            return next_shape
        shape = next_shape
    return shape
