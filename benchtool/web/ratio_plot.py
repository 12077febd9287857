"""Figure of the ratio plot, and its data, computed in a worker process."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import BenchtoolError
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.report.palette import BLUE, GREY, SERIES_STYLES, VERMILION

CURVE_POINTS = 80
CURVE_Z_OVER_R = (0.5, 5.0)

Trace = dict[str, Any]  # Plotly trace


class MeasuredRatios(NamedTuple):
    """Measured thrust ratios: rows of z/R, T_IGE/T_OGE, standard error.

    With `is_thrust`, no ratio is available yet; rows are pulse width in us, thrust in N, standard
    error.
    """

    rows: tuple[tuple[float, ...], ...] = ()
    problem: str = ""  # reason for missing ratios
    simulated: bool = False
    is_thrust: bool = False


_STAMP = {
    "text": "<b>SIMULATED</b>", "xref": "paper", "yref": "paper", "x": 0.01, "y": 0.01,
    "showarrow": False, "font": {"color": VERMILION, "size": 13},
    "bordercolor": VERMILION, "borderwidth": 1, "borderpad": 3,
}  # fmt: skip
_EMPTY_TEXT = {
    "xref": "paper", "yref": "paper", "x": 0.5, "y": 0.5, "showarrow": False, "font": {"size": 15},
}  # fmt: skip


def ratio_figure(
    points: MeasuredRatios, curves: Sequence[Trace], placeholder: str, ink: str
) -> dict[str, Any]:
    """Return the Plotly figure of the thrust ratio."""
    x, y, error = map(list, zip(*points.rows, strict=True)) if points.rows else ([], [], [])
    measured = {
        "type": "scatter", "mode": "markers", "name": "measured", "x": x, "y": y,
        "error_y": {"type": "data", "array": error, "color": ink, "thickness": 1.2},
        "marker": {"color": ink, "size": 7, "symbol": "circle-open"},
    }  # fmt: skip
    is_empty = not points.rows and not curves
    x_title, y_title = "z / R", "T<sub>IGE</sub> / T<sub>OGE</sub>"
    if points.is_thrust:
        curves, x_title, y_title = (), "pulse width, us", "thrust, N"
    axis = {"gridcolor": GREY + "44", "zeroline": False, "linecolor": GREY, "visible": not is_empty}
    # Thrust rises with pulse width, ratios fall with distance: this corner has no points.
    stamp = {**_STAMP, "y": 0.99} if points.is_thrust else _STAMP
    notes = [{**_EMPTY_TEXT, "text": placeholder}] if is_empty else []
    notes = [stamp] if points.simulated else notes
    return {
        "data": [*curves, measured],
        "layout": {
            "height": 420,
            "margin": {"l": 60, "r": 16, "t": 12, "b": 46},
            "paper_bgcolor": "rgba(0,0,0,0)",
            "plot_bgcolor": "rgba(0,0,0,0)",
            "font": {"color": ink, "family": "Roboto, sans-serif", "size": 13},
            "xaxis": {**axis, "title": {"text": x_title}},
            "yaxis": {**axis, "title": {"text": y_title}},
            "legend": {"x": 0.98, "xanchor": "right", "y": 0.98},
            "uirevision": x_title,
            "annotations": notes,
        },
        "config": {"displayModeBar": False, "responsive": True},
    }


def measured_ratios(run: Path, basis: str) -> MeasuredRatios:
    """Return the ratios of a (running) sweep; thrust over pulse width if it has no ratio."""
    from benchtool.data.columns import word_to_code
    from benchtool.data.run.ratios import ratios
    from benchtool.data.run.read import read_points, run_rig
    from benchtool.data.run.run import Run

    try:
        points = read_points(run)
        facts = Run.open(run).metadata
        rig = run_rig(run, facts)
    except BenchtoolError as error:
        return MeasuredRatios(problem=str(error))
    problem = ""
    try:
        measured = ratios(points, basis, rig)
    except BenchtoolError as error:
        measured, problem = None, str(error)
    kinds, simulated = points.column("kind"), bool(facts.get("simulated"))
    if measured is not None:
        is_valid = (kinds == word_to_code("kind", "measure")) & np.isfinite(measured.value)
        z_over_R = points.column("plate_z_m") / rig.propulsion.radius_m
        table = (z_over_R, measured.value, np.nan_to_num(measured.total_error))
        if is_valid.any():
            return MeasuredRatios(_rows(table, is_valid), simulated=simulated)
    pwm_us = np.max([points.column(f"pwm{i + 1}_us") for i in range(rig.n_rotors)], axis=0)
    table = (pwm_us, points.column("thrust_N"), np.nan_to_num(points.column("thrust_se_N")))
    is_valid = np.isfinite(pwm_us) & np.isfinite(points.column("thrust_N"))
    return MeasuredRatios(_rows(table, is_valid), problem, simulated=simulated, is_thrust=True)


def _rows(table: tuple[Array, ...], mask: NDArray[np.bool_]) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, np.column_stack(table)[mask].tolist()))


def model_curves(model: str, rig: Rig, ink: str, basis: str) -> tuple[Trace, ...]:
    """Return curves of the closed formulas and of a model with its band, all rotors turning.

    Without a model, the formulas only.

    Raises:
        BenchtoolError: the model is not readable, or is for another rig.
    """
    from benchtool.fit.nominal import nominal_model
    from benchtool.physics import VALIDITY_Z_OVER_R
    from benchtool.report.ratio import factor_at_distance, formula_curves, uncertainty_bands

    low, high = CURVE_Z_OVER_R
    nominal = nominal_model(model, rig) if model else None
    nearest = VALIDITY_Z_OVER_R if nominal is None else nominal.model.nearest_z_over_R
    x = np.geomspace(max(low, nearest), high, CURVE_POINTS)
    speeds = np.full((rig.n_rotors, 1), 500.0)
    traces = []
    for curve in formula_curves(rig, speeds, x[x >= VALIDITY_Z_OVER_R]):
        color = SERIES_STYLES["quad"].color if curve.role == "quad" else ink
        line = {"color": color, "dash": "dash", "width": 1.5}
        traces.append(_line(curve.label, curve.z_over_R, curve.ratio, line))
    if nominal is None:
        return tuple(traces)
    ratio = np.asarray(factor_at_distance(nominal.model, speeds, x, basis=basis), float)
    ratio = np.broadcast_to(ratio, x.shape)
    bands = uncertainty_bands(nominal.model, speeds, x, nominal.draws, basis)
    name = nominal.model.name
    if bands:
        edge = {"width": 0, "color": VERMILION}
        low_edge = _line("lower", x, bands[-1].lower, edge)
        high_edge = _line(f"{name}, 95 %", x, bands[-1].upper, edge)
        traces.append({**low_edge, "showlegend": False, "hoverinfo": "skip"})
        traces.append({**high_edge, "fill": "tonexty", "fillcolor": VERMILION + "33"})
    color = VERMILION if bands else BLUE
    return (*traces, _line(name, x, ratio, {"color": color, "width": 2}))


def _line(name: str, x: Array, y: Array, line: dict[str, Any]) -> Trace:
    x, y = np.round(np.asarray(x, float), 6), np.round(np.asarray(y, float), 6)
    return {
        "type": "scatter", "mode": "lines", "name": name, "x": x.tolist(), "y": y.tolist(),
        "line": line,
    }  # fmt: skip
