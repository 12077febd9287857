"""What the plot of ratios shows, made in a process of its own: points from the disk, the model."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.errors import BenchtoolError
from benchtool.core.rig import Rig
from benchtool.report.palette import BLUE, SERIES_STYLES, VERMILION

CURVE_POINTS = 80

Trace = dict[str, Any]  # One line or set of markers, as Plotly takes it


class MeasuredRatios(NamedTuple):
    """Hold measured ratios.

    Attributes:
        rows: z/R, T_IGE/T_OGE, standard error.
        raw: before there is a ratio: rows are pulse in us, thrust in N, standard error.
        why: why there are none, empty when there are.
    """

    rows: tuple[tuple[float, ...], ...] = ()
    why: str = ""
    simulated: bool = False
    raw: bool = False


def measured_ratios(run: Path, basis: str) -> MeasuredRatios:
    """Return the ratios of a run as far as it is; thrust over pulse where it has none."""
    from benchtool.data.columns import word_to_code
    from benchtool.data.run.ratios import ratios
    from benchtool.data.run.read import read_points
    from benchtool.data.run.run import Run
    from benchtool.data.run.run_rig import run_rig

    try:
        points = read_points(run)
        facts = Run.open(run).metadata
        rig = run_rig(run, facts)
    except BenchtoolError as error:
        return MeasuredRatios(why=str(error))
    why = ""
    try:
        measured = ratios(points, basis, rig)
    except BenchtoolError as error:
        measured, why = None, str(error)
    kinds, simulated = points.column("kind"), bool(facts.get("simulated"))
    if measured is not None:
        near = (kinds == word_to_code("kind", "measure")) & np.isfinite(measured.value)
        z_over_R = points.column("plate_z_m") / rig.propulsion.radius_m
        table = (z_over_R, measured.value, np.nan_to_num(measured.total_error))
        if near.any():
            return MeasuredRatios(_rows(table, near), simulated=simulated)
    pulses_us = np.max([points.column(f"pwm{i + 1}_us") for i in range(rig.n_rotors)], axis=0)
    table = (pulses_us, points.column("thrust_N"), np.nan_to_num(points.column("thrust_se_N")))
    valid = np.isfinite(pulses_us) & np.isfinite(points.column("thrust_N"))
    return MeasuredRatios(_rows(table, valid), why, simulated=simulated, raw=True)


def _rows(table: tuple[Array, ...], chosen: NDArray[np.bool_]) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, np.column_stack(table)[chosen].tolist()))


def model_curves(
    model: str, rig: Rig, z_over_R: tuple[float, float], ink: str, basis: str
) -> tuple[Trace, ...]:
    """Return a model's curve with its band, and the closed formulae, all rotors turning.

    Args:
        model: name or file; empty for the formulae alone.
        basis: what the model's ratios hold equal.

    Raises:
        BenchtoolError: the model cannot be read, or is of another rig.
    """
    from benchtool.fit.nominal import nominal_model
    from benchtool.physics import VALIDITY_Z_OVER_R
    from benchtool.report.ratio import factor_at_distance, formula_curves, uncertainty_bands

    low, high = z_over_R
    nominal = nominal_model(model, rig) if model else None
    nearest = VALIDITY_Z_OVER_R if nominal is None else nominal.model.nearest_z_over_R
    x = np.geomspace(max(low, nearest), max(high, low + 0.5), CURVE_POINTS)
    speeds = np.full((rig.n_rotors, 1), 500.0)
    found = []
    for curve in formula_curves(rig, speeds, x[x >= VALIDITY_Z_OVER_R]):
        color = SERIES_STYLES["quad"].color if curve.role == "quad" else ink
        line = {"color": color, "dash": "dash", "width": 1.5}
        found.append(_line(curve.label, curve.z_over_R, curve.ratio, line))
    if nominal is None:
        return tuple(found)
    middle = np.asarray(factor_at_distance(nominal.model, speeds, x, basis=basis), float)
    middle = np.broadcast_to(middle, x.shape)
    bands = uncertainty_bands(nominal.model, speeds, x, nominal.draws, basis)
    name = nominal.model.name
    if bands:
        edge = {"width": 0, "color": VERMILION}
        low_edge = _line("lower", x, bands[-1].lower, edge)
        high_edge = _line(f"{name}, 95 %", x, bands[-1].upper, edge)
        found.append({**low_edge, "showlegend": False, "hoverinfo": "skip"})
        found.append({**high_edge, "fill": "tonexty", "fillcolor": VERMILION + "33"})
    color = VERMILION if bands else BLUE
    return (*found, _line(name, x, middle, {"color": color, "width": 2}))


def _line(name: str, x: Array, y: Array, line: dict[str, Any]) -> Trace:
    x, y = np.round(np.asarray(x, float), 6), np.round(np.asarray(y, float), 6)
    return {
        "type": "scatter", "mode": "lines", "name": name, "x": x.tolist(), "y": y.tolist(),
        "line": line,
    }  # fmt: skip
