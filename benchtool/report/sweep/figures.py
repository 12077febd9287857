"""Figures of a sweep: thrust ratio, thrust, efficiency and quantities over plate distance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array, from_si
from benchtool.data.derived import QuantityValues
from benchtool.fit.nominal import NominalModel
from benchtool.physics.bases import thrust_per_power_N_W
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model
from benchtool.report.figure import figure, legend_line, legend_patch
from benchtool.report.fit.budget import budget, chart_height
from benchtool.report.palette import BLUE, CYCLE, GREY, ORANGE, Role
from benchtool.report.panels import panels_height, points, quantity_panels, stack_panels
from benchtool.report.ratio import (
    BASES,
    DISTANCE_LABEL,
    Curve,
    RatioPoints,
    conditions_over,
    curve_distances,
    draw_ratio,
    formula_curves,
    model_curve,
    ratio_values,
    uncertainty_band,
)
from benchtool.report.sweep.run import ERRORS, SweepRun

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


RUN_ROLES: tuple[Role, ...] = ("single_rotor", "second_rig", "three_rotors", "measurement", "muted")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
DOTTED = (0, (1.2, 1.6))


def model_words(run: SweepRun) -> str:
    """Return a caption on the model drawn with a run and its bands; "" without a model."""
    model = run.model
    if model is None:
        return ""
    bands = f" Bands: {model.spread}." if model.spread else " Without uncertainty."
    fitted = f", fitted to {', '.join(model.fitted_to)}" if model.fitted_to else ""
    return f" Model: {model.model.name}{fitted}.{bands}"


def plain(run: SweepRun) -> NDArray[np.bool_]:
    """Return a mask (s,) of settings with a level, centred plate, as in model curves."""
    offsets = np.array([run.column(name) for name in ("plate_tilt_deg", "plate_x_m")])
    is_plain = run.measured() & np.all(np.abs(np.nan_to_num(offsets)) < 1e-6, axis=0)
    return np.asarray(is_plain, bool)


def _max_speeds(run: SweepRun) -> Array:
    """Return the speeds (n_rotors, 1) of the fastest setting: rad/s."""
    speeds = run.of_rotors("rpm{}") * np.pi / 30.0
    if not np.isfinite(speeds).any():
        p = run.rig.propulsion
        speeds = p.speed_per_us_rad_s * np.maximum(run.of_rotors("pwm{}_us") - p.pwm_start_us, 0.0)
    speeds = np.nan_to_num(speeds)
    return np.asarray(speeds[:, [int(np.argmax(speeds.sum(axis=0)))]], float)


def _ratios(run: SweepRun, label: str, role: Role = "measurement") -> list[RatioPoints]:
    """Return the measured ratios of a run; tilted or shifted plates as a separate series."""
    z, straight, near = run.z_over_R(run.settings), plain(run), run.measured()
    series = []
    for rows, name, series_role in (
        (straight, label, role),
        (near & ~straight, f"{label}, plate tilted or shifted", "muted"),
    ):
        rows = rows & np.isfinite(run.ratio)
        if rows.any():
            series.append(
                RatioPoints(z[rows], run.ratio[rows], run.ratio_error[rows], name, series_role)
            )
    return series


def _model_curve(run: SweepRun, z_over_R: Array) -> list[Curve]:
    """Return the curve of the run's model with its uncertainty bands; empty without a model."""
    if run.model is None:
        return []
    model, draws = run.model.model, run.model.draws
    label = f"{'fit' if run.model.fitted_to else 'model'}: {model.name}"
    return [model_curve(model, _max_speeds(run), z_over_R, draws, run.basis, label)]


def _distances(run: SweepRun, series: Sequence[RatioPoints]) -> Array:
    return curve_distances(series, None if run.model is None else run.model.model)


@figure(
    title="Ground effect: {0.name}",
    caption=lambda run: (
        f"Thrust near the plate over thrust with the plate parked, at {BASES[run.basis]}. Bars: "
        f"{ERRORS}. Dashed: closed-form image formulae (PFI) at the rig's radius, not fitted."
        f"{model_words(run)}"
    ),
    when=lambda run: bool(_ratios(run, "")),
)
def ratio(figure: Figure, run: SweepRun) -> None:
    """Draw T_IGE/T_OGE of a run, the closed-form formulae and a model with its bands."""
    series = _ratios(run, f"{'simulated bench' if run.simulated else 'measured'}, mean ± error")
    z = _distances(run, series)
    curves = [*_model_curve(run, z), *formula_curves(run.rig, _max_speeds(run), z)]
    draw_ratio(figure, series, curves, run.basis)


