"""Execution of a recipe: data, estimates by each method, model comparison, budget."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchtool import __version__
from benchtool.core.choices import BudgetMethod
from benchtool.core.error_source import ErrorSource
from benchtool.core.errors import EstimationError, InputError, UnknownChoice
from benchtool.core.fit_result import FitResult
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.run.read import find_parts
from benchtool.fit.compare import Comparison, compare
from benchtool.fit.compare_laws import compare_laws
from benchtool.fit.diagnose import with_diagnosis
from benchtool.fit.ensemble import fit_ensemble
from benchtool.fit.fit_data import FitData, read_fit_data, recipe_model
from benchtool.fit.interval import with_derived
from benchtool.fit.law_scores import LawComparison
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.model_problem import problem_from_model
from benchtool.fit.problem import NOISE_PLACE, Problem
from benchtool.fit.profile import add_profile_intervals
from benchtool.fit.recipe import LAWS, Recipe
from benchtool.fit.uncertainty.budget import Budget, with_budget
from benchtool.fit.uncertainty.density import STANDARD_K, Density, air_density
from benchtool.fit.uncertainty.fixed_parameters import fixed_parameter_sources, misfit
from benchtool.fit.uncertainty.load_cell import with_scale_errors
from benchtool.fit.uncertainty.monte_carlo import monte_carlo
from benchtool.fit.uncertainty.propagation import Propagation, bound_sources, make_budget, propagate
from benchtool.physics.effects.effect import Derived
from benchtool.physics.model import Model
from benchtool.physics.model_file import LoadedModel, load_model

Progress = Callable[[str, int, int], None]  # progress(stage, steps done, steps expected)
# Propagation, error sources outside of the fit's covariance, error sources of one quantity.
Propagated = tuple[Propagation, tuple[ErrorSource, ...], list[tuple[ErrorSource, str]]]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FitOutput:
    """Output of a fit.

    Attributes:
        comparison: cross-validation of the recipe's models; None without models to compare.
        budget: of the first method's estimates; None if the data do not determine all.
        density: of the air; None if not measured.
        laws: cross-validation of ground-effect laws; None if not requested.
    """

    recipe: Recipe  # merged runs are replaced by their parts
    loaded: LoadedModel  # the model before the fit
    data: FitData  # the points
    problem: Problem  # input of both estimators
    results: tuple[FitResult, ...]  # one for each method, in the recipe's order
    comparison: Comparison | None = None
    budget: Budget | None = None
    laws: LawComparison | None = None
    density: Density | None = None

    @property
    def simulated(self) -> bool:
        """True if any of the data is simulated."""
        return self.data.points.simulated

    @property
    def fitted(self) -> Model:
        """The model at the first method's estimates, noise parameters unchanged."""
        return _apply_estimates(self.loaded.model, self.results[0], self.recipe.name)


def _apply_estimates(model: Model, result: FitResult, name: str) -> Model:
    """Return a model at a result's estimates, noise parameters unchanged."""
    parameters = model.parameters
    for estimate in result.estimates:
        if estimate.name in parameters and not estimate.name.startswith("noise."):
            parameter = parameters[estimate.name]
            value = float(np.clip(estimate.value, parameter.lower, parameter.upper))
            source = ", ".join(filter(None, (name, estimate.bound)))
            fitted = replace(parameter.with_value(value), source=f"fitted: {source}")
            parameters = parameters.with_replaced(estimate.name, fitted)
    return model.with_values(parameters)


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
    models = _load_models(recipe, loaded.model, permit)
    problem = recipe_problem(loaded.model, recipe, data)
    estimates = (_estimate(problem, recipe, name, progress, profile) for name in recipe.methods)
    density = air_density(recipe.air, recipe.data)
    results = tuple(_add_diagnosis(loaded.model, data, problem, e, density) for e in estimates)
    comparison, laws = None, None
    if set(recipe.compare) - {LAWS}:
        models = [_prepare_comparison(other, loaded.model, recipe) for other in models]
        problems = [problem, *(recipe_problem(model, recipe, data) for model in models)]
        comparison = compare(problems, seed=recipe.seed)
    if LAWS in recipe.compare:
        progress("laws", 0, 1)
        laws = compare_laws(
            loaded.model,
            lambda model: recipe_problem(model, recipe, data),
            data.z_over_R[data.rows],
        )
    output = FitOutput(
        recipe=recipe,
        loaded=loaded,
        data=data,
        problem=problem,
        results=results,
        comparison=comparison,
        laws=laws,
        density=density,
    )
    made = _budget(output, budget == "mc", progress)
    return replace(output, budget=made, results=with_budget(results, made))


