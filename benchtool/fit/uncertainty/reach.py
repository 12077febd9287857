"""What reaches a target uncertainty: more visits, other distances, a better known source.

Everything follows from the sensitivities of a fit that was made: the points are weighted as they
would be then, and the model is taken where the fit found it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from benchtool.core.array import Array
from benchtool.core.error_source import ErrorSource, Whitening
from benchtool.core.errors import EstimationError, InputError, UnknownChoice
from benchtool.fit.fit_data import FAR_Z_OVER_R
from benchtool.fit.run_recipe import FitOutput, Propagated, propagated
from benchtool.fit.solve import row_jacobian
from benchtool.fit.uncertainty.held_sources import LAW
from benchtool.fit.uncertainty.propagation import Propagation

MOST_VISITS = 8
"""Most times the visits of a setting are multiplied; a choice, a day in place of an hour."""

CANDIDATES_OVER_R = (0.5, 0.6, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0)
"""Distances that visits may be moved to, within the rig's travel; a choice."""

LEAST_GAIN = 0.02
"""Relative fall of an uncertainty below which a step is not worth its time; a choice."""

WORTH = 0.1  # part of the combined uncertainty above which a source is looked at by itself; assumed

OPEN = "the data leave a parameter open, so nothing is known to plan; fix it, or measure more"


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """Describe a way to a smaller uncertainty.

    Attributes:
        visits: factor on the visits of every setting.
        moved: distance z/R of visits that go elsewhere, and where.
        known: factor on the uncertainty of sources, by name.
        sd: standard uncertainty of the quantity then.
    """

    visits: int = 1
    moved: tuple[float, float] | None = None
    known: Mapping[str, float] = field(default_factory=dict)
    sd: float = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """Hold what was looked for and found.

    Attributes:
        wanted: standard uncertainty, in `unit`.
        single: ways of one step, each as far as it goes or is needed.
        together: the way of several steps that reaches it, or comes nearest.
    """

    name: str
    unit: str
    value: float
    sd: float
    wanted: float
    single: tuple[Way, ...]
    together: Way

    @property
    def reached(self) -> bool:
        """Whether the way of several steps is enough."""
        return self.together.sd <= self.wanted


class _Fit:
    """Answer what a quantity's uncertainty would be, for points at their places or moved."""

    def __init__(self, output: FitOutput, name: str) -> None:
        self.output, self.name = output, name
        self._made: dict[tuple[float, float] | None, Propagated] = {}

    def made(self, moved: tuple[float, float] | None) -> Propagated:
        if moved not in self._made:
            data = self.output.data
            if moved is not None:
                z_m = np.where(
                    np.round(data.z_over_R, 2) == moved[0],
                    moved[1] * self.output.fitted.rig.propulsion.radius_m,
                    data.conditions.plate_z_m,
                )
                data = replace(data, conditions=replace(data.conditions, plate_z_m=z_m))
            found = propagated(self.output, data)
            if found is None:
                raise EstimationError(OPEN)
            self._made[moved] = found
        return self._made[moved]

    def at(self, way: Way) -> Way:
        """Return the way with what it comes to."""
        made, outside, beside = self.made(way.moved)
        sd = expected_sd(made, outside, self.name, way.visits, way.known)
        own = [
            way.known.get(one.name, 1.0) * one.columns.item()
            for one, name in beside
            if name == self.name
        ]
        return replace(way, sd=float(np.linalg.norm([sd, *own])))


def expected_sd(
    way: Propagation,
    outside: Sequence[ErrorSource],
    name: str,
    visits: float = 1.0,
    known: Mapping[str, float] | None = None,
) -> float:
    """Return a quantity's combined standard uncertainty where points are visited more often.

    What has a draw for each visit or stay falls with the root of the visits, what all points share
    stays.

    Args:
        way: of the fit as it was made.
        outside: what its covariance does not hold.
        name: of the quantity.
        visits: factor on the visits of every setting.
        known: factor on the uncertainty of sources, by name.
    """
    problem, known = way.problem, known or {}
    m, fewer = len(problem), visits**-0.5
    shared, at = problem.shared(way.noise), 0
    columns = [np.empty((m, 0))]
    for source in problem.error_sources:
        r = source.columns.shape[1]
        factor = known.get(source.name, 1.0) * (fewer if r > 1 else 1.0)
        columns.append(factor * shared[:, at : at + r])
        at += r
    whitening = Whitening(fewer * way.whitening.sigma, np.concatenate(columns, axis=1))
    plain = Whitening(np.ones(m), np.empty((m, 0)))
    rows = row_jacobian(problem, way.derivatives)(way.shape, plain)
    priors = [
        row / known.get(problem.shape_names[int(np.flatnonzero(row)[-1])], 1.0) for row in rows[m:]
    ]
    jacobian: Array = np.concatenate([whitening(rows[:m]), np.reshape(priors, (-1, rows.shape[1]))])
    norms = np.linalg.norm(jacobian, axis=0)
    inverse = np.linalg.pinv(jacobian / norms) / norms[:, None]
    gain = way.slopes[way.names.index(name)] @ inverse
    total = float(gain @ gain)
    for source in outside:
        change = gain[:m] @ whitening(known.get(source.name, 1.0) * source.columns)
        total += float(change @ change)
    return float(total**0.5)