@figure(
    page="sweep.compared",
    title="Runs compared",
    caption=lambda runs: (
        f"Thrust near the plate over thrust with the plate parked, per run, at "
        f"{BASES[runs[0].basis]}. Bars: {ERRORS}. Dashed: closed-form image formula at the radius "
        f"of the first run's rig."
    ),
    when=lambda runs: any(_ratios(run, "") for run in runs),
)
def ratios(figure: Figure, runs: Sequence[SweepRun]) -> None:
    """Draw T_IGE/T_OGE of several runs, one marker per run."""
    series = [
        item
        for index, run in enumerate(runs)
        for item in _ratios(run, run.name, RUN_ROLES[index % len(RUN_ROLES)])
    ]
    first, z = runs[0], _distances(runs[0], series)
    formula = formula_curves(first.rig, _max_speeds(first), z)[-1]
    draw_ratio(figure, series, [*_model_curve(first, z), formula], first.basis)


@figure(
    title="Thrust against distance: {0.name}",
    caption=lambda run: (
        f"Thrust against plate distance per throttle level. Bars as above; dotted: mean of the "
        f"level with the plate parked.{model_words(run)}"
    ),
    when=lambda run: bool(run.measured().any()),
    height_in=4.3,
)
def distance(figure: Figure, run: SweepRun) -> None:
    """Draw thrust against plate distance, one colour per throttle level."""
    thrust = run.settings.column("thrust_N")
    _draw_levels(figure, run, thrust, run.thrust_error_N, "thrust [N]", Model.thrust_N)


@figure(
    title="Thrust per electrical power: {0.name}",
    caption=lambda run: (
        "Thrust over electrical power against plate distance per throttle level; bars: standard "
        "errors. Dotted: mean of the level with the plate parked. Model lines use the torque of "
        "the rig's blades and the power of its motor or its known efficiency."
        f"{model_words(run)}"
    ),
    when=lambda run: run.measured().any() and run.quantity("efficiency_N_W") is not None,
    height_in=4.3,
)
def efficiency(figure: Figure, run: SweepRun) -> None:
    """Draw thrust per electrical power against plate distance, one colour per level."""
    values = run.quantity("efficiency_N_W")
    assert values is not None  # `when`
    label = "thrust per electrical power [N/W]"
    _draw_levels(figure, run, values.value, values.total_error, label, thrust_per_power_N_W)


@figure(
    title="Derived quantities: {0.name}",
    caption=lambda run: (
        "Available quantities against "
        + (
            "plate distance, one colour per throttle level; dotted: mean of the level with the "
            "plate parked; "
            if run.measured().any()
            else "pulse width; "
        )
        + "bars: standard errors. Origin of each quantity: table below."
    ),
    when=lambda run: bool(len(run.settings) > 1 and _panel_quantities(run)),
    height_in=lambda run: panels_height(_panel_quantities(run)),
)
def quantities(figure: Figure, run: SweepRun) -> None:
    """Draw one panel per quantity against plate distance, or pulse width without a plate."""
    z, near, levels = run.z_over_R(run.settings), run.measured() & plain(run), run.level_us()
    derived, has_plate = _panel_quantities(run), run.measured().any()
    label = DISTANCE_LABEL if has_plate else "pulse [µs]"
    panels = quantity_panels(figure, [item.quantity for item in derived], label)
    for axes, quantity in zip(panels, derived, strict=True):
        if not has_plate:
            points(axes, levels, quantity.value, quantity.total_error, BLUE, ms=3.6)
            continue
        for index, level in enumerate(np.unique(levels[near])):
            color, rows = CYCLE[index % len(CYCLE)], near & (levels == level)
            points(
                axes, z[rows], quantity.value[rows], quantity.total_error[rows], color,
                MARKERS[index % len(MARKERS)], ms=3.6, label=f"{level:g} µs",
            )  # fmt: skip
            parked = ~run.measured() & (levels == level)
            if np.isfinite(quantity.value[parked]).any():
                mean = float(np.nanmean(quantity.value[parked]))
                axes.axhline(mean, color=color, lw=1.0, ls=DOTTED)
        axes.set_xlim(left=0.0)
    if has_plate:
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower right", ncols=4)


def _panel_quantities(run: SweepRun) -> list[QuantityValues]:
    """Return the quantities without efficiency, which has a separate figure."""
    return [item for item in run.quantities if item.name != "efficiency_N_W"]


Predict = Callable[[Model, Conditions, Any], Any]  # arguments: model, conditions, values


