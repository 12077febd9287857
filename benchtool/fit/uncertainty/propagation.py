"""The budget of a fit: the errors that it was given, and those that its model holds fixed.

With whitened Jacobian J and covariance C of a fit, the gain C J^T carries each source's columns to
the estimates. What the fit was given makes its own covariance again; what it holds fixed at a
number that nobody knows exactly, and what no law follows to the letter, comes beside it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.error_source import ErrorSource, Whitening
from benchtool.core.fit_result import Estimate, FitResult
from benchtool.fit.interval import delta_gradient
from benchtool.fit.jacobian import Way, select_method, spread_of
from benchtool.fit.problem import Problem
from benchtool.fit.solve import row_jacobian
from benchtool.fit.uncertainty.budget import Budget, BudgetLine
from benchtool.physics.effects.effect import Derived

ORIGINS = {"A": "scatter of the data", "B": "stated by the rig"}  # of a source without its own
POINTS = "scatter of the points"  # name of the estimate that `repeat` and bounded sources share
SHOWS = 1e-4  # part of every combined uncertainty below which a source is left out


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Propagation:
    """Carry errors of the observations to a fit's quantities: shape parameters, then derived ones.

    Attributes:
        items: (n,) of the quantities, as the fit has them.
        derived: functions of the last of them.
        shape: (n_shape,) where it was linearised.
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
    derivatives: Way
    gain: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities (n,)."""
        return tuple(item.name for item in self.items)

    def changes(self, columns: Array) -> Array:
        """Return the changes (n, r) of the quantities by columns (m, r) of the observations."""
        changed: Array = self.gain[:, : len(self.problem)] @ self.whitening(columns)
        return changed

    def quantities(self, shapes: Array) -> Array:
        """Return the quantities (w, n) at shape values (w, n_shape)."""
        values = dict(zip(self.problem.shape_names, shapes.T, strict=True))
        derived = [np.broadcast_to(one.function(values), len(shapes)) for one in self.derived]
        return np.column_stack([shapes, *derived])


def propagation(
    problem: Problem, result: FitResult, derived: Sequence[Derived] = ()
) -> Propagation | None:
    """Return how errors reach a result's quantities; None where the data leave one open."""
    shape, noise = problem.split(result.values)
    # By so much a robust loss counts the points' own errors larger.
    whitening = problem.whitening(noise, float(result.facts.get("loss_factor") or 1.0))
    derivatives = select_method(problem.predict, shape, len(problem), *problem.shape_bounds)
    jacobian = row_jacobian(problem, derivatives)(shape, whitening)
    spread = spread_of(jacobian, derivatives)
    if spread.undetermined or not np.isfinite(result.covariance).all():
        return None
    places = problem.shape_index
    slopes = np.stack(
        [*np.eye(len(shape)), *(delta_gradient(one, result)[places] for one in derived)]
    )
    return Propagation(
        problem=problem,
        items=(*(result.estimates[i] for i in places), *(result[one.name] for one in derived)),
        derived=tuple(derived),
        shape=shape,
        sd=np.sqrt(np.diag(spread.covariance)),
        noise=noise,
        whitening=whitening,
        derivatives=derivatives,
        gain=slopes @ spread.covariance @ jacobian.T,
    )


