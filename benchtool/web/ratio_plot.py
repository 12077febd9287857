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

Trace = dict[str, Any]  # series of ECharts


class MeasuredRatios(NamedTuple):
    """Measured thrust ratios: rows of z/R, T_IGE/T_OGE, standard error.

    With `is_thrust`, no ratio is available yet; rows are pulse width in us, thrust in N, standard
    error.
    """

    rows: tuple[tuple[float, ...], ...] = ()
    problem: str = ""  # reason for missing ratios
    simulated: bool = False
    is_thrust: bool = False


_RATIO_TITLE = "T{sub|IGE} / T{sub|OGE}"
_SUBSCRIPT = {"sub": {"fontSize": 9, "verticalAlign": "bottom"}}


def ratio_figure(
    points: MeasuredRatios, curves: Sequence[Trace], placeholder: str, ink: str
) -> dict[str, Any]:
    """Return the ECharts options of the plot of the thrust ratio."""
    is_empty = not points.rows and not curves
    x_title, y_title = "z / R", _RATIO_TITLE
    if points.is_thrust:
        curves, x_title, y_title = (), "pulse width, us", "thrust, N"
    errors = [
        item for x, y, error in points.rows for item in ([x, y - error], [x, y + error], [x, None])
    ]
    series = [
        *curves,
        {**_line("standard error", errors, ink, 1.2), "silent": True},
        {
            "type": "scatter", "name": "measured", "data": [row[:2] for row in points.rows],
            "symbol": "emptyCircle", "symbolSize": 7, "color": ink,
        },
    ]  # fmt: skip
    axis = {
        "type": "value", "scale": True, "show": not is_empty, "nameLocation": "middle",
        "nameTextStyle": {"color": ink, "fontSize": 13, "rich": _SUBSCRIPT},
        "axisLabel": {"color": ink}, "axisLine": {"show": True, "lineStyle": {"color": GREY}},
        "splitLine": {"lineStyle": {"color": GREY + "44"}},
    }  # fmt: skip
    zoom = {"type": "inside", "filterMode": "none", "zoomOnMouseWheel": "shift"}
    stamp = {
        "text": "SIMULATED", "show": points.simulated, "left": 70, "top": 14 if points.is_thrust
        else 340, "borderColor": VERMILION, "borderWidth": 1, "padding": 4,
        "textStyle": {"color": VERMILION, "fontSize": 13},
    }  # fmt: skip
    empty = {
        "text": placeholder, "show": is_empty, "left": "center", "top": "middle",
        "textStyle": {"color": ink, "fontSize": 15, "fontWeight": "normal"},
    }  # fmt: skip
    names = [trace["name"] for trace in series if not trace.get("silent")]
    return {
        "animation": False,
        "textStyle": {"color": ink, "fontFamily": "Roboto, sans-serif"},
        "grid": {"left": 64, "right": 16, "top": 36, "bottom": 46},
        "xAxis": {**axis, "name": x_title, "nameGap": 26},
        "yAxis": {**axis, "name": y_title, "nameGap": 42},
        "dataZoom": [{**zoom, "xAxisIndex": 0}, {**zoom, "yAxisIndex": 0}],
        "toolbox": {
            "show": not is_empty, "right": 12, "top": 0, "iconStyle": {"borderColor": ink},
            "feature": {"dataZoom": {"brushStyle": {"color": GREY + "44"}}, "restore": {}},
        },
        "tooltip": {"trigger": "axis", "confine": True},
        "legend": {
            "show": not is_empty, "data": names, "left": 56, "right": 90, "top": 2,
            "itemWidth": 18, "type": "scroll", "textStyle": {"color": ink},
        },
        "title": [stamp, empty],
        "series": series,
    }  # fmt: skip


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

    Without a model, the formulas only. Raises BenchtoolError for a model of another rig.
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
        rows = _points(curve.z_over_R, curve.ratio)
        traces.append(_line(curve.label, rows, color, 1.5, "dashed"))
    if nominal is None:
        return tuple(traces)
    ratio = np.asarray(factor_at_distance(nominal.model, speeds, x, basis=basis), float)
    bands = uncertainty_bands(nominal.model, speeds, x, nominal.draws, basis)
    if bands:
        lower, upper = (_points(x, limit) for limit in (bands[-1].lower, bands[-1].upper))
        # A closed outline: its parts between the lower limit and the axis cancel.
        outline = _line("95 % band", [*lower, *reversed(upper)], VERMILION, 0.0)
        area = {"color": VERMILION, "opacity": 0.2}
        traces.append({**outline, "areaStyle": area, "silent": True, "tooltip": {"show": False}})
    name = f"{nominal.model.name}, 95 %" if bands else nominal.model.name
    rows = _points(x, np.broadcast_to(ratio, x.shape))
    return (*traces, _line(name, rows, VERMILION if bands else BLUE, 2.0))


def _points(x: Array, y: Array) -> list[list[float]]:
    table: list[list[float]] = np.round(np.column_stack((x, y)), 6).tolist()
    return table


def _line(
    name: str,
    points: Sequence[Sequence[float | None]],
    color: str,
    width: float,
    dash: str = "solid",
) -> Trace:
    return {
        "type": "line", "name": name, "data": list(points), "symbol": "none", "color": color,
        "lineStyle": {"color": color, "width": width, "type": dash},
    }  # fmt: skip
