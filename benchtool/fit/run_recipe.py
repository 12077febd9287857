"""Run a recipe: read its data, estimate by each method, hold models against each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchtool import __version__
from benchtool.core.error_source import ErrorSource
from benchtool.core.errors import EstimationError, InputError, UnknownChoice
from benchtool.core.fit_result import FitResult
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.run.read import parts_of
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
from benchtool.fit.uncertainty.budget import Budget, BudgetMethod, with_budget
from benchtool.fit.uncertainty.density import STANDARD_K, Density, air_density
from benchtool.fit.uncertainty.fixed_parameters import fixed_parameter_sources, misfit
from benchtool.fit.uncertainty.load_cell import with_scale_errors
from benchtool.fit.uncertainty.monte_carlo import monte_carlo
from benchtool.fit.uncertainty.propagation import Propagation, bounded, budget_of, propagation
from benchtool.physics.effects.effect import Derived
from benchtool.physics.model import Model
from benchtool.physics.model_file import LoadedModel, load_model

Progress = Callable[[str, int, int], None]  # progress(what, steps done, steps expected)
Propagated = tuple[Propagation, tuple[ErrorSource, ...], list[tuple[ErrorSource, str]]]
"""How errors reach quantities, errors that the fit does not hold, and those of one quantity."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FitOutput:
    """Carry everything that a fit made.

    Attributes:
        comparison: of the recipe's models on held-out points, None when none were named.
        budget: of the first method's values; None where the data leave one open.
        density: of the air, None where nobody measured it.
        laws: of thrust against distance on held-out distances, None when nobody wanted them.
    """

    recipe: Recipe  # as it was given, merged runs as their parts
    loaded: LoadedModel  # the model as it was fitted, before
    data: FitData  # the points
    problem: Problem  # as both estimators took it
    results: tuple[FitResult, ...]  # one for each method, in the recipe's order
    comparison: Comparison | None = None
    budget: Budget | None = None
    laws: LawComparison | None = None
    density: Density | None = None

    @property
    def simulated(self) -> bool:
        """Whether any of the data comes from no physical bench."""
        return self.data.points.simulated

    @property
    def fitted(self) -> Model:
        """The model at the first method's values, its noise parameters as they were."""
        return _fitted(self.loaded.model, self.results[0], self.recipe.name)


def _fitted(model: Model, result: FitResult, name: str) -> Model:
    """Return a model at a result's values, its noise parameters as they were."""
    parameters = model.parameters
    for estimate in result.estimates:
        if estimate.name in parameters and not estimate.name.startswith("noise."):
            item = parameters[estimate.name]
            value = float(np.clip(estimate.value, item.lower, item.upper))
            source = ", ".join(filter(None, (name, estimate.bound)))
            fitted = replace(item.with_value(value), source=f"fitted: {source}")
            parameters = parameters.with_replaced(estimate.name, fitted)
    return model.with_values(parameters)


@np.errstate(all="ignore")  # what is not finite is left out or refused by name
def run_recipe(
    recipe: Recipe,
    progress: Progress = lambda what, done, expected: None,
    *,
    profile: bool = False,
    budget: BudgetMethod = "propagation",
    permit: CodePermit = check_code_allowed,
) -> FitOutput:
    """Run a recipe and return what it made.

    Args:
        profile: intervals of least squares from the profile likelihood.
        budget: "mc" checks the propagation of errors by Monte Carlo.
        permit: called with the file of a model's own effects before it is run.

    Raises:
        InputError: the data or the model do not allow the fit.
        EstimationError: no estimate can be given.
    """
    if profile and (recipe.loss != "linear" or "least_squares" not in recipe.methods):
        raise InputError(
            "--profile is of least squares with --loss linear; leave --profile out, or take "
            "--method least_squares --loss linear"
        )
    recipe = replace(recipe, data=tuple(part for path in recipe.data for part in parts_of(path)))
    loaded = recipe_model(recipe, permit)
    data = read_fit_data(recipe, loaded)
    loaded = replace(loaded, model=_with_noise(loaded.model, recipe, data.errors))
    others = _others(recipe, loaded.model, permit)
    problem = recipe_problem(loaded.model, recipe, data)
    estimates = (_estimate(problem, recipe, one, progress, profile) for one in recipe.methods)
    density = air_density(recipe.air, recipe.data)
    results = tuple(_named(loaded.model, data, problem, one, density) for one in estimates)
    comparison, laws = None, None
    if set(recipe.compare) - {LAWS}:
        models = [_as_compared(other, loaded.model, recipe) for other in others]
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


def _others(recipe: Recipe, model: Model, permit: CodePermit) -> list[Model]:
    """Return the models that the recipe's own is compared with, of the same rig."""
    names = [name for name in dict.fromkeys(recipe.compare) if name not in (LAWS, recipe.model)]
    try:
        return [load_model(name, model.rig, permit=permit).model for name in names]
    except UnknownChoice as unknown:
        if unknown.name in names:
            raise UnknownChoice(unknown.kind, unknown.name, (*unknown.known, LAWS)) from None
        raise


