"""Budget of a run before any fit: thrusts at its fastest level, nearest and farthest.

Thrusts are means over the points of a setting: a fit of one parameter per setting. Sensitivities to
plate position and speed are from eq. (4) with the rig's values.
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
from benchtool.data.run.read import load_rig_for_data
from benchtool.fit.fit_data import REFERENCE_Z_OVER_R, FitData, read_fit_data, recipe_model
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.model_problem import function_problem, noise_parameter
from benchtool.fit.recipe import Recipe
from benchtool.fit.run_recipe import recipe_problem
from benchtool.fit.uncertainty.budget import Budget
from benchtool.fit.uncertainty.fixed_parameters import LAW, fixed_parameter_sources
from benchtool.fit.uncertainty.load_cell import with_scale_errors
from benchtool.fit.uncertainty.propagation import (
    bound_sources,
    make_budget,
    propagate,
    with_derived,
)
from benchtool.physics.effects.effect import Derived


def run_budget(path: Path) -> Budget | None:
    """Return the budget of a run's thrusts and of the ratio of the nearest to the farthest.

    None for a run that cannot be fitted, such as a pitch run.
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
        raise EstimationError("the run has no setting numbers, needed to average points")
    errors = recipe_problem(loaded.model, recipe, data)
    settings, setting_index = np.unique(data.groups[data.rows], return_inverse=True)
    names = _names(data, setting_index)
    parameters = {name: Parameter(name, "N", 0.0, free=True) for name in names}
    if data.errors == "within" and len(setting_index) > len(settings):
        parameters["noise.scale"] = noise_parameter()

    def means(values: Any) -> Any:
        point_values = np.asarray(values)[setting_index]
        return point_values if point_values.ndim == 1 else point_values[..., 0].T

    problem = function_problem(
        "settings", parameters, means, errors.observed, errors.standard_error,
        error_sources=errors.error_sources,
    )  # fmt: skip
    problem = with_scale_errors(problem, data.scale_errors, data.rows)
    near, *_, far = selection = _fastest(data, setting_index, names)
    if near == far:
        raise EstimationError("only 1 plate distance at the highest speed; minimum for a ratio: 2")
    ratio = Derived(f"{near} over {far}", "1", lambda values: values[near] / values[far])
    result = with_derived(fit_least_squares(problem), [ratio])
    linear = propagate(problem, result, [ratio])
    if linear is None:
        raise EstimationError("a setting has no usable point")
    rows = [linear.names.index(name) for name in dict.fromkeys([*selection, ratio.name])]
    fixed = loaded.model
    for name in fixed.parameters.free_names:
        fixed = fixed.with_fixed(name)
    sources = fixed_parameter_sources(fixed, data.conditions.select(data.rows))
    # Measured thrusts have no law error.
    outside = [error for error in sources if not error.name.startswith(LAW)]
    selected = replace(
        linear,
        items=tuple(linear.items[row] for row in rows),
        gain=linear.gain[rows],
        outside=bound_sources(linear, outside),
    )
    return make_budget(selected, [error.traceability for error in data.scale_errors])


def _names(data: FitData, visit: NDArray[np.intp]) -> list[str]:
    """Return the name of each setting, from distance and speed."""
    names: list[str] = []
    speeds = from_si(data.conditions.speed_rad_s[:, data.rows].max(axis=0), "rpm")
    for number in range(int(visit.max()) + 1):
        rows = visit == number
        z_over_R = float(np.mean(data.z_over_R[data.rows][rows]))
        distance_text = f"z/R {z_over_R:.3g}" if z_over_R < REFERENCE_Z_OVER_R else "far"
        name = f"thrust {distance_text}, {np.mean(speeds[rows]):.0f} rpm"
        names.append(name if name not in names else f"{name}, setting {number + 1}")
    return names


def _fastest(data: FitData, visit: NDArray[np.intp], names: list[str]) -> list[str]:
    """Return the names of the nearest, a middle and the farthest setting at the highest speed."""
    speed = data.conditions.speed_rad_s[:, data.rows].max(axis=0)
    z = data.z_over_R[data.rows]
    settings = range(len(names))
    level, distance = (np.array([x[visit == n].mean() for n in settings]) for x in (speed, z))
    fastest = np.flatnonzero(level > 0.95 * level.max())
    ordered = fastest[np.argsort(distance[fastest])]
    middle = ordered[len(ordered) // 2]
    return [names[row] for row in (ordered[0], middle, ordered[-1])]
