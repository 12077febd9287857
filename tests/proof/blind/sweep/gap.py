"""How far a bench without what is hidden misses a part of a record, and who could close that.

The bench is driven by the true speeds, so that what is hidden between pulse and speed shows in the
speeds alone. Thrust coefficient and effective radius are free, as in every fit of a sweep: what
they take up is no gap. This is the generator's own measure.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tests.proof.blind.sweep.bench import Bench
from tests.proof.blind.sweep.library import NAMED
from tests.proof.blind.sweep.outside import without_outside
from tests.proof.blind.sweep.readings import cell_N, driven, thrust_N
from tests.proof.blind.sweep.records import Truth
from tests.proof.blind.sweep.table import RPM, RPM_SE, Part

Array = NDArray[np.float64]

STEP = 0.05  # step of derivatives, in tolerances


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """Hold the root mean square miss over the noise's, of thrust and of speed.

    Attributes:
        closed: by effect, the share of the thrust's gap that it would close (first order).
    """

    thrust: float  # of the bench without what is hidden
    speed: float  # the same for rotor speeds given the pulses
    closed: dict[str, float]


def without_hidden(truth: Truth) -> Bench:
    """Return the true bench with only what is hidden taken out."""
    bench = without_outside(truth.bench) if truth.kind == "outside" else truth.bench
    for effect in truth.effects:
        bench = NAMED[effect.name].put_into(bench, 0.0)
    return bench


def gap(part: Part, truth: Truth) -> Gap:
    """Return what leaving out the hidden thing costs on one part."""
    bench = without_hidden(truth)
    speed = part.drive.speed_rad_s

    def shown(model: Bench) -> Array:
        force = thrust_N(model, part.rows, speed, part.scatter_m)
        return (cell_N(model, part.rows, force, speed) / part.se_N)[part.kept]

    true = (cell_N(truth.bench, part.rows, part.force_N, speed) / part.se_N)[part.kept]
    slopes = [_slope(shown, bench, field, 1e-4) for field in ("k_ratio", "radius_ratio")]
    free = np.column_stack(slopes)
    left = _without(true - shown(bench), free)
    whole = float(np.sqrt(np.mean(left**2)))
    closed = {}
    for name, effect in NAMED.items():
        if bench.layout.name not in effect.layouts:
            continue
        size = effect.value_in(bench)
        moved = shown(effect.put_into(bench, size + STEP)) - shown(bench)
        rest = _without(true - shown(bench), np.column_stack([free, moved]))
        closed[name] = 1.0 - float(np.sqrt(np.mean(rest**2))) / whole if whole else 0.0
    that_day = replace(bench, full_V=part.bench.full_V)
    there = part.drive.speed_rad_s[:, part.rows.turning]
    pulse = driven(that_day, part.rows).speed_rad_s[:, part.rows.turning]
    missed = float(np.sqrt(np.mean((there - pulse) ** 2))) * RPM / RPM_SE
    return Gap(thrust=whole, speed=missed, closed=closed)


def _slope(shown: Callable[[Bench], Array], bench: Bench, field: str, step: float) -> Array:
    here = getattr(bench, field)
    up, down = (replace(bench, **{field: here * (1.0 + sign * step)}) for sign in (1.0, -1.0))
    slope: Array = shown(up) - shown(down)
    return slope


def _without(rest: Array, columns: Array) -> Array:
    """Return what least squares on the columns leaves."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    found = np.linalg.lstsq(scaled, rest, rcond=1e-10)[0]
    left: Array = rest - scaled @ found
    return left