def bounded(way: Propagation, sources: Sequence[ErrorSource]) -> tuple[ErrorSource, ...]:
    """Return sources of one draw, each at what the residuals leave of it where that is less.

    All draws are estimated together, the others within what is stated of them: of two that leave
    the same residuals, neither is bounded. The error is that from the held value, a draw of 0.
    """
    if not sources:
        return ()
    problem, columns = way.problem, np.concatenate([one.columns for one in sources], axis=1)
    residuals = -problem.rows(way.shape, way.whitening)
    widened = max(float(residuals @ residuals) / max(problem.dof, 1), 1.0) ** 0.5
    rows = np.pad(way.whitening(columns), ((0, len(problem.priors)), (0, 0))) / widened
    fitted = way.gain[: len(way.shape)] / way.sd[:, None]
    left = rows - np.linalg.pinv(fitted) @ (fitted @ rows)
    posterior = np.linalg.inv(np.eye(len(sources)) + left.T @ left)
    shown = np.maximum(1.0 - np.diag(posterior), 1e-300)  # share of each draw that residuals show
    draw = posterior @ (left.T @ residuals) / widened / shown
    sd = np.sqrt(np.diag(posterior) / shown)
    dof = np.inf if problem.noise_name is None else float(problem.dof)
    return tuple(
        one
        if share >= 1.0
        else replace(
            one, kind="A", sd=share * one.sd, columns=share * one.columns, dof=dof,
            distribution="student_t", scatter=POINTS,
            origin=f"residuals of this run: {value * one.sd:.2g} ± {own * one.sd:.2g}; "
            f"without them {one.sd:.2g}, {one.origin}",
        )
        for one, share, value, own in zip(sources, np.hypot(draw, sd), draw, sd, strict=True)
    )  # fmt: skip


def budget_of(
    way: Propagation,
    outside: Sequence[ErrorSource] = (),
    beside: Sequence[tuple[ErrorSource, str]] = (),
    traceability: Sequence[str] = (),
) -> Budget:
    """Return the budget of a fit.

    Args:
        outside: errors of the observations that the fit's covariance does not hold.
        beside: errors of one quantity alone, with its name: columns (1, 1) in its unit.
    """
    parts = [*_within(way)]
    parts += [_line(one, way.changes(one.columns), False) for one in outside]
    for source, name in beside:
        only = np.array([[1.0 if name == other else 0.0] for other in way.names])
        parts.append(_line(source, only @ source.columns, False))
    covariance = sum(changes @ changes.T for _, changes in parts)
    sd = np.sqrt(np.diag(covariance))
    parts = [(line, _) for line, _ in parts if np.any(line.contribution > SHOWS * sd)]
    return Budget(
        names=way.names,
        units=tuple(item.unit for item in way.items),
        values=tuple(item.value for item in way.items),
        fit_sd=tuple(item.sd for item in way.items),
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
        # Many draws add to a normal distribution, however each is distributed.
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


def _within(way: Propagation) -> Iterator[tuple[BudgetLine, Array]]:
    """Give the sources that make the fit's own covariance, with their changes (n, r)."""
    problem, m = way.problem, len(way.problem)
    sigma = way.whitening.sigma
    fitted = problem.noise_name is not None
    of_noise: dict[str, Any] = {"dof": float(problem.dof), "distribution": "student_t"}
    repeat = ErrorSource(
        name="repeat",
        kind="A",
        unit="N" if problem.basis == "joint" else "1",
        sd=float(np.sqrt(np.mean(sigma**2))),
        columns=sigma[:, None],
        origin=f"scatter of the points: {problem.noise_name} fitted" if fitted else "stated errors",
        **(of_noise | {"scatter": POINTS} if fitted else {}),
    )
    # One draw for each point: gain times the whitened diagonal, without writing that out.
    own = way.whitening((way.gain[:, :m] * sigma).T).T
    yield _line(repeat, own, True, "each point its own")
    shared = problem.shared(way.noise)
    at = np.cumsum([0, *(one.columns.shape[1] for one in problem.error_sources)])
    for one, begin, end in zip(problem.error_sources, at[:-1], at[1:], strict=True):
        yield _line(one, way.changes(shared[:, begin:end]), True)
    sources = {name: one.source for one in problem.joint_priors for name in one.names}
    for place, row in enumerate(problem.priors.matrix):
        last = int(np.flatnonzero(row)[-1])
        name = problem.shape_names[last]
        item = problem.parameters[name]
        prior = ErrorSource(
            name=name,
            kind="B",
            unit=item.unit,
            sd=float(1.0 / abs(row[last])),
            columns=np.empty((m, 0)),
            origin=sources.get(name) or item.prior.source or "prior of the model",
        )
        change = way.gain[:, m + place, None] * np.sign(row[last])
        for one in problem.priors.parts[place]:
            yield _line(one, change @ one.columns, True, "all points of the calibration share it")
        if not problem.priors.parts[place]:
            yield _line(prior, change, True, "all points share it")
