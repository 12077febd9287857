"""The scale errors of a fit's thrusts: one for each calibration that they went through."""

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
    age_text,
    degrees_of_freedom,
    read_calibration,
    traceability,
)
from benchtool.data.run.read import is_run
from benchtool.data.run.run_metadata import read_metadata
from benchtool.fit.problem import Problem

TARED_ZERO_N = 1e-6  # left of a calibration's zero after a tare: nothing; above 0 for the prior


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScaleError:
    """State the error of the scale that some points share.

    Attributes:
        known: the calibration, as its file or a run's metadata holds it.
        rows: (n,) which points went through it.
    """

    known: Mapping[str, Any]
    rows: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LoadCells:
    """Hold what the load cells of a fit's points add to their errors.

    Attributes:
        warnings: sentences on calibrations that are too old, or that some points lack.
    """

    errors: tuple[ScaleError, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def traceability(self) -> tuple[str, ...]:
        """Who calibrated what, with which certificate."""
        return tuple(traceability(error.known) for error in self.errors)


def load_cells(paths: Sequence[str], parts: Sequence[Recording], table: str | None) -> LoadCells:
    """Return the calibrations of a fit's data.

    Args:
        paths, parts: of the data, and the points of each.
        table: calibration file of data that are no run; None where none is known.
    """
    owners = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    by_id: dict[str, tuple[Mapping[str, Any], list[int]]] = {}
    warnings, without = [], []
    for place, path in enumerate(paths):
        folder = next((one for one in (Path(path), Path(path).parent) if is_run(one)), None)
        facts = {} if folder is None else read_metadata(folder)
        known = facts.get("calibration")
        if folder is None and table is not None:
            known = asdict(read_calibration(Path(table)))
        if not known:
            without.append(path)
            continue
        if old := age_text(facts):
            warnings.append(f"{path}: {old}")
        by_id.setdefault(str(known["id"]), (known, []))[1].append(place)
    if by_id and without:
        warnings.append(
            f"{', '.join(without)} went through no calibration: its newtons count as exact; "
            f"recalibrate it, or name one with --calibration"
        )
    known = pool_calibrations([one for one, _ in by_id.values()])
    errors = tuple(
        ScaleError(known=one, rows=np.isin(owners, places))
        for one, (_, places) in zip(known, by_id.values(), strict=True)
    )
    return LoadCells(errors=errors, warnings=tuple(warnings))


MAX_CALIBRATION_DIFFERENCE = (
    0.001  # p-value below which a calibration scatters more than the others; assumed
)
POOLED = "scatter of the calibrations"  # name of the estimate that alike calibrations share


def pool_calibrations(calibrations: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return calibrations whose scatter of readings is that of all of them together.

    A few masses know their own scatter badly, and weights made of it favour whatever line came out
    straight by luck: of three cells of five masses each 65 and 88 % of intervals held the truth
    instead of 68 and 95. A calibration that scatters clearly more than the others (an F test, in
    newtons) keeps its own; all do where one does not state it.
    """
    lines = [_line(one) for one in calibrations]
    if len(lines) < 2 or any(line is None for line in lines):
        return list(calibrations)
    dof, scatter = np.array([line for line in lines if line is not None]).T
    others = (dof @ scatter**2 - dof * scatter**2) / (dof.sum() - dof)
    if (scatter <= 0.0).any() or (others <= 0.0).any():
        return list(calibrations)
    alike = fisher.sf(scatter**2 / others, dof, dof.sum() - dof) > MAX_CALIBRATION_DIFFERENCE
    if alike.sum() < 2:
        return list(calibrations)
    together = float(np.sqrt(dof[alike] @ scatter[alike] ** 2 / dof[alike].sum()))
    found: list[Mapping[str, Any]] = []
    for known, own, pools in zip(calibrations, scatter, alike, strict=True):
        if not pools:
            found.append(known)
            continue
        factor = together / own
        parts = [
            {**part, "sd": factor * part["sd"], "relative_sd": factor * part["relative_sd"],
             "dof": float(dof[alike].sum()), "scatter": POOLED}
            if part["name"] == "repeat" else part
            for part in known["components"]
        ]  # fmt: skip
        total = float(np.sqrt(sum(part["relative_sd"] ** 2 for part in parts)))
        found.append({**known, "components": parts, "relative_sd": total})
    return found


def _line(known: Mapping[str, Any]) -> tuple[float, float] | None:
    """Return degrees of freedom and scatter of a calibration's readings: N; None if not stated."""
    repeats = [part for part in known.get("components") or () if part["name"] == "repeat"]
    if not repeats or not repeats[0]["dof"] or not known.get("residual_sd_N"):
        return None
    return float(repeats[0]["dof"]), float(known["residual_sd_N"])


def with_scale_errors(problem: Problem, errors: Sequence[ScaleError]) -> Problem:
    """Return the problem with a free scale for each calibration, under the prior that it states.

    The scale of several is named after its calibration.
    """
    for error in errors:
        known = error.known
        relative_sd = float(known["relative_sd"])
        if relative_sd == 0.0 or not error.rows.any():
            continue
        problem = problem.with_calibration(
            np.diag([relative_sd**2, TARED_ZERO_N**2]),
            f"calibration {known['id']}",
            rows=error.rows,
            name="" if len(errors) == 1 else str(known["id"]),
            parts=_parts(known),
        )
    return problem


def _parts(known: Mapping[str, Any]) -> tuple[ErrorSource, ...]:
    """Return the sources of a calibration's slope with their shares of its `relative_sd`."""
    total = float(known["relative_sd"])
    of_line: list[dict[str, Any]] = [
        {
            "name": "repeat",
            "kind": "A",
            "unit": "1",
            "sd": total,
            "relative_sd": total,
            "distribution": "student_t",
            "dof": degrees_of_freedom(known),
        }
    ]
    return tuple(
        ErrorSource(
            name=f"calibration {known['id']}: {part['name']}",
            kind=part["kind"],
            unit=part["unit"],
            sd=float(part["sd"]),
            columns=np.array([[part["relative_sd"] / total]]),
            distribution=part.get("distribution", "normal"),
            dof=np.inf if part["dof"] is None else float(part["dof"]),
            origin=traceability(known),
            scatter=part.get("scatter", ""),
        )
        for part in known.get("components") or of_line
        if part["relative_sd"] > 0.0
    )