def propagate_uncertainty(output: FitOutput) -> Propagated | None:
    """Return how errors reach the first method's values, and those that its fit does not hold.

    They are errors of the observations, then of one quantity alone, with its name. None where the
    data leave a parameter open.
    """
    model, result, data, problem = output.fitted, output.results[0], output.data, output.problem
    free = [item.name for item in result.estimates]
    way = propagation(problem, result, _quantities(model, free, output.density))
    reference = None if data.reference is None else data.reference.select(data.rows)
    held = fixed_parameter_sources(model, data.conditions.select(data.rows), reference)
    if way is None:
        return None
    known = {source.name: source for source in bounded(way, held)}
    held = tuple(
        replace(known[one.name], columns=known[one.name].sd / one.sd * one.columns) for one in held
    )
    if problem.noise_name is None and result.facts.get("verdict") == "rejected":
        held = (*held, misfit(problem, way.whitening.sigma, result.chi2_per_dof))
    beside = []
    if output.density is not None and STANDARD_K in way.names:
        beside.append(output.density.source(result[STANDARD_K].value))
    return way, held, beside


def _budget(output: FitOutput, checked: bool, progress: Progress) -> Budget | None:
    found = propagate_uncertainty(output)
    if found is None:
        return None
    made = budget_of(*found, traceability=output.data.load_cells.traceability)
    if not checked:
        return made
    return replace(
        made, monte_carlo=monte_carlo(*found, seed=output.recipe.seed, progress=progress)
    )


def _with_noise(model: Model, recipe: Recipe, errors: str) -> Model:
    """Return the model with the noise parameter free that the recipe names."""
    kind = recipe.noise
    typed = {name.rpartition(".")[2] for name in (*recipe.free, *recipe.fix, *recipe.hold)}
    place = model.parameters[NOISE_PLACE]
    if place.free and place.value == 0.0:
        model = model.with_values(
            model.parameters.with_replaced(NOISE_PLACE, place.with_value(PLACE_START_M))
        )
    if kind == "auto":
        named = bool(typed & {"scale", "sd_N"}) or place.free
        kind = "stated" if errors == "stated" or named else "scale"
    for name in ("noise.scale", "noise.sd_N"):
        wanted = {"noise.scale": "scale", "noise.sd_N": "add"}[name] == kind
        if name.rpartition(".")[2] in typed:  # named by itself, which goes before the kind
            wanted = model.parameters[name].free
        item = model.parameters[name]
        if wanted and name == "noise.sd_N" and item.value == 0.0:
            item = item.with_value(1e-3)
        model = model.with_values(model.parameters.with_replaced(name, replace(item, free=wanted)))
    return model


PLACE_START_M = 1e-4  # start of a free `noise.place_m` on a rig that states none; assumed


def recipe_problem(model: Model, recipe: Recipe, data: FitData) -> Problem:
    """Return the problem, errors of the bench as they are at the solution.

    What an error of place does to a thrust depends on the model's values: it is worked out at the
    present ones, and once more at those that a first fit finds.
    """
    first = _stated_problem(model, model, recipe, data)
    if not first.error_sources:
        return first
    still = first
    if first.noise_name is not None:
        still = first.fixed(first.noise_name, first.parameters[first.noise_name].value)
    try:
        found = fit_least_squares(still)
    except EstimationError:
        return first
    return _stated_problem(model, _fitted(model, found, recipe.name), recipe, data)


def _stated_problem(model: Model, near: Model, recipe: Recipe, data: FitData) -> Problem:
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
            source.of(rows) for source in (*data.error_sources, *data.bench_errors(near))
        ),
    )
    if "thrust_N" not in data.points:
        return replace(problem, facts={**problem.facts, "data": "ratios"})
    if recipe.basis != "joint":
        return problem  # a ratio of two thrusts does not know the calibration's scale
    errors = [replace(error, rows=error.rows[rows]) for error in data.load_cells.errors]
    return with_scale_errors(problem, errors)


def _as_compared(other: Model, model: Model, recipe: Recipe) -> Model:
    """Return another model of the same rig, with the same noise and the same nuisances free."""
    own = {effect.name for effect in other.effects}
    for effect in model.effects:
        is_nuisance = effect.subsystem in ("sensor", "plate")
        if effect.name not in own and is_nuisance:
            other = other.with_effect(effect)
            for name, item in model.parameters.items():
                if name.startswith(f"{effect.name}."):
                    other = other.with_values(other.parameters.with_replaced(name, item))
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
    note = f"emcee counts every point in full: --loss {recipe.loss} acts on least squares alone"
    return replace(result, warnings=(*result.warnings, note))


FAR_FROM_RIG = 3.0  # k so many times off the rig's: other units or another vehicle; assumed


def _far_from_rig(model: Model, result: FitResult) -> tuple[str, ...]:
    """Say when the fitted thrust coefficient cannot be that of the rig's motors."""
    own = model.rig.propulsion.thrust_coefficient_N_s2
    found = next((item.value for item in result.estimates if item.name == "k"), own)
    if found > 0.0 and 1.0 / FAR_FROM_RIG < found / own < FAR_FROM_RIG:
        return ()
    return (
        f"k is {found / own:.3g} times the thrust coefficient of rig {model.rig.name} ({own:g} "
        f"N/(rad/s)2): check the units of thrust and speed, the motors' pole count, and that the "
        f"rig is yours",
    )


def _named(
    model: Model,
    data: FitData,
    problem: Problem,
    result: FitResult,
    density: Density | None,
) -> FitResult:
    """Return the result with its diagnosis, derived quantities, what was left out, hashes."""
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
    """Return what is computed from the free parameters, and from the air."""
    quantities = [density.standard_k] if density is not None and "k" in free else []
    if "R_m" in free:
        radius = model.rig.propulsion.radius_m
        quantities.append(Derived("R_over_rotor_radius", "1", lambda v: v["R_m"] / radius))
    for effect in model.effects:
        if effect.derived is not None:
            own = [name for name in free if name.startswith(f"{effect.name}.")]
            quantities += effect.derived(own)
    return quantities