def _draw_levels(
    figure: Figure, run: SweepRun, values: Array, error: Array, label: str, predict: Predict
) -> None:
    """Draw a quantity of each setting (s,) against plate distance, one colour per level."""
    axes = figure.subplots()
    levels, near = run.level_us(), run.measured() & plain(run)
    z = run.z_over_R(run.settings)
    near = near if near.any() else run.measured()
    handles: list[Artist] = []
    if (~run.measured() & np.isin(levels, levels[near])).any():
        handles.append(legend_line(color=GREY, lw=1.0, ls=DOTTED, label="plate parked (OGE)"))
    if run.model is not None:
        handles.append(legend_line(color=GREY, lw=1.2, label=run.model.model.name))
    for index, level in enumerate(np.unique(levels[near])):
        color = CYCLE[index % len(CYCLE)]
        rows = np.flatnonzero(near & (levels == level))
        rows = rows[np.argsort(z[rows], kind="stable")]
        if run.model is not None:
            has_band = _model_line(axes, run, run.model, rows, color, predict)
            if has_band and not index:
                band = "95 % band of the model"
                handles.append(legend_patch(facecolor=GREY, alpha=0.3, lw=0.0, label=band))
        points(
            axes, z[rows], values[rows], error[rows], color,
            MARKERS[index % len(MARKERS)], capsize=3.5, label=f"{level:g} µs", zorder=3,
        )  # fmt: skip
        parked = ~run.measured() & (levels == level)
        if parked.any():
            axes.axhline(float(np.mean(values[parked])), color=color, lw=1.0, ls=DOTTED)
    axes.set(xlabel=DISTANCE_LABEL, ylabel=label)
    axes.set_xlim(left=0.0)
    axes.legend(handles=[*axes.get_legend_handles_labels()[0], *handles], loc="upper right")


def _model_line(
    axes: Axes,
    run: SweepRun,
    model: NominalModel,
    rows: NDArray[np.intp],
    color: str,
    predict: Predict,
) -> bool:
    """Draw the model's line at the mean speeds of one level; return True if it has a band."""
    rpm = np.array([np.nanmean(rotor_rpm[rows]) for rotor_rpm in run.of_rotors("rpm{}")])
    if not np.isfinite(rpm).all():
        return False
    z = run.z_over_R(run.settings)[rows]
    grid = np.linspace(max(0.5, 0.9 * float(z.min())), 1.05 * float(z.max()), 160)
    conditions = conditions_over(run.rig, rpm[:, None] * np.pi / 30.0, grid)
    middle = predict(model.model, conditions, ratio_values(model.model))
    if model.draws:
        drawn = predict(model.model, conditions, ratio_values(model.model, model.draws))
        samples = np.asarray(drawn, float)
        band = uncertainty_band(np.broadcast_to(samples, (len(samples), len(grid))), 95)
        axes.fill_between(
            grid, band.lower, band.upper, color=color, alpha=0.2, lw=0.0, gid="band-95"
        )
    axes.plot(grid, np.broadcast_to(middle, grid.shape), color=color, lw=1.2)
    return bool(model.draws)


@figure(
    page="sweep.calibration",
    title="Calibration {0[id]}",
    caption="Calibration. Above: mean raw reading per known mass, and fitted line. Below: "
    "residuals; a gap between loading and unloading is hysteresis, an arch is nonlinearity.",
    simulated=lambda calibration_data: bool(calibration_data["simulated"]),
    height_in=5.2,
)
def calibration(figure: Figure, calibration_data: Mapping[str, Any]) -> None:
    """Draw counts against force with the line; below: residuals of loading and unloading."""
    newtons_per_kg = calibration_data["gravity_m_s2"] / calibration_data["lever_ratio"]
    force_N = np.array(calibration_data["masses_kg"], float) * newtons_per_kg
    counts, residual_N = (
        np.array(calibration_data[name], float) for name in ("counts", "residuals_N")
    )
    loading = np.arange(len(force_N)) <= int(force_N.argmax())
    labels = ("reading [counts]", "reading −\nforce [mN]")
    line, residuals = stack_panels(figure, (1.6, 1.0), labels, "known force [N]")
    order = np.argsort(force_N + residual_N, kind="stable")
    line.plot((force_N + residual_N)[order], counts[order], color=GREY, lw=1.2, label="line")
    for rows, marker, color, label in (
        (loading, "^", BLUE, "masses added"),
        (~loading, "v", ORANGE, "masses removed"),
    ):
        if rows.any():
            residual_mN = from_si(residual_N[rows], "mN")
            line.plot(force_N[rows], counts[rows], marker, color=color, label=label)
            residuals.plot(force_N[rows], residual_mN, marker + "-", color=color, lw=0.8, ms=5.0)
    residuals.axhline(0.0, color=GREY, linewidth=0.9)
    line.legend(loc="upper left")


figure(
    page="sweep",
    title="Uncertainty budget: {0.name}",
    caption="Contributions of sources to thrust at the highest level: standard uncertainty in "
    "percent of the value, included in the standard error of the mean or not; dashed: combined.",
    when=lambda run: run.budget is not None,
    height_in=lambda run: chart_height(run.budget),
)(budget)
