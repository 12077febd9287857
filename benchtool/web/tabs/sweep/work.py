"""What the plot shows, worked out in a process of its own: points from the disk, the model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchtool.core.errors import BenchtoolError
from benchtool.core.rig import Rig

CURVE_POINTS = 80


@dataclass(frozen=True, slots=True)
class MeasuredRatios:
    """Hold measured ratios.

    Attributes:
        rows: z/R, T_IGE/T_OGE, standard error.
        why: why there are none, empty when there are.
        simulated: no physical motor turned.
    """

    rows: tuple[tuple[float, float, float], ...] = ()
    why: str = ""
    simulated: bool = False


@dataclass(frozen=True, slots=True)
class RatioCurve:
    """Hold a curve: rows of z/R and value; with a band also lower and upper of 95 %."""

    label: str
    rows: tuple[tuple[float, ...], ...]


def measured_ratios(run: Path, basis: str) -> MeasuredRatios:
    """Return the ratios of a run as far as it is."""
    from benchtool.data.columns import code_of
    from benchtool.data.run.ratios import ratios
    from benchtool.data.run.read import read_points

    try:
        points = read_points(run)
        ratio, ratio_se = ratios(points, basis)
    except BenchtoolError as error:
        return MeasuredRatios(why=str(error))
    from benchtool.data.run.run import Run
    from benchtool.data.run.run_rig import run_rig

    facts = Run.open(run).metadata
    rig = run_rig(run, facts)
    near = points.column("kind") == code_of("kind", "measure")
    near &= np.isfinite(ratio)
    z_over_R = points.column("plate_z_m") / rig.propulsion.radius_m
    rows = zip(z_over_R[near], ratio[near], np.nan_to_num(ratio_se[near]), strict=True)
    found = tuple((float(a), float(b), float(c)) for a, b, c in rows)
    return MeasuredRatios(found, simulated=bool(facts.get("simulated")))


def model_curves(model: str, rig: Rig, z_over_R: tuple[float, float]) -> tuple[RatioCurve, ...]:
    """Return a model's curve with its band, and the closed formulae, all rotors turning.

    Raises:
        BenchtoolError: the model cannot be read, or is of another rig.
    """
    from benchtool.fit.nominal import nominal_model
    from benchtool.report.ratio import bands_over, factor_over, formula_curves

    low, high = z_over_R
    x = np.geomspace(max(low, 0.5), max(high, low + 0.5), CURVE_POINTS)
    speeds = np.full((rig.n_rotors, 1), 500.0)
    found = [
        RatioCurve(curve.label, _rows(curve.z_over_R, curve.ratio))
        for curve in formula_curves(rig, speeds, x)
    ]
    if model:
        belief = nominal_model(model, rig)
        middle = np.broadcast_to(np.asarray(factor_over(belief.model, speeds, x), float), x.shape)
        bands = bands_over(belief.model, speeds, x, belief.draws)
        wide = bands[-1] if bands else None
        rows = _rows(x, middle, *((wide.lower, wide.upper) if wide else ()))
        found.append(RatioCurve(belief.model.name, rows))
    return tuple(found)


def _rows(*columns: object) -> tuple[tuple[float, ...], ...]:
    table = np.column_stack([np.asarray(column, float) for column in columns])
    return tuple(tuple(row) for row in table.round(6).tolist())
