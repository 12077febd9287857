"""Scale errors of thrusts, one for each load cell calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from benchtool.core.error_source import ErrorSource
from benchtool.core.recording import Recording
from benchtool.data.calibration import (
    degrees_of_freedom,
    format_age_warning,
    format_traceability,
    read_calibration,
)
from benchtool.data.run.read import is_run
from benchtool.data.run.run_metadata import read_metadata
from benchtool.fit.problem import Problem

TARED_ZERO_N = 1e-6  # zero error of a calibration after a tare: none; above 0 for the prior


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScaleError:
    """Scale error shared by the points of one calibration."""

    calibration: Mapping[str, Any]  # the calibration as in its file or a run's metadata
    rows: NDArray[np.bool_]  # (n,) True for its points


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LoadCells:
    """Load cell errors of a fit's points."""

    errors: tuple[ScaleError, ...] = ()
    warnings: tuple[str, ...] = ()  # on old or missing calibrations

    @property
    def traceability(self) -> tuple[str, ...]:
        """Traceability statement of each calibration."""
        return tuple(format_traceability(error.calibration) for error in self.errors)


def load_cells(paths: Sequence[str], parts: Sequence[Recording], table: str | None) -> LoadCells:
    """Return the load cell calibrations of data paths with their points.

    `table` is the calibration file for tables; None if unknown.
    """
    owners = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    by_id: dict[str, tuple[Mapping[str, Any], list[int]]] = {}
    warnings, without = [], []
    for index, path in enumerate(paths):
        folder = next(filter(is_run, (Path(path), Path(path).parent)), None)
        metadata = {} if folder is None else read_metadata(folder)
        calibration = metadata.get("calibration")
        if folder is None and table is not None:
            calibration = asdict(read_calibration(Path(table)))
        if not calibration:
            without.append(path)
            continue
        if age_warning := format_age_warning(metadata):
            warnings.append(f"{path}: {age_warning}")
        by_id.setdefault(str(calibration["id"]), (calibration, []))[1].append(index)
    if by_id and without:
        warnings.append(
            f"{', '.join(without)} has no calibration, so that its scale counts as exact; "
            f"recalibrate it, or set --calibration"
        )
    pooled = pool_calibrations([calibration for calibration, _ in by_id.values()])
    errors = tuple(
        ScaleError(calibration=calibration, rows=np.isin(owners, indices))
        for calibration, (_, indices) in zip(pooled, by_id.values(), strict=True)
    )
    return LoadCells(errors=errors, warnings=tuple(warnings))


MAX_CALIBRATION_DIFFERENCE = 0.001  # p-value below which a scatter is not pooled; assumed
POOLED = "scatter of the calibrations"  # name of the pooled estimate


def pool_calibrations(calibrations: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return calibrations with pooled scatter of readings.

    Scatter from few masses is uncertain, and weights from it favour calibrations that are straight
    by chance: for three cells with five masses each, 65 and 88 % of the intervals contained the
    truth instead of 68 and 95. A calibration with significantly larger scatter (F test, in newtons)
    is not pooled; none is if one lacks its scatter.
    """
    lines = [_line(calibration) for calibration in calibrations]
    if len(lines) < 2 or any(line is None for line in lines):
        return list(calibrations)
    dof, scatter = np.array([line for line in lines if line is not None]).T
    others = (dof @ scatter**2 - dof * scatter**2) / (dof.sum() - dof)
    if (scatter <= 0.0).any() or (others <= 0.0).any():
        return list(calibrations)
    is_alike = fisher.sf(scatter**2 / others, dof, dof.sum() - dof) > MAX_CALIBRATION_DIFFERENCE
    if is_alike.sum() < 2:
        return list(calibrations)
    pooled_scatter = float(np.sqrt(dof[is_alike] @ scatter[is_alike] ** 2 / dof[is_alike].sum()))
    pooled: list[Mapping[str, Any]] = []
    for calibration, own_scatter, is_pooled in zip(calibrations, scatter, is_alike, strict=True):
        if not is_pooled:
            pooled.append(calibration)
            continue
        factor = pooled_scatter / own_scatter
        parts = [
            {**part, "sd": factor * part["sd"], "relative_sd": factor * part["relative_sd"],
             "dof": float(dof[is_alike].sum()), "scatter": POOLED}
            if part["name"] == "repeat" else part
            for part in calibration["components"]
        ]  # fmt: skip
        total = float(np.sqrt(sum(part["relative_sd"] ** 2 for part in parts)))
        pooled.append({**calibration, "components": parts, "relative_sd": total})
    return pooled


def _line(calibration: Mapping[str, Any]) -> tuple[float, float] | None:
    """Return degrees of freedom and scatter of a calibration's readings: N; None if not stated."""
    repeats = [part for part in calibration.get("components") or () if part["name"] == "repeat"]
    if not repeats or not repeats[0]["dof"] or not calibration.get("residual_sd_N"):
        return None
    return float(repeats[0]["dof"]), float(calibration["residual_sd_N"])


def with_scale_errors(problem: Problem, errors: Sequence[ScaleError]) -> Problem:
    """Return the problem with a free scale for each calibration, with its prior.

    With several calibrations the names of scales contain the calibration id.
    """
    for error in errors:
        calibration = error.calibration
        relative_sd = float(calibration["relative_sd"])
        if relative_sd == 0.0 or not error.rows.any():
            continue
        problem = problem.with_calibration(
            relative_sd,
            TARED_ZERO_N,
            f"calibration {calibration['id']}",
            rows=error.rows,
            name="" if len(errors) == 1 else str(calibration["id"]),
            parts=_parts(calibration),
        )
    return problem


def _parts(calibration: Mapping[str, Any]) -> tuple[ErrorSource, ...]:
    """Return the sources of a calibration's slope with their shares of its `relative_sd`."""
    total = float(calibration["relative_sd"])
    slope_only: list[dict[str, Any]] = [
        {
            "name": "repeat",
            "kind": "A",
            "unit": "1",
            "sd": total,
            "relative_sd": total,
            "distribution": "student_t",
            "dof": degrees_of_freedom(calibration),
        }
    ]
    return tuple(
        ErrorSource(
            name=f"calibration {calibration['id']}: {part['name']}",
            kind=part["kind"],
            unit=part["unit"],
            sd=float(part["sd"]),
            columns=np.array([[part["relative_sd"] / total]]),
            distribution=part.get("distribution", "normal"),
            dof=np.inf if part["dof"] is None else float(part["dof"]),
            origin=format_traceability(calibration),
            scatter=part.get("scatter", ""),
        )
        for part in calibration.get("components") or slope_only
        if part["relative_sd"] > 0.0
    )