def _load_models(recipe: Recipe, model: Model, permit: CodePermit) -> list[Model]:
    """Return the models to compare, on the same rig."""
    names = [name for name in dict.fromkeys(recipe.compare) if name not in (LAWS, recipe.model)]
    try:
        return [load_model(name, model.rig, permit=permit).model for name in names]
    except UnknownChoice as unknown:
        if unknown.name in names:
            raise UnknownChoice(unknown.kind, unknown.name, (*unknown.choices, LAWS)) from None
        raise


def propagate_uncertainty(output: FitOutput) -> Propagated | None:
    """Return the propagation of errors to the first method's estimates, and further sources.

    Sources outside of the fit's covariance: errors of the observations, then errors of one
    quantity, with its name. None if the data leave a parameter open.
    """
    model, result, data, problem = output.fitted, output.results[0], output.data, output.problem
    free = [estimate.name for estimate in result.estimates]
    propagation = propagate(problem, result, _quantities(model, free, output.density))
    reference = None if data.reference is None else data.reference.select(data.rows)
    sources = fixed_parameter_sources(model, data.conditions.select(data.rows), reference)
    if propagation is None:
        return None
    bounds = {source.name: source for source in bound_sources(propagation, sources)}
    sources = tuple(
        replace(bounds[held.name], columns=bounds[held.name].sd / held.sd * held.columns)
        for held in sources
    )
    if problem.noise_name is None and result.facts.get("verdict") == "rejected":
        sources = (*sources, misfit(problem, propagation.whitening.sigma, result.chi2_per_dof))
    quantity_errors = []
    if output.density is not None and STANDARD_K in propagation.names:
        quantity_errors.append(output.density.source(result[STANDARD_K].value))
    return propagation, sources, quantity_errors


def _budget(output: FitOutput, use_monte_carlo: bool, progress: Progress) -> Budget | None:
    propagated = propagate_uncertainty(output)
    if propagated is None:
        return None
    by_propagation = make_budget(*propagated, traceability=output.data.load_cells.traceability)
    if not use_monte_carlo:
        return by_propagation
    return replace(
        by_propagation,
        monte_carlo=monte_carlo(*propagated, seed=output.recipe.seed, progress=progress),
    )


def _with_noise(model: Model, recipe: Recipe, errors: str) -> Model:
    """Return the model with the noise parameter of the recipe free."""
    kind = recipe.noise
    short_names = {name.rpartition(".")[2] for name in (*recipe.free, *recipe.fix, *recipe.hold)}
    plate_noise = model.parameters[NOISE_PLACE]
    if plate_noise.free and plate_noise.value == 0.0:
        model = model.with_values(
            model.parameters.with_replaced(NOISE_PLACE, plate_noise.with_value(PLACE_START_M))
        )
    if kind == "auto":
        is_noise_set = bool(short_names & {"scale", "sd_N"}) or plate_noise.free
        kind = "stated" if errors == "stated" or is_noise_set else "scale"
    for name in ("noise.scale", "noise.sd_N"):
        is_free = {"noise.scale": "scale", "noise.sd_N": "add"}[name] == kind
        if name.rpartition(".")[2] in short_names:  # --free and --fix override --noise
            is_free = model.parameters[name].free
        item = model.parameters[name]
        if is_free and name == "noise.sd_N" and item.value == 0.0:
            item = item.with_value(1e-3)
        model = model.with_values(model.parameters.with_replaced(name, replace(item, free=is_free)))
    return model


PLACE_START_M = 1e-4  # initial value of a free `noise.place_m` without rig data; assumed


def recipe_problem(model: Model, recipe: Recipe, data: FitData) -> Problem:
    """Return the problem with the errors of the bench at the solution.

    The effect of a position error on thrust depends on the model's parameters: it is computed at
    the initial values, and again at the estimates of a first fit.
    """
    first = _build_problem(model, model, recipe, data)
    if not first.error_sources:
        return first
    fixed_noise = first
    if first.noise_name is not None:
        fixed_noise = first.fixed(first.noise_name, first.parameters[first.noise_name].value)
    try:
        result = fit_least_squares(fixed_noise)
    except EstimationError:
        return first
    return _build_problem(model, _apply_estimates(model, result, recipe.name), recipe, data)


