"""What a reader looks at: measurement and predictions of a check sweep, over plate distance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchtool.explain.engine.explanation import Overlay
from benchtool.explain.sweep.evidence import SweepEvidence
from benchtool.explain.sweep.gap import RPM
from benchtool.explain.sweep.log import SweepLog

Array = NDArray[np.float64]

SAME_LOAD = 0.02
"""Squared speeds within this share of each other are one level, for the picture; a choice."""

FARTHEST_Z_OVER_R = 12.0
"""A plate farther away than this is drawn here: nothing of it shows."""


def overlays(check: SweepEvidence, before: Array, after: Array) -> tuple[Overlay, ...]:
    """Return the first check sweep with knobs before and after (n_knobs,) each.

    Rows are sorted by level and distance; lines break between levels.
    """
    log = check.logs[0]
    sets = np.vstack([before, after])
    running = ~log.tare
    shown = check.thrusts(log.conditions, sets)[running]
    ratio, level = _z_over_R(log, check)[running], _levels(log)[running]
    out = [_overlay("thrust_N", "N", "z_over_R", ratio, level, log.thrust_N[running], shown)]
    if log.power is not None:
        power = log.power
        late = power.late
        out.append(
            _overlay(
                "rpm", "rpm", "time_s", power.time_s[late], power.level[late],
                RPM * power.speed_rad_s[late], RPM * check.foretold(log, sets).mean(axis=0)[late],
            )
        )  # fmt: skip
    return tuple(out)


def _z_over_R(log: SweepLog, check: SweepEvidence) -> Array:
    """Return plate distance over radius (m,), at most `FARTHEST_Z_OVER_R`."""
    ratio = log.conditions.plate_z_m / check.model.rig.propulsion.radius_m
    return np.minimum(ratio, FARTHEST_Z_OVER_R)


def _levels(log: SweepLog) -> NDArray[np.intp]:
    """Return the number of each row's level of throttle (m,)."""
    squares = np.sum(log.conditions.speed_rad_s**2, axis=0)
    order = np.argsort(squares)
    steps = np.diff(squares[order]) > SAME_LOAD * squares[order][1:]
    numbers = np.empty(len(squares), np.intp)
    numbers[order] = np.concatenate([[0], np.cumsum(steps)])
    return numbers


def _overlay(
    channel: str,
    unit: str,
    axis: str,
    at: Array,
    level: NDArray[np.intp],
    measured: Array,
    shown: Array,
) -> Overlay:
    """Return rows in the order of level and place, with nan between levels."""
    pieces = []
    for number in np.unique(level):
        rows = np.flatnonzero(level == number)
        rows = rows[np.argsort(at[rows], kind="stable")]
        pieces.append(np.column_stack([at, measured, shown])[rows])
        pieces.append(np.full((1, 4), np.nan))
    table = np.concatenate(pieces)
    return Overlay(
        channel=channel,
        unit=unit,
        axis=axis,
        at=table[:, 0],
        measured=table[:, 1],
        before=table[:, 2],
        after=table[:, 3],
    )
