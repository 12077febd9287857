"""Figures of a fit: thrust ratio, thrust, partial coverage and scores of laws."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import isfinite, nan
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array, from_si
from benchtool.data.columns import word_to_code
from benchtool.fit.fit_data import REFERENCE_Z_OVER_R
from benchtool.fit.run_recipe import FitOutput
from benchtool.physics.bases import ground_effect_ratio
from benchtool.physics.conditions import OUT_OF_GROUND_EFFECT_M, Conditions
from benchtool.physics.effects.partial_coverage import PARTIAL_COVERAGE, factor_table
from benchtool.report.figure import figure
from benchtool.report.fit.tables import scored_laws
from benchtool.report.palette import BLACK, BLUE, DASHED, GREY, VERMILION, Role
from benchtool.report.panels import points, stack_panels
from benchtool.report.ratio import (
    Curve,
    RatioPoints,
    curve_distances,
    draw_ratio,
    formula_curves,
    model_curve,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


LINE_POINTS = 120
SHOWN_DRAWS = 400  # parameter draws behind a curve's band


def titled(title: str, fit: FitOutput) -> str:
    """Return the title with the name of the fit, and a remark if the model is rejected."""
    rejected = any(result.facts.get("verdict") == "rejected" for result in fit.results)
    return f"{title}: {fit.recipe.name}" + (" (model rejected)" if rejected else "")


@figure(
    title=lambda fit: titled("Ground effect", fit),
    caption="Thrust ratio T_IGE/T_OGE. Points: mean and standard deviation over repeats (a single "
    "point: its stated error, if any); solid line: fitted model with statistical 68 % and 95 % "
    "bands; dashed: closed-form image formulae (PFI).",
    when=lambda fit: bool(np.any(fit.data.z_over_R[fit.data.used] < REFERENCE_Z_OVER_R)),
)
def ratio(figure: Figure, fit: FitOutput) -> None:
    """Draw T_IGE/T_OGE of the data, the fitted curve and the closed-form formulae."""
    series = ratio_points(fit, name_of_data(fit))
    if np.isnan(series.sd).all():
        series = replace(series, label=series.label.partition(",")[0])  # no bars
    z, speeds = curve_distances([series], fit.fitted), _fastest(fit).speed_rad_s
    curves = [fitted_curve(fit, z), *formula_curves(fit.fitted.rig, speeds, z)]
    draw_ratio(figure, [series], curves, shown_basis(fit))


def shown_basis(fit: FitOutput) -> str:
    """Return the basis of the ratios; a joint fit of thrust is at equal speed."""
    return "equal_rpm2" if fit.recipe.basis == "joint" else fit.recipe.basis


def ratio_points(fit: FitOutput, label: str, role: Role = "measurement") -> RatioPoints:
    """Return the measured ratio at each distance: mean and standard deviation of its points.

    A single point has its stated error, if there is one. In a joint fit the model gives the thrust
    out of ground effect at the rotor speeds of each point.
    """
    data, model = fit.data, fit.fitted
    measured, error = data.observed, data.standard_error
    if fit.recipe.basis == "joint":
        values = model.parameters.values_array()
        oge_conditions = data.conditions.out_of_ground_effect()
        oge_thrust_N = model.parameters["k"].value * model.squared_speed(
            model.flow(oge_conditions, values), values
        )
        measured = 1.0 + (data.observed - model.thrust_N(oge_conditions)) / oge_thrust_N
        error = error / oge_thrust_N
    elif data.reference is not None:  # effect of the parked plate
        parked = ground_effect_ratio(model, fit.recipe.basis, data.reference)
        parked = np.broadcast_to(parked, measured.shape)
        measured, error = measured * parked, error * parked
    is_shown = np.isfinite(measured) & (data.z_over_R < REFERENCE_Z_OVER_R) & _fully_covered(fit)
    distance = np.round(data.z_over_R, 2)
    rows = []
    for bin_distance in np.unique(distance[is_shown]):
        in_bin = is_shown & (distance == bin_distance)
        single = float(error[in_bin][0]) if data.errors == "stated" else nan
        rows.append((
            data.z_over_R[in_bin].mean(), *_mean_and_sd(measured[in_bin], single),
            not data.used[in_bin].any(),
        ))  # fmt: skip
    z, mean, sd, is_excluded = np.array(rows, float).reshape(-1, 4).T
    return RatioPoints(z, mean, sd, label, role, is_excluded.astype(bool))


def _mean_and_sd(values: Array, single: float = nan) -> tuple[float, float]:
    """Return mean and standard deviation of values; `single` is the sd of a single one."""
    return float(values.mean()), float(np.std(values, ddof=1)) if len(values) > 1 else single


def ratio_rows(fit: FitOutput) -> list[dict[str, float]]:
    """Return measured z/R, T_IGE/T_OGE and its standard deviation at each distance."""
    points = ratio_points(fit, "")
    rows = zip(points.z_over_R, points.ratio, points.sd, strict=True)
    return [{"z_over_R": z, "ratio": ratio, "sd": sd} for z, ratio, sd in rows]


def fitted_curve(fit: FitOutput, z_over_R: Array, levels: Sequence[float] = (68, 95)) -> Curve:
    """Return the curve of the fitted model with its statistical bands at levels in percent."""
    result, rng = fit.results[-1], np.random.default_rng(fit.recipe.seed)
    draws = np.empty((0, len(result.estimates)))  # no band if the data do not determine the curve
    if len(result.samples):
        draws = result.samples[rng.integers(len(result.samples), size=SHOWN_DRAWS)]
    elif np.isfinite(result.covariance).all():
        draws = rng.multivariate_normal(
            result.values, result.covariance, SHOWN_DRAWS, method="svd", check_valid="ignore"
        )
    free = {item.name: draws[:, [k]] for k, item in enumerate(result.estimates) if len(draws)}
    model, speeds = fit.fitted, _fastest(fit).speed_rad_s
    label, basis = f"fit: {model.name}", shown_basis(fit)
    return model_curve(model, speeds, z_over_R, free, basis, label, levels)


def _fastest(fit: FitOutput) -> Conditions:
    """Return the conditions of the used point whose rotors turn fastest."""
    rows = fit.data.rows
    fastest = rows[np.argmax(fit.data.conditions.speed_rad_s[:, rows].sum(axis=0))]
    return fit.data.conditions.select(np.array([fastest]))


def _fully_covered(fit: FitOutput) -> NDArray[np.bool_]:
    """Return a mask of points with a level plate under every driven disc."""
    conditions = fit.data.conditions
    squares = np.zeros_like(conditions.coverage)
    for rotor, disc in enumerate(fit.fitted.rig.disc_of_rotor):
        squares[disc] += conditions.speed_rad_s[rotor] ** 2
    covered = np.all((conditions.coverage > 0.999) | (squares == 0.0), axis=0)
    return np.asarray(covered & (conditions.plate_tilt_rad == 0.0), bool)


def name_of_data(fit: FitOutput) -> str:
    """Return the legend label of the data."""
    repeats = "bars: sd of repeats" + ", else stated error" * (fit.data.errors == "stated")
    return f"{'simulated bench' if fit.simulated else 'measured'}, {repeats}"


@figure(
    title=lambda fit: titled("Thrust against rotor speed", fit),
    caption="Thrust against rotor speed at each plate distance (lines: fitted model), and "
    "residuals.",
    when=lambda fit: fit.recipe.basis == "joint",
    height_in=5.6,
)
def thrust(figure: Figure, fit: FitOutput) -> None:
    """Draw thrust against rotor speed at each distance; below: residuals."""
    data = fit.data
    predicted = np.broadcast_to(fit.fitted.thrust_N(data.conditions), data.observed.shape)
    error = data.standard_error if data.errors != "none" else np.full(len(data.observed), np.nan)
    labels = ("thrust [N]", "measured −\nmodel [N]")
    above, below = stack_panels(figure, (2.4, 1.0), labels, "rotor speed [rpm]")
    for label, rows, color, marker in _levels(fit):
        rpm = from_si(_mean_speed(data.conditions)[rows], "rpm")
        points(above, rpm, data.observed[rows], error[rows], color, marker, ms=4.2, label=label)
        speeds, line_N = _line(fit, rows[-1])
        above.plot(from_si(speeds, "rpm"), line_N, color=color, lw=1.2)
        points(below, rpm, (data.observed - predicted)[rows], error[rows], color, marker, ms=4.2)
    above.legend(loc="upper left", ncols=2 if len(above.containers) > 6 else 1)
    below.axhline(0.0, color=GREY, linewidth=0.9)


def _levels(fit: FitOutput) -> Iterator[tuple[str, NDArray[np.intp], str, str]]:
    """Yield label, rows by increasing speed, colour and marker of each plate distance."""
    import matplotlib as mpl

    data = fit.data
    distance = np.where(
        data.conditions.plate_z_m >= OUT_OF_GROUND_EFFECT_M, np.inf, data.z_over_R.round(2)
    )
    if "kind" in data.points:
        parked = data.points.column("kind") == word_to_code("kind", "reference")
        distance = np.where(parked, np.inf, distance)
    distances = np.unique(distance[data.used])
    shades = mpl.colormaps["viridis"](np.linspace(0.0, 0.88, max(np.isfinite(distances).sum(), 1)))
    for index, level_distance in enumerate(distances):
        rows = np.flatnonzero(data.used & (distance == level_distance))
        rows = rows[np.argsort(_mean_speed(data.conditions)[rows], kind="stable")]
        if isfinite(level_distance):
            yield f"$z/R$ = {level_distance:.3g}", rows, mpl.colors.to_hex(shades[index]), "o"
        else:
            yield "out of ground effect", rows, BLACK, "s"


def _mean_speed(conditions: Conditions) -> Array:
    """Return the root mean square speed (n,) of the driven rotors: rad/s."""
    turning = np.maximum((conditions.speed_rad_s > 0.0).sum(axis=0), 1)
    return np.asarray(np.sqrt((conditions.speed_rad_s**2).sum(axis=0) / turning), float)


def _line(fit: FitOutput, fastest: int) -> tuple[Array, Array]:
    """Return speeds (l,) from standstill to those of a point, and model thrust: rad/s, N."""
    fixed = fit.data.conditions.select(np.full(LINE_POINTS, fastest))
    conditions = replace(fixed, speed_rad_s=fixed.speed_rad_s * np.linspace(0.0, 1.03, LINE_POINTS))
    speeds = conditions.speed_rad_s[fixed.speed_rad_s[:, 0] > 0.0]
    return np.sqrt((speeds**2).mean(axis=0)), fit.fitted.thrust_N(conditions)


@figure(
    title="Increment against covered area: {0.recipe.name}",
    caption="Share of the full thrust increment for a partly covered rotor disc.",
    when=lambda fit: any(effect.name == PARTIAL_COVERAGE for effect in fit.fitted.effects),
    height_in=5.4,
)
def area(figure: Figure, fit: FitOutput) -> None:
    """Draw shares of the full increment; below: deviations from the straight line."""
    labels = ("share of the full\nthrust increment [–]", "deviation from\nthe line [–]")
    xlabel = "covered share of the rotor disc's area [–]"
    share, departure = stack_panels(figure, (2.2, 1.0), labels, xlabel)
    ends = np.array([0.0, 1.0])
    share.plot(ends, ends, color=BLACK, linestyle=DASHED, label="proportional to the area")
    departure.axhline(0.0, color=BLACK, linestyle=DASHED, linewidth=1.2)
    covered, measured, sd = _increments(fit)
    points(share, covered, measured, sd, BLUE, label=name_of_data(fit))
    points(departure, covered, measured - covered, sd, BLUE)
    factors = {name: item.value for name, item in fit.fitted.parameters.items()}
    covered_at, fitted, sd = factor_table(
        factors, {item.name: item.sd for item in fit.results[0].derived}
    )
    lines = ((share, fitted, "fitted area factors"), (departure, fitted - covered_at, None))
    for axes, values, label in lines:
        axes.fill_between(covered_at, values - sd, values + sd, color=VERMILION, alpha=0.2, lw=0.0)
        axes.plot(covered_at, values, "v-", color=VERMILION, ms=5.0, lw=1.3, label=label)
    share.legend(loc="upper left")
    departure.set_xlim(-0.03, 1.03)


def _increments(fit: FitOutput) -> tuple[Array, Array, Array]:
    """Return covered area (m,), share of the full increment and its standard deviation."""
    data, model = fit.data, fit.fitted
    values = model.parameters.values_array()
    whole = replace(data.conditions, coverage=np.ones_like(data.conditions.coverage))
    if fit.recipe.basis == "joint":
        low = model.thrust_N(whole.out_of_ground_effect(), values)
        high = model.thrust_N(whole, values)
    else:
        low, high = np.ones(len(whole)), ground_effect_ratio(model, fit.recipe.basis, whole, values)
    share = (data.observed - low) / (high - low)
    coverage = data.conditions.coverage.mean(axis=0)
    is_shown = data.used & (data.z_over_R < REFERENCE_Z_OVER_R) & (high - low > 0.01 * low)
    rows = []
    for level in np.unique(coverage[is_shown].round(2)):
        rows_at = is_shown & (coverage.round(2) == level)
        rows.append((coverage[rows_at].mean(), *_mean_and_sd(share[rows_at])))
    covered, mean, sd = np.array(rows, float).reshape(-1, 3).T
    return covered, mean, sd


@figure(
    title="Laws on held-out distances: {0.recipe.name}",
    caption=(
        "Mean loss of log score per distance relative to the best law (0), ± two standard errors, "
        "corrected for overlapping folds. Rejected laws are listed in the table."
    ),
    when=lambda fit: fit.laws is not None and len(scored_laws(fit.laws)) > 1,
)
def laws(figure: Figure, fit: FitOutput) -> None:
    """Draw the log score loss of each scored law, best on top."""
    assert fit.laws is not None
    scores = scored_laws(fit.laws)
    axes = figure.subplots()
    rows = range(len(scores))
    errors = [2.0 * score.behind_se for score in scores]
    axes.errorbar([score.behind for score in scores], rows, xerr=errors, fmt="o")
    axes.axvline(0.0, color=GREY, lw=0.8)
    axes.set_yticks(rows, [f"{score.law}\n{score.verdict}" for score in scores])
    axes.invert_yaxis()
    axes.set_xscale("symlog", linthresh=1.0)
    axes.set(xlabel="log score loss per distance [–], ± two standard errors", ylabel="law")