def quantity_named(name: str, names: Sequence[str]) -> str:
    """Return the quantity that somebody means by its name, its last part, or that without unit."""
    for alike in (
        [full for full in names if name in (full, full.rpartition(".")[2])],
        [full for full in names if full.rpartition(".")[2].rpartition("_")[0] == name],
    ):
        if len(alike) == 1:
            return alike[0]
    raise UnknownChoice("quantity", name, names)


def reach(output: FitOutput, name: str, wanted: float, *, relative: bool) -> Reach:
    """Return what reaches a wanted standard uncertainty of a fitted quantity.

    Args:
        output: the fit of what was measured so far.
        name: of the quantity.
        wanted: standard uncertainty; over the quantity's value where it is `relative`.
        relative: see `wanted`.

    Raises:
        EstimationError: the data leave a parameter open.
    """
    budget = output.budget
    if budget is None:
        raise EstimationError(OPEN)
    place = budget.names.index(name)
    value, now = budget.values[place], float(budget.combined[place])
    wanted = wanted * abs(value) if relative else wanted
    if not wanted > 0.0:
        raise InputError(f"{name} is {value:g}, so a part of it is none; want it in its own unit")
    fit = _Fit(output, name)
    single = []
    repeated = [fit.at(Way(visits=n)) for n in range(2, MOST_VISITS + 1)]
    enough = [way for way in repeated if way.sd <= wanted]
    single += enough[:1] or [min(repeated, key=lambda way: way.sd)]
    moves = [fit.at(Way(moved=move)) for move in _moves(output)]
    single += sorted(moves, key=lambda way: way.sd)[:1]
    large = [
        (line.name, part)
        for line, part in sorted(
            zip(budget.lines, budget.parts[:, place], strict=True), key=lambda pair: -pair[1]
        )
        if part > WORTH * now and line.name != "repeat" and not line.name.startswith(LAW)
    ]
    for source, part in large:
        rest = wanted**2 - (now**2 - part**2)
        factor = float(max(rest, 0.0) ** 0.5 / part)
        single.append(fit.at(Way(known={source: max(min(factor, 1.0), 1.0 / MOST_VISITS)})))
    return Reach(
        name=name,
        unit=budget.units[place],
        value=value,
        sd=now,
        wanted=wanted,
        single=tuple(single),
        together=_together(fit, fit.at(Way()), wanted, [source for source, _ in large], moves),
    )


def _together(
    fit: _Fit, way: Way, wanted: float, sources: Sequence[str], moves: Sequence[Way]
) -> Way:
    """Return the way that takes the step of greatest gain again and again until it is enough."""
    while way.sd > wanted:
        steps = [replace(way, visits=2 * way.visits)] if 2 * way.visits <= MOST_VISITS else []
        if way.moved is None and moves:
            steps.append(replace(way, moved=min(moves, key=lambda one: one.sd).moved))
        for source in sources:
            factor = 0.5 * way.known.get(source, 1.0)
            if factor >= 1.0 / MOST_VISITS:
                steps.append(replace(way, known={**way.known, source: factor}))
        best = min(map(fit.at, steps), key=lambda one: one.sd, default=way)
        if best.sd > (1.0 - LEAST_GAIN) * way.sd:
            break
        way = best
    return way


def _moves(output: FitOutput) -> list[tuple[float, float]]:
    """Return which distances z/R may be visited in place of which."""
    plate, radius_m = output.fitted.rig.plate, output.fitted.rig.propulsion.radius_m
    present = np.unique(np.round(output.data.z_over_R[output.data.used], 2))
    present = present[present < FAR_Z_OVER_R]
    nearest = output.recipe.min_z_over_R
    nearest = output.fitted.nearest_z_over_R if nearest is None else nearest
    least = max(plate.z_min_m / radius_m, nearest)
    most = min(plate.z_park_m, plate.z_max_m) / radius_m
    return [
        (float(old), new)
        for old in present
        for new in CANDIDATES_OVER_R
        if least <= new < most and np.abs(present - new).min() > 0.1
    ]
