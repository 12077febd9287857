"""Execution of a recipe: data, estimates by each method, model comparison, budget."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchtool import __version__
from benchtool.core.choices import BudgetMethod
from benchtool.core.errors import EstimationError, InputError, UnknownChoice
from benchtool.core.fit_result import FitResult
from benchtool.core.parameter import Parameters
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.run.read import find_parts
from benchtool.fit.compare import Comparison, compare
from benchtool.fit.compare_laws import LawComparison, compare_laws
from benchtool.fit.diagnose import with_diagnosis
from benchtool.fit.fit_data import FitData, read_fit_data, recipe_model
from benchtool.fit.least_squares import add_profile_intervals, fit_least_squares
from benchtool.fit.model_problem import problem_from_model
from benchtool.fit.problem import NOISE_PLACE, Problem
from benchtool.fit.recipe import LAWS, Recipe
from benchtool.fit.solve import solve
from benchtool.fit.uncertainty.budget import Budget, with_budget
from benchtool.fit.uncertainty.fixed_parameters import (
    STANDARD_K,
    Density,
    air_density,
    fixed_parameter_sources,
    misfit,
)
from benchtool.fit.uncertainty.load_cell import with_scale_errors
from benchtool.fit.uncertainty.propagation import (
    Propagation,
    bound_sources,
    make_budget,
    monte_carlo,
    propagate,
    with_derived,
)
from benchtool.physics.effects.effect import Derived
from benchtool.physics.model import Model
from benchtool.physics.model_file import LoadedModel, load_model

Progress = Callable[[str, int, int], None]  # progress(stage, steps done, steps expected)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FitSummary:
    """Results of a fit, as in result.json.

    Attributes:
        results: one for each method, in the recipe's order; without samples if read from a file.
        comparison: cross-validation of the recipe's models; None without models to compare.
        budget: of the first method's estimates; None if the data do not determine all.
        laws: cross-validation of ground-effect laws; None if not requested.
    """

    model: str  # name
    rig: str  # name
    basis: str
    simulated: bool  # True if any of the data is simulated
    read: int  # number of points
    used: int
    left_out: tuple[str, ...]  # messages: excluded points and reasons
    results: tuple[FitResult, ...] = ()
    comparison: Comparison | None = None
    budget: Budget | None = None
    laws: LawComparison | None = None

    def __repr__(self) -> str:
        return f"{type(self).__name__} of model {self.model}: {self.used} of {self.read} points"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of all results, each once."""
        return tuple(dict.fromkeys(line for result in self.results for line in result.warnings))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class FitOutput(FitSummary):
    """Output of a fit: its results, data and model."""

    recipe: Recipe  # merged runs are replaced by their parts
    loaded: LoadedModel  # the model before the fit
    data: FitData  # the points
    problem: Problem  # input of both estimators
    density: Density | None  # of the air; None if not measured

    @property
    def fitted(self) -> Model:
        """The model at the first method's estimates, noise parameters unchanged."""
        values, sources = {}, {}
        for item in self.results[0].estimates:
            values[item.name] = item.value
            source = ", ".join(filter(None, (self.recipe.name, item.bound)))
            sources[item.name] = f"fitted: {source}"
        return _at_values(self.loaded.model, values, sources)


def _at_values(
    model: Model, values: Mapping[str, float], sources: Mapping[str, str] | None = None
) -> Model:
    """Return a model at fitted values, noise parameters unchanged."""
    items = dict(model.parameters)
    for name, value in values.items():
        if (item := items.get(name)) is not None and not name.startswith("noise."):
            value = float(np.clip(value, item.lower, item.upper))
            items[name] = replace(item, value=value, source=(sources or {}).get(name, item.source))
    return model.with_values(Parameters(items))


