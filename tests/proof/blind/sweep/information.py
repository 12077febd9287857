"""What a part of a sweep can tell about the true bench: its Fisher information.

Readings of thrust at the true speeds, and speeds at the pulses, each with its own noise. What no
owner of a bench knows exactly is free: thrust coefficient, effective radius, the shape of the
ground law, the map from pulse to speed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tests.proof.blind.fisher import evidence_against
from tests.proof.blind.sweep.bench import Bench
from tests.proof.blind.sweep.library import NAMED
from tests.proof.blind.sweep.readings import cell_N, driven, thrust_N
from tests.proof.blind.sweep.table import RPM, RPM_SE, Part

Array = NDArray[np.float64]

NUISANCES: dict[str, tuple[str, float, float]] = {
    "thrust coefficient": ("k_ratio", 1.0, 0.1),
    "effective radius": ("radius_ratio", 1.0, 0.05),
    "shape of the law": ("softness", 1.0, 0.2),
    "start of the pulses": ("pwm_start_off_us", 0.0, 3.0),
}
"""Field of the bench, what the sheet says, and how far off it may be."""

STEP = 0.02  # step of the differences, in tolerances


@dataclass(frozen=True, slots=True, eq=False)
class Information:
    """Hold what a part tells about a true bench."""

    names: tuple[str, ...]  # (k,) effects that the layout can show, then nuisances
    matrix: Array  # (k, k) Fisher information, each in tolerances of its own
    sizes: Array  # (k,) true values, in tolerances past neutral

    def evidence(self, rivals: Iterable[str] = ()) -> float:
        """Return how clearly the part speaks against rivals in place of the true effects."""
        free = set(rivals)
        reach = np.array([np.inf if name in free else 1.0 for name in self.names])
        below = [1.0 if name in NUISANCES else _below(name) for name in self.names]
        return evidence_against(self.matrix, self.sizes, -reach * np.array(below), reach)


def _below(name: str) -> float:
    """Return 1, or next to nothing where physics allows nothing below neutral."""
    return 1.0 if NAMED[name].most_below else 1e-6


def information(part: Part, truth: Bench) -> Information:
    """Return what one part tells about the true bench.

    Neighbours are counted from the straight truth that a quadrotor's owner knows of, unless the
    bench has more of them than that: then from none at all.
    """
    names = [name for name, effect in NAMED.items() if truth.layout.name in effect.layouts]
    sheet = 1.0 / 0.2 if truth.neighbours < 1.2 else 0.0
    base, columns, sizes = _shown(part, truth), [], []
    for name in names:
        effect = NAMED[name]
        size = effect.value_in(truth)
        sizes.append(size - (sheet if name == "neighbour_images" else 0.0))
        columns.append((_shown(part, effect.put_into(truth, size + STEP)) - base) / STEP)
    for field, neutral, width in NUISANCES.values():
        value = getattr(truth, field)
        sizes.append((value - neutral) / width)
        moved = replace(truth, **{field: value + STEP * width})
        columns.append((_shown(part, moved) - base) / STEP)
    slopes = np.column_stack(columns)
    return Information((*names, *NUISANCES), slopes.T @ slopes, np.array(sizes))


def _shown(part: Part, bench: Bench) -> Array:
    """Return what the instruments would show, each row over its noise."""
    force = thrust_N(bench, part.rows, part.drive.speed_rad_s, part.scatter_m)
    reading = (cell_N(bench, part.rows, force, part.drive.speed_rad_s) / part.se_N)[part.kept]
    that_day = replace(bench, full_V=part.bench.full_V)
    speed = driven(that_day, part.rows).speed_rad_s[:, part.rows.turning]
    return np.concatenate([reading, (RPM * speed / RPM_SE).ravel()])
