"""The budget of a run before any fit: thrusts at its fastest level, nearest and farthest.

Thrusts are means over the visits of a setting, which is a fit of one number for each. What a shift
of the plate or of a speed does to them follows from eq. (4) at the rig's own numbers.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import BenchtoolError, EstimationError
from benchtool.core.parameter import Parameter
from benchtool.core.units import from_si
from benchtool.data.run.run_rig import load_rig_for_data
from benchtool.fit.fit_data import REFERENCE_Z_OVER_R, FitData, read_fit_data, recipe_model
from benchtool.fit.interval import with_derived
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.problem import function_problem, noise_parameter
from benchtool.fit.recipe import Recipe
from benchtool.fit.run_recipe import recipe_problem
from benchtool.fit.uncertainty.budget import Budget
from benchtool.fit.uncertainty.fixed_parameters import LAW, fixed_parameter_sources
from benchtool.fit.uncertainty.load_cell import with_scale_errors
from benchtool.fit.uncertainty.propagation import bounded, budget_of, propagation
from benchtool.physics.effects.effect import Derived


def run_budget(path: Path) -> Budget | None:
    """Return the budget of a run's thrusts and of the ratio of the nearest to the farthest.

    None for a run whose points no fit can take, such as one of a pitch bench.
    """
    try:
        return _budget(path)
    except BenchtoolError:
        return None


def _budget(path: Path) -> Budget:
    rig = load_rig_for_data([str(path)])
    model = "single_bench" if rig is not None and rig.n_rotors == 1 else "quad_bench"
    recipe = Recipe(name=path.name, data=(str(path),), model=model, min_z_over_R=0.0)
    loaded = recipe_model(recipe)
    data = read_fit_data(recipe, loaded)
    if data.groups is None:
        raise EstimationError("the run numbers no settings, so there are no visits to average")
    errors = recipe_problem(loaded.model, recipe, data)
    settings, visit = np.unique(data.groups[data.rows], return_inverse=True)
    names = _names(data, visit)
    parameters = {name: Parameter(name, "N", 0.0, free=True) for name in names}
    if data.errors == "within" and len(visit) > len(settings):
        parameters["noise.scale"] = noise_parameter()

    def means(values: Any) -> Any:
        at = np.asarray(values)[visit]
        return at if at.ndim == 1 else at[..., 0].T

    problem = function_problem(
        "settings", parameters, means, errors.observed, errors.standard_error,
        error_sources=errors.error_sources,
    )  # fmt: skip
    cells = data.load_cells
    scales = [replace(one, rows=one.rows[data.rows]) for one in cells.errors]
    problem = with_scale_errors(problem, scales)
    near, *_, far = shown = _fastest(data, visit, names)
    if near == far:
        raise EstimationError("thrust was measured at one distance, so there is no ratio")
    ratio = Derived(f"{near} over {far}", "1", lambda values: values[near] / values[far])
    result = with_derived(fit_least_squares(problem), [ratio])
    way = propagation(problem, result, [ratio])
    if way is None:
        raise EstimationError("a setting has no visit that counts")
    rows = [way.names.index(name) for name in dict.fromkeys([*shown, ratio.name])]
    fixed = loaded.model
    for name in fixed.parameters.free_names:
        fixed = fixed.with_fixed(name)
    chosen = replace(way, items=tuple(way.items[row] for row in rows), gain=way.gain[rows])
    held = fixed_parameter_sources(fixed, data.conditions.select(data.rows))
    # What was read follows no law of distance.
    outside = [one for one in held if not one.name.startswith(LAW)]
    return budget_of(chosen, bounded(way, outside), traceability=cells.traceability)


def _names(data: FitData, visit: NDArray[np.intp]) -> list[str]:
    """Return what each setting is called, by distance and level."""
    names: list[str] = []
    speeds = from_si(data.conditions.speed_rad_s[:, data.rows].max(axis=0), "rpm")
    for number in range(int(visit.max()) + 1):
        own = visit == number
        z = float(np.mean(data.z_over_R[data.rows][own]))
        place = f"z/R {z:.3g}" if z < REFERENCE_Z_OVER_R else "far"
        name = f"thrust {place}, {np.mean(speeds[own]):.0f} rpm"
        names.append(name if name not in names else f"{name}, setting {number + 1}")
    return names


def _fastest(data: FitData, visit: NDArray[np.intp], names: list[str]) -> list[str]:
    """Return the nearest, a middle and the farthest setting of the fastest level."""
    speed = data.conditions.speed_rad_s[:, data.rows].max(axis=0)
    z = data.z_over_R[data.rows]
    level, place = (np.array([x[visit == n].mean() for n in range(len(names))]) for x in (speed, z))
    fast = np.flatnonzero(level > 0.95 * level.max())
    ordered = fast[np.argsort(place[fast])]
    middle = ordered[len(ordered) // 2]
    return [names[row] for row in (ordered[0], middle, ordered[-1])]