@np.errstate(all="ignore")  # values that are not finite are excluded or raise by name
def run_recipe(
    recipe: Recipe,
    progress: Progress = lambda what, done, expected: None,
    *,
    profile: bool = False,
    budget: BudgetMethod = "propagation",
    permit: CodePermit = check_code_allowed,
) -> FitOutput:
    """Run a recipe.

    Args:
        profile: intervals of least squares from the profile likelihood.
        budget: "mc" checks the propagation of errors by Monte Carlo.
        permit: called with the file of user-defined effects before it is executed.

    Raises:
        InputError: the data or the model do not allow the fit.
        EstimationError: no estimate is possible.
    """
    if profile and (recipe.loss != "linear" or "least_squares" not in recipe.methods):
        raise InputError(
            "--profile needs least squares with --loss linear; omit --profile, or use "
            "--method least_squares --loss linear"
        )
    recipe = replace(recipe, data=tuple(part for path in recipe.data for part in find_parts(path)))
    loaded = recipe_model(recipe, permit)
    data = read_fit_data(recipe, loaded)
    loaded = replace(loaded, model=_with_noise(loaded.model, recipe, data.errors))
    others = _load_compared(recipe, loaded.model, permit)
    fit = FitOutput(
        model=loaded.model.name,
        rig=loaded.model.rig.name,
        basis=recipe.basis,
        simulated=data.points.simulated,
        read=len(data.points),
        used=len(data.rows),
        left_out=data.left_out,
        recipe=recipe,
        loaded=loaded,
        data=data,
        problem=recipe_problem(loaded.model, recipe, data),
        density=air_density(recipe.air, recipe.data),
    )
    try:
        results = tuple(_estimate(fit, method, progress, profile) for method in recipe.methods)
    except EstimationError as error:
        if 2 * fit.used < fit.read:  # the probable cause
            error.args = ("; ".join((*data.left_out, str(error))),)
        raise
    fit = replace(fit, results=results)
    if set(recipe.compare) - {LAWS}:
        problems = [fit.problem, *(recipe_problem(other, recipe, data) for other in others)]
        fit = replace(fit, comparison=compare(problems, seed=recipe.seed))
    if LAWS in recipe.compare:
        progress("laws", 0, 1)
        laws = compare_laws(
            loaded.model,
            lambda model: recipe_problem(model, recipe, data),
            data.z_over_R[data.rows],
        )
        fit = replace(fit, laws=laws)
    propagated = propagate_uncertainty(fit)
    if propagated is None:
        return fit
    made = make_budget(propagated, [error.traceability for error in data.scale_errors])
    if budget == "mc":
        check = monte_carlo(propagated, seed=recipe.seed, progress=progress)
        made = replace(made, monte_carlo=check)
    return replace(fit, budget=made, results=with_budget(results, made))


def _load_compared(recipe: Recipe, model: Model, permit: CodePermit) -> list[Model]:
    """Return the models to compare, on the same rig, with the same noise and nuisances free."""
    names = [name for name in dict.fromkeys(recipe.compare) if name not in (LAWS, recipe.model)]
    try:
        others = [load_model(name, model.rig, permit=permit).model for name in names]
    except UnknownChoice as unknown:
        if unknown.name in names:
            raise UnknownChoice(unknown.kind, unknown.name, (*unknown.choices, LAWS)) from None
        raise
    compared = []
    for other in others:
        shared, own_names = {"noise.scale", "noise.sd_N"}, {effect.name for effect in other.effects}
        for effect in model.effects:
            if effect.name not in own_names and effect.subsystem in ("sensor", "plate"):
                other = other.with_effect(effect)
                shared |= {name for name in model.parameters if name.startswith(f"{effect.name}.")}
        items = {**other.parameters, **{name: model.parameters[name] for name in shared}}
        compared.append(other.with_values(Parameters(items)))
    return compared


def propagate_uncertainty(output: FitOutput) -> Propagation | None:
    """Return the propagation of all errors to the first method's estimates.

    None if the data leave a parameter open.
    """
    model, result, data, problem = output.fitted, output.results[0], output.data, output.problem
    propagation = propagate(problem, result, _quantities(model, result, output.density))
    if propagation is None:
        return None
    reference = None if data.reference is None else data.reference.select(data.rows)
    sources = fixed_parameter_sources(model, data.conditions.select(data.rows), reference)
    bounds = {source.name: source for source in bound_sources(propagation, sources)}
    sources = tuple(
        replace(bounds[held.name], columns=bounds[held.name].sd / held.sd * held.columns)
        for held in sources
    )
    if problem.noise_name is None and result.facts.get("verdict") == "rejected":
        sources = (*sources, misfit(problem, propagation.whitening.sigma, result.chi2_per_dof))
    propagation = replace(propagation, outside=sources)
    if output.density is None or STANDARD_K not in propagation.names:
        return propagation
    density_error = output.density.source(result[STANDARD_K].value)
    return replace(propagation, quantity_errors={STANDARD_K: density_error})


def _with_noise(model: Model, recipe: Recipe, errors: str) -> Model:
    """Return the model with the noise parameter of the recipe free."""
    kind, items = recipe.noise, dict(model.parameters)
    short_names = {name.rpartition(".")[2] for name in (*recipe.free, *recipe.fix, *recipe.hold)}
    if kind == "auto":
        is_noise_set = bool(short_names & {"scale", "sd_N"}) or items[NOISE_PLACE].free
        kind = "stated" if errors == "stated" or is_noise_set else "scale"
    for name, free_by in (("noise.scale", "scale"), ("noise.sd_N", "add")):
        if name.rpartition(".")[2] not in short_names:  # --free and --fix override --noise
            items[name] = replace(items[name], free=kind == free_by)
    for name, start in (("noise.sd_N", 1e-3), (NOISE_PLACE, PLACE_START_M)):
        if items[name].free and items[name].value == 0.0:
            items[name] = items[name].with_value(start)
    return model.with_values(Parameters(items))


PLACE_START_M = 1e-4  # initial value of a free `noise.place_m` without rig data; assumed


