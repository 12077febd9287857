"""The figures of a fit, from its output to the report's plain arrays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.fit_result import FitResult
from benchtool.data.columns import code_of
from benchtool.fit.convergence import convergence_of
from benchtool.fit.fit_data import FAR_Z_OVER_R
from benchtool.fit.run_recipe import FitOutput
from benchtool.physics.conditions import FAR_AWAY_M, Conditions
from benchtool.physics.effects.partial_coverage import factors
from benchtool.report.fit.chains import Chains, chain_figure
from benchtool.report.fit.corner import corner_figure
from benchtool.report.fit.curves import bands_over, factor_over, formula_curves
from benchtool.report.fit.residuals import Residuals, residual_figure
from benchtool.report.numbers import unit_for_people
from benchtool.report.page import Figure
from benchtool.report.palette import Role
from benchtool.report.sweep.area import AreaPoints, area_figure
from benchtool.report.sweep.ground_effect import Curve, RatioPoints, ratio_figure
from benchtool.report.sweep.thrust import ThrustSeries, thrust_figure

Array = NDArray[np.float64]

LINE_POINTS = 120

SHOWN_DRAWS = 400
"""Parameter draws behind a curve's band."""


def fit_figures(output: FitOutput) -> dict[str, Figure]:
    """Return every figure that the fit's data allow, by the name of its file."""
    simulated = output.data.points.simulated
    figures = {"residuals": _residuals(output, simulated)}
    if np.any(output.data.z_over_R[output.data.used] < FAR_Z_OVER_R):
        figures["ratio"] = ratio(output)
    if output.recipe.basis == "joint":
        figures["thrust"] = _thrust(output, simulated)
    if any(effect.name == "partial_coverage" for effect in output.fitted.effects):
        figures["area"] = _area(output, simulated)
    for result in output.results:
        if result.method == "emcee" and len(result.samples):
            figures["corner"] = _corner(output, result, simulated)
            figures["chains"] = _chains(result, simulated)
    return figures


def ratio(output: FitOutput) -> Figure:
    """Draw T_IGE/T_OGE of the data over the fitted curve and the closed formulae."""
    model, data = output.fitted, output.data
    series = ratio_points(output, _name_of_data(output))
    farthest = float(np.nanmax(series.z_over_R))
    z = np.linspace(0.5, max(1.1 * farthest, 2.0), 240)
    speeds = _typical(output).speed_rad_s
    curves = [fitted_curve(output, z), *formula_curves(model.rig, speeds, z)]
    return ratio_figure(
        (series,),
        curves,
        title=f"Ground effect: {output.recipe.name}",
        simulated=data.points.simulated,
        basis=_shown_basis(output),
    )


def ratio_points(output: FitOutput, label: str, role: Role = "measurement") -> RatioPoints:
    """Return the measured ratio at each distance: mean and standard deviation over its points.

    A single point has its stated error, if there is one. A joint fit knows the thrust out of
    ground effect at each point's own rotor speeds.
    """
    data, model = output.data, output.fitted
    measured, error = data.observed, data.standard_error
    if output.recipe.basis == "joint":
        values = model.parameters.values_array()
        far = data.conditions.out_of_ground_effect()
        flow = model.flow(far, values)
        alone = model.parameters["k"].value * model.squared_speed(flow, values)
        measured = 1.0 + (data.observed - model.thrust_N(far)) / alone
        error = error / alone
    elif data.reference is not None:  # what the parked plate itself adds
        parked = np.broadcast_to(model.factor(data.reference), measured.shape)
        measured, error = measured * parked, error * parked
    shown = np.isfinite(measured) & (data.z_over_R < FAR_Z_OVER_R) & _fully_covered(output)
    distance = np.round(data.z_over_R, 2)
    rows = []
    for here in np.unique(distance[shown]):
        at = shown & (distance == here)
        if at.sum() > 1:
            sd = float(np.std(measured[at], ddof=1))
        else:
            sd = float(error[at][0]) if data.errors == "stated" else float("nan")
        rows.append((data.z_over_R[at].mean(), measured[at].mean(), sd, not data.used[at].any()))
    table = np.array(rows, float).reshape(-1, 4)
    return RatioPoints(table[:, 0], table[:, 1], table[:, 2], label, role, table[:, 3].astype(bool))


