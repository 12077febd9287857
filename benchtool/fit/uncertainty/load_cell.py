"""The scale errors of a fit's thrusts: one for each calibration that they went through."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.error_source import ErrorSource
from benchtool.core.recording import Recording
from benchtool.data.calibration import (
    age_text,
    calibration_dof,
    read_calibration,
    traceability,
)
from benchtool.data.run.facts import read_metadata
from benchtool.data.run.read import is_run
from benchtool.fit.problem import Problem

TARED_ZERO_N = 1e-6
"""What is left of a calibration's zero after a tare: nothing; above 0 for the prior's sake."""


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
    errors = tuple(
        ScaleError(known=known, rows=np.isin(owners, places)) for known, places in by_id.values()
    )
    return LoadCells(errors=errors, warnings=tuple(warnings))


def with_scale_errors(problem: Problem, errors: Sequence[ScaleError]) -> Problem:
    """Return the problem with a free scale for each calibration, under the prior that it states.

    The scale of several is named after its calibration.

    Args:
        errors: with the rows of the problem's points.
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
            "dof": calibration_dof(known),
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
        )
        for part in known.get("components") or of_line
        if part["relative_sd"] > 0.0
    )