def recipe_problem(model: Model, recipe: Recipe, data: FitData) -> Problem:
    """Return the problem with the errors of the bench at the solution.

    The effect of a position error on thrust depends on the model's parameters: it is computed at
    the initial values, and again at the solution for these errors.
    """
    rows = data.rows
    problem = problem_from_model(
        model,
        data.conditions.select(rows),
        data.observed[rows],
        None if data.errors == "none" else data.standard_error[rows],
        basis=recipe.basis,
        reference=None if data.reference is None else data.reference.select(rows),
        error_sources=data.shared_errors(model),
        **({} if data.groups is None else {"groups": data.groups[rows]}),
    )
    if "thrust_N" not in data.points:
        problem = replace(problem, facts={**problem.facts, "data": "ratios"})
    elif recipe.basis == "joint":  # the calibration's scale cancels in a ratio of two thrusts
        problem = with_scale_errors(_scale_start(problem), data.scale_errors, rows)
    if not problem.error_sources:
        return problem
    try:
        shape = solve(problem, problem.whitening()).shape
    except EstimationError:
        return problem
    near = _at_values(model, dict(zip(problem.shape_names, shape, strict=True)))
    return replace(problem, error_sources=data.shared_errors(near))


def _scale_start(problem: Problem) -> Problem:
    """Return the problem with k scaled to thrusts far from the model; avoids wrong minima."""
    k, model_N = problem.parameters["k"], np.asarray(problem.predict(problem.start), float)
    ratio = float(np.median(problem.observed / model_N))
    if not (k.free and 0.0 < ratio < np.inf) or 1.0 / FAR_FROM_RIG < ratio < FAR_FROM_RIG:
        return problem
    start = k.with_value(float(np.clip(ratio * k.value, k.lower, k.upper)))
    return replace(problem, parameters=problem.parameters.with_replaced("k", start))


def _estimate(fit: FitOutput, method: str, progress: Progress, profile: bool) -> FitResult:
    """Return the result of a method with diagnosis, derived quantities and data hashes."""
    recipe, data, problem = fit.recipe, fit.data, fit.problem
    notes: tuple[str, ...] = ()
    if method == "least_squares":
        progress("least squares", 0, 1)
        result = fit_least_squares(problem, loss=recipe.loss)
        result = add_profile_intervals(problem, result) if profile else result
    else:
        from benchtool.fit.ensemble import fit_ensemble  # emcee imports scipy.stats: 1 s

        result = fit_ensemble(
            problem,
            walkers=recipe.walkers,
            max_steps=recipe.max_steps,
            seed=recipe.seed,
            progress=partial(progress, "emcee"),
        )
        if recipe.loss != "linear":
            loss = f"--loss {recipe.loss}"
            notes = (f"emcee uses the full weight of every point: {loss} is of least squares",)
    facts = {
        **result.facts,
        "benchtool": __version__,
        "simulated": fit.simulated,
        **{f"sha256.{path}": digest for path, digest in data.hashes.items()},
    }
    warnings = (
        *_far_from_rig(fit.loaded.model, result),
        *data.left_out,
        *data.calibration_warnings,
        *result.warnings,
        *notes,
    )
    result = with_diagnosis(problem, replace(result, facts=facts, warnings=warnings))
    return with_derived(result, _quantities(fit.loaded.model, result, fit.density))


FAR_FROM_RIG = 3.0  # ratio of k or thrust that indicates a unit error or another rig; assumed


def _far_from_rig(model: Model, result: FitResult) -> tuple[str, ...]:
    """Return a warning if the fitted thrust coefficient does not match the rig's motors."""
    rig_k = model.rig.propulsion.thrust_coefficient_N_s2
    k = next((estimate.value for estimate in result.estimates if estimate.name == "k"), rig_k)
    if k > 0.0 and 1.0 / FAR_FROM_RIG < k / rig_k < FAR_FROM_RIG:
        return ()
    return (
        f"k is {k / rig_k:.3g} times the thrust coefficient of rig {model.rig.name} ({rig_k:g} "
        f"N/(rad/s)2), rotor radius {model.rig.propulsion.radius_m:.4g} m: check the units of "
        f"radius, thrust and speed, the motors' pole count, and that the rig is yours",
    )


def _quantities(model: Model, result: FitResult, density: Density | None) -> list[Derived]:
    """Return quantities derived from the fitted parameters, and from the air density."""
    free = [estimate.name for estimate in result.estimates]
    quantities = [density.standard_k] if density is not None and "k" in free else []
    if "R_m" in free:
        radius = model.rig.propulsion.radius_m
        quantities.append(Derived("R_over_rotor_radius", "1", lambda v: v["R_m"] / radius))
    for effect in model.effects:
        if effect.derived is not None:
            names = [name for name in free if name.startswith(f"{effect.name}.")]
            quantities += effect.derived(names)
    return quantities