def fitted_curve(
    output: FitOutput, z_over_R: Array, label: str = "", role: Role = "body_lift"
) -> Curve:
    """Return the fitted model's curve with its 68 and 95 % bands."""
    result = output.results[-1]
    known = bool(len(result.samples)) or bool(np.isfinite(result.covariance).all())
    speeds = _typical(output).speed_rad_s
    middle = factor_over(output.fitted, speeds, z_over_R)
    if not known:  # data that do not determine the curve have no band
        return Curve(z_over_R, middle, label or f"fit: {output.fitted.name}", role, "fit")
    rng = np.random.default_rng(output.recipe.seed)
    if len(result.samples):
        draws = result.samples[rng.integers(len(result.samples), size=SHOWN_DRAWS)]
    else:
        draws = rng.multivariate_normal(
            result.values, result.covariance, SHOWN_DRAWS, method="svd", check_valid="ignore"
        )
    names = [estimate.name for estimate in result.estimates]
    free = {name: draws[:, [column]] for column, name in enumerate(names)}
    bands = bands_over(output.fitted, speeds, z_over_R, free)
    return Curve(z_over_R, middle, label or f"fit: {output.fitted.name}", role, "fit", bands)


def _typical(output: FitOutput) -> Conditions:
    """Return the conditions of the used point whose rotors turn fastest."""
    rows = output.data.rows
    fastest = rows[np.argmax(output.data.conditions.speed_rad_s[:, rows].sum(axis=0))]
    return output.data.conditions.select(np.array([fastest]))


def _fully_covered(output: FitOutput) -> NDArray[np.bool_]:
    conditions = output.data.conditions
    squares = np.zeros_like(conditions.coverage)
    for rotor, disc in enumerate(output.fitted.rig.disc_of_rotor):
        squares[disc] += conditions.speed_rad_s[rotor] ** 2
    level: NDArray[np.bool_] = conditions.plate_tilt_rad == 0.0
    covered: NDArray[np.bool_] = np.all((conditions.coverage > 0.999) | (squares == 0.0), axis=0)
    both: NDArray[np.bool_] = np.logical_and(covered, level)
    return both


def _shown_basis(output: FitOutput) -> str:
    return "equal_rpm2" if output.recipe.basis == "joint" else output.recipe.basis


def _name_of_data(output: FitOutput) -> str:
    points = output.data.points
    repeats = "stated error" if output.data.errors == "stated" else "mean and sd over repeats"
    return f"simulated bench, {repeats}" if points.simulated else f"measured, {repeats}"


def _residuals(output: FitOutput, simulated: bool) -> Figure:
    rows, data = output.data.rows, output.data
    far = np.where(data.conditions.plate_z_m[rows] >= FAR_AWAY_M, np.inf, data.z_over_R[rows])
    standardised = (data.observed[rows] - _predicted(output)) / output.problem.sigma(_noise(output))
    time = data.conditions.time_s[rows]
    order = time if np.ptp(time) > 0.0 else np.arange(len(rows), dtype=float)
    return residual_figure(
        Residuals(far, order, standardised),
        title=f"What the fit leaves over: {output.recipe.name}",
        simulated=simulated,
    )


def _predicted(output: FitOutput) -> Array:
    result, problem = output.results[0], output.problem
    return problem.predicted(np.array([result[name].value for name in problem.shape_names]))


def _noise(output: FitOutput) -> float | None:
    name = output.problem.noise_name
    return None if name is None else output.results[0][name].value


def _thrust(output: FitOutput, simulated: bool) -> Figure:
    data, model = output.data, output.fitted
    predicted = np.broadcast_to(model.thrust_N(data.conditions), data.observed.shape)
    turning = np.maximum((data.conditions.speed_rad_s > 0.0).sum(axis=0), 1)
    speed = np.sqrt((data.conditions.speed_rad_s**2).sum(axis=0) / turning)
    distance = np.where(data.conditions.plate_z_m >= FAR_AWAY_M, np.inf, data.z_over_R.round(2))
    if "kind" in data.points:
        parked = data.points.column("kind") == code_of("kind", "reference")
        distance = np.where(parked, np.inf, distance)
    series = []
    for here in np.unique(distance[data.used]):
        at = np.flatnonzero(data.used & (distance == here))
        at = at[np.argsort(speed[at], kind="stable")]
        series.append(
            ThrustSeries(
                float(here),
                speed[at],
                data.observed[at],
                data.standard_error[at] if data.errors != "none" else np.full(len(at), np.nan),
                predicted[at],
                *_line(output, at[-1]),
            )
        )
    return thrust_figure(
        series, title=f"Thrust against rotor speed: {output.recipe.name}", simulated=simulated
    )