def _build_problem(model: Model, near: Model, recipe: Recipe, data: FitData) -> Problem:
    rows = data.rows
    problem = problem_from_model(
        model,
        data.conditions.select(rows),
        data.observed[rows],
        None if data.errors == "none" else data.standard_error[rows],
        basis=recipe.basis,
        nearest_z_over_R=None,
        groups=None if data.groups is None else data.groups[rows],
        reference=None if data.reference is None else data.reference.select(rows),
        error_sources=tuple(
            source.select(rows) for source in (*data.error_sources, *data.bench_errors(near))
        ),
    )
    if "thrust_N" not in data.points:
        return replace(problem, facts={**problem.facts, "data": "ratios"})
    if recipe.basis != "joint":
        return problem  # the calibration's scale cancels in a ratio of two thrusts
    errors = [replace(error, rows=error.rows[rows]) for error in data.load_cells.errors]
    return with_scale_errors(problem, errors)


def _prepare_comparison(other: Model, model: Model, recipe: Recipe) -> Model:
    """Return another model of the same rig with the same noise and nuisance parameters free."""
    effect_names = {effect.name for effect in other.effects}
    for effect in model.effects:
        is_nuisance = effect.subsystem in ("sensor", "plate")
        if effect.name not in effect_names and is_nuisance:
            other = other.with_effect(effect)
            for name, parameter in model.parameters.items():
                if name.startswith(f"{effect.name}."):
                    other = other.with_values(other.parameters.with_replaced(name, parameter))
    for name in ("noise.scale", "noise.sd_N"):
        other = other.with_values(other.parameters.with_replaced(name, model.parameters[name]))
    return other if recipe.basis == "joint" else other.with_fixed("k")


def _estimate(
    problem: Problem, recipe: Recipe, method: str, progress: Progress, profile: bool
) -> FitResult:
    if method == "least_squares":
        progress("least squares", 0, 1)
        result = fit_least_squares(problem, loss=recipe.loss)
        return add_profile_intervals(problem, result) if profile else result
    result = fit_ensemble(
        problem,
        walkers=recipe.walkers,
        max_steps=recipe.max_steps,
        seed=recipe.seed,
        progress=partial(progress, "emcee"),
    )
    if recipe.loss == "linear":
        return result
    note = f"emcee uses the full weight of every point: --loss {recipe.loss} is of least squares"
    return replace(result, warnings=(*result.warnings, note))


FAR_FROM_RIG = 3.0  # ratio of k to the rig's that indicates a unit error or another rig; assumed


def _far_from_rig(model: Model, result: FitResult) -> tuple[str, ...]:
    """Return a warning if the fitted thrust coefficient does not match the rig's motors."""
    rig_k = model.rig.propulsion.thrust_coefficient_N_s2
    k = next((estimate.value for estimate in result.estimates if estimate.name == "k"), rig_k)
    if k > 0.0 and 1.0 / FAR_FROM_RIG < k / rig_k < FAR_FROM_RIG:
        return ()
    return (
        f"k is {k / rig_k:.3g} times the thrust coefficient of rig {model.rig.name} ({rig_k:g} "
        f"N/(rad/s)2): check the units of thrust and speed, the motors' pole count, and that the "
        f"rig is yours",
    )


def _add_diagnosis(
    model: Model, data: FitData, problem: Problem, result: FitResult, density: Density | None
) -> FitResult:
    """Return the result with diagnosis, derived quantities, warnings and data hashes."""
    free = [estimate.name for estimate in result.estimates]
    facts = {
        **result.facts,
        "benchtool": __version__,
        "simulated": data.points.simulated,
        **{f"sha256.{path}": digest for path, digest in data.hashes.items()},
    }
    warnings = (
        *_far_from_rig(model, result),
        *data.left_out,
        *data.load_cells.warnings,
        *result.warnings,
    )
    result = replace(result, facts=facts, warnings=warnings)
    return with_derived(with_diagnosis(problem, result), _quantities(model, free, density))


def _quantities(model: Model, free: Sequence[str], density: Density | None) -> list[Derived]:
    """Return quantities derived from the free parameters, and from the air density."""
    quantities = [density.standard_k] if density is not None and "k" in free else []
    if "R_m" in free:
        radius = model.rig.propulsion.radius_m
        quantities.append(Derived("R_over_rotor_radius", "1", lambda v: v["R_m"] / radius))
    for effect in model.effects:
        if effect.derived is not None:
            names = [name for name in free if name.startswith(f"{effect.name}.")]
            quantities += effect.derived(names)
    return quantities
