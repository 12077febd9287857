"""Budget of a fit: error sources of its covariance, and of fixed parameters and laws.

With whitened Jacobian J and covariance C of a fit, the gain C J^T propagates each source's columns
to the estimates. Sources within the fit reproduce its covariance; fixed parameters of uncertain
value and errors of laws are added.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchtool.core.error_source import ErrorSource, Whitening
from benchtool.core.fit_result import Estimate, FitResult
from benchtool.core.units import Array
from benchtool.fit.interval import delta_gradient
from benchtool.fit.jacobian import DerivativeMethod, estimate_covariance, select_method
from benchtool.fit.problem import Problem
from benchtool.fit.solve import row_jacobian
from benchtool.fit.uncertainty.budget import Budget, BudgetLine
from benchtool.physics.effects.effect import Derived

ORIGINS = {"A": "scatter of the data", "B": "stated by the rig"}  # defaults
POINTS = "scatter of the points"  # name of the scatter shared by `repeat` and bounded sources
MIN_CONTRIBUTION = 1e-4  # of a source, relative to every combined uncertainty


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Propagation:
    """Linear propagation of errors to a fit's quantities: shape parameters, then derived ones.

    Attributes:
        items: (n,) estimates of the quantities.
        derived: functions of the derived quantities.
        shape: (n_shape,) linearisation point.
        sd: (n_shape,) standard deviations there.
        gain: (n, m + q) change of the quantities by whitened rows: points, then priors.
    """

    problem: Problem
    items: tuple[Estimate, ...]
    derived: tuple[Derived, ...]
    shape: Array
    sd: Array
    noise: float | None
    whitening: Whitening
    derivatives: DerivativeMethod
    gain: Array

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
    derivatives = select_method(problem.predict, shape, len(problem), *problem.shape_bounds)
    jacobian = row_jacobian(problem, derivatives)(shape, whitening)
    uncertainty = estimate_covariance(jacobian, derivatives)
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
        derivatives=derivatives,
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


def make_budget(
    linear: Propagation,
    outside: Sequence[ErrorSource] = (),
    quantity_errors: Sequence[tuple[ErrorSource, str]] = (),
    traceability: Sequence[str] = (),
) -> Budget:
    """Return the budget of a fit.

    Args:
        outside: errors of the observations that are not in the fit's covariance.
        quantity_errors: errors of one quantity, with its name: columns (1, 1) in its unit.
    """
    parts = [*_fit_sources(linear)]
    parts += [_line(source, linear.changes(source.columns), False) for source in outside]
    for source, name in quantity_errors:
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
    is_free = problem.noise_name is not None
    noise_dof: dict[str, Any] = {"dof": float(problem.dof), "distribution": "student_t"}
    repeat = ErrorSource(
        name="repeat",
        kind="A",
        unit="N" if problem.basis == "joint" else "1",
        sd=float(np.sqrt(np.mean(sigma**2))),
        columns=sigma[:, None],
        origin=f"scatter of the points: {problem.noise_name} fitted"
        if is_free
        else "stated errors",
        **(noise_dof | {"scatter": POINTS} if is_free else {}),
    )
    # One error per point: gain times the whitened diagonal matrix, without building it.
    changes = linear.whitening((linear.gain[:, :m] * sigma).T).T
    yield _line(repeat, changes, True, "each point its own")
    shared = problem.shared(linear.noise)
    offsets = np.cumsum([0, *(source.columns.shape[1] for source in problem.error_sources)])
    for source, first, end in zip(problem.error_sources, offsets[:-1], offsets[1:], strict=True):
        yield _line(source, linear.changes(shared[:, first:end]), True)
    sources = {name: joint.source for joint in problem.joint_priors for name in joint.names}
    for index, row in enumerate(problem.priors.matrix):
        last = int(np.flatnonzero(row)[-1])
        name = problem.shape_names[last]
        parameter = problem.parameters[name]
        prior = ErrorSource(
            name=name,
            kind="B",
            unit=parameter.unit,
            sd=float(1.0 / abs(row[last])),
            columns=np.empty((m, 0)),
            origin=sources.get(name) or parameter.prior.source or "prior of the model",
        )
        change = linear.gain[:, m + index, None] * np.sign(row[last])
        for source in problem.priors.parts[index]:
            changes = change @ source.columns
            yield _line(source, changes, True, "all points of the calibration share it")
        if not problem.priors.parts[index]:
            yield _line(prior, change, True, "all points share it")