def _line(output: FitOutput, fastest: int) -> tuple[Array, Array]:
    """Return the fitted model from standstill to a point's speeds (l,): rad/s, N.

    Plate, tare and drift are those of that point, and its rotors keep their ratios of speed.
    """
    here = output.data.conditions.select(np.full(LINE_POINTS, fastest))
    share = np.linspace(0.0, 1.03, LINE_POINTS)
    turning = replace(here, speed_rad_s=here.speed_rad_s * share)
    speeds = turning.speed_rad_s[here.speed_rad_s[:, 0] > 0.0]
    return np.sqrt((speeds**2).mean(axis=0)), output.fitted.thrust_N(turning)


def _area(output: FitOutput, simulated: bool) -> Figure:
    data, model = output.data, output.fitted
    values = model.parameters.values_array()
    whole = Conditions.of(
        model.rig,
        speed_rad_s=data.conditions.speed_rad_s,
        plate_z_m=data.conditions.plate_z_m,
        coverage=np.ones_like(data.conditions.coverage),
        elapsed_s=data.conditions.elapsed_s,
        time_s=data.conditions.time_s,
    )
    none = whole.out_of_ground_effect()
    if output.recipe.basis == "joint":
        low, high = model.thrust_N(none, values), model.thrust_N(whole, values)
    else:
        low, high = np.ones(len(whole)), model.factor(whole, values)
    share = (data.observed - low) / (high - low)
    coverage = data.conditions.coverage.mean(axis=0)
    shown = data.used & (data.z_over_R < FAR_Z_OVER_R) & (high - low > 0.01 * low)
    rows = []
    for here in np.unique(coverage[shown].round(2)):
        at = shown & (coverage.round(2) == here)
        sd = float(np.std(share[at], ddof=1)) if at.sum() > 1 else float("nan")
        rows.append((coverage[at].mean(), share[at].mean(), sd))
    table = np.array(rows, float).reshape(-1, 3)
    return area_figure(
        [AreaPoints(table[:, 0], table[:, 1], table[:, 2], _name_of_data(output))],
        _area_factors(output),
        title=f"Increment against covered area: {output.recipe.name}",
        simulated=simulated,
    )


def _area_factors(output: FitOutput) -> AreaPoints:
    model, result = output.fitted, output.results[0]
    items = model.parameters
    count = sum(name.startswith("partial_coverage.knot_") for name in items)
    knots = np.array([items[f"partial_coverage.knot_{k + 1}"].value for k in range(count)])
    shares = [items[f"partial_coverage.share_{k + 1}"].value for k in range(count)]
    known = {estimate.name: estimate.sd for estimate in result.derived}
    names = [f"partial_coverage.factor_{k + 1}" for k in range(count)]
    sd = np.array([known.get(name, float("nan")) for name in names])
    return AreaPoints(knots, np.array(factors(shares)), sd, "fitted area factors", "body_lift")


def _labels(result: FitResult) -> list[str]:
    labels = []
    for estimate in result.estimates:
        owner, _, own = estimate.name.rpartition(".")
        unit = "" if estimate.unit == "1" else f" [{unit_for_people(estimate.unit)}]"
        labels.append(f"{owner}\n{own}{unit}" if owner else f"{own}{unit}")
    return labels


def _corner(output: FitOutput, result: FitResult, simulated: bool) -> Figure:
    names = [estimate.name for estimate in result.estimates]
    references = {}
    for other in output.results:
        if other.method == "least_squares":
            known = {estimate.name: estimate.value for estimate in other.estimates}
            references["least squares"] = [known.get(name, float("nan")) for name in names]
    return corner_figure(
        result.samples,
        _labels(result),
        title=f"Posterior: {output.recipe.name}",
        simulated=simulated,
        references=references,
        notes=[estimate.bound for estimate in result.estimates],
    )


def _chains(result: FitResult, simulated: bool) -> Figure:
    ensembles, walkers = int(result.facts["ensembles"] or 1), int(result.facts["walkers"] or 1)
    draws = result.samples.reshape(-1, ensembles, walkers, len(result.estimates))
    verdict = convergence_of(draws)
    kept_every = float(result.facts["steps_kept"] or 1) / len(draws)
    return chain_figure(
        Chains(
            _labels(result),
            draws.transpose(1, 0, 2, 3),
            verdict.rhat,
            verdict.tau_steps * kept_every,
        ),
        title=f"Chains of {ensembles} ensembles: {result.model}",
        simulated=simulated,
    )
