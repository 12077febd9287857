"""Parts of a plate sweep in words: where an effect shows, a reader should find it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchtool.explain.engine.evidence import EARLY, LATE
from benchtool.explain.sweep.log import SweepLog
from benchtool.physics.model import Model

Mask = NDArray[np.bool_]

NEAR_Z_OVER_R, FAR_Z_OVER_R = 1.0, 4.0
"""Below this distance over radius the plate is near, beyond the other it is far; choices."""


def sweep_regimes(log: SweepLog, model: Model) -> dict[str, Mask]:
    """Return masks (m,) by the words that a report uses."""
    conditions = log.conditions
    running = ~log.tare
    ratio = conditions.plate_z_m / model.rig.propulsion.radius_m
    squares = np.sum(conditions.speed_rad_s**2, axis=0)
    partly = (conditions.coverage > 0.0) & (conditions.coverage < 0.999)
    covered = (conditions.coverage > 0.0).any(axis=0)
    edge = running & (partly.any(axis=0) | ~covered)
    over = running & ~edge
    out = {
        f"z/R below {NEAR_Z_OVER_R:g}": over & (ratio < NEAR_Z_OVER_R),
        f"z/R {NEAR_Z_OVER_R:g} to {FAR_Z_OVER_R:g}": over
        & (ratio >= NEAR_Z_OVER_R)
        & (ratio < FAR_Z_OVER_R),
        "plate far away": running & (ratio >= FAR_Z_OVER_R),
        "plate aside": over & (np.abs(conditions.plate_x_m) > 1e-3),
        "rotors at the plate's edge": edge,
        "after a tare, nothing turning": log.tare,
    }
    low, high = np.quantile(squares[running], [1.0 / 3.0, 2.0 / 3.0])
    if high > 1.05 * low:
        out |= {
            "high throttle": running & (squares >= high),
            "low throttle": running & (squares <= low),
        }
    if np.ptp(conditions.time_s) > 0.0:
        late = np.quantile(conditions.time_s, [1.0 / 3.0, 2.0 / 3.0])
        out |= {
            LATE: running & (conditions.time_s > late[1]),
            EARLY: running & (conditions.time_s < late[0]),
        }
    if np.ptp(conditions.elapsed_s[running]) > 0.0:
        long = np.quantile(conditions.elapsed_s[running], 2.0 / 3.0)
        out["long after a tare"] = running & (conditions.elapsed_s > long)
    if (conditions.load_direction[running] < 0.0).any():
        out |= {
            "levels on the way up": running & (conditions.load_direction > 0.0),
            "levels on the way down": running & (conditions.load_direction < 0.0),
        }
    n = len(log)
    return {name: mask for name, mask in out.items() if 0.0 < mask.sum() < 0.95 * n}
