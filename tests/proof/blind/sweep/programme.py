"""What is visited in which order: rich sweeps and poor ones, the plate and the clock.

Motors stand still while the plate moves and while the cell is tared; levels at one place follow
each other without a stop. That is how `benchtool sweep` does it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from tests.proof.blind.sweep.layouts import Layout

Excitation = Literal["rich", "poor"]
Kind = Literal["measure", "reference", "anchor", "tare"]

FEED_M_S = 0.1
STOP_S, RAMP_S, SAMPLE_S, TARE_S = 1.0, 0.3, 2.0, 6.0
TARE_EVERY_S = 240.0

RICH_Z_OVER_R: dict[str, tuple[float, ...]] = {  # before they are shifted a little for each part
    "single": (0.5, 0.65, 0.85, 1.1, 1.5, 2.1, 3.0, 4.5, 6.5),
    "quad": (0.6, 0.75, 0.95, 1.25, 1.7, 2.4, 3.4, 4.8, 6.8),
}

ASIDE_M: dict[str, tuple[float, ...]] = {"single": (-0.3, 0.3), "quad": (-0.2, 0.2)}
"""Lateral positions that leave every disc over the plate."""

QUARTERS = (-0.404, 0.0, 0.404)
"""How far a disc's axis lies within an edge, over R, when quarters of it are covered."""

HABITS = ("one level", "one distance", "two of each")  # how a sweep can be poor

LEVELS_US = (1380.0, 1450.0, 1520.0, 1590.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stay:
    """Hold one place of the plate, as the stage reads it, and the levels visited there."""

    z_m: float
    x_m: float
    levels_us: tuple[float, ...]
    kind: Kind = "measure"


@dataclass(frozen=True, slots=True, kw_only=True)
class Visit:
    """Hold one row of the table to come.

    Attributes:
        start_s, middle_s: of its samples' span since motors began to turn to it, and their middle.
    """

    kind: Kind  # as in the table
    stay: int  # number of the stay, from 0; also of a tare, which follows it
    z_m: float
    x_m: float
    level_us: float
    start_s: float
    middle_s: float
    tared_s: float  # when the cell was last tared
    still_s: float  # for how long the motors stood before it; 0: they were turning
    from_below_m: float  # distance by which the stage last moved up (positive) or down to get here


@dataclass(frozen=True, slots=True, kw_only=True)
class Programme:
    """Hold a sweep: its visits in order, tares among them (only rich ones keep a row of them)."""

    visits: tuple[Visit, ...]
    excitation: Excitation


def programme(
    rng: np.random.Generator, layout: Layout, excitation: Excitation, habit: int
) -> Programme:
    """Draw a sweep; two draws have other distances, levels and another order.

    Args:
        rng: of this part.
        layout: what stands on the bench.
        excitation: rich or poor.
        habit: which kind of poor sweep this bench's owner makes, of `HABITS`.
    """
    stays = _rich(rng, layout) if excitation == "rich" else _poor(rng, layout, habit)
    return Programme(visits=_timed(rng, layout, stays), excitation=excitation)


def _levels(rng: np.random.Generator) -> np.ndarray:
    return np.round(np.array(LEVELS_US) + rng.uniform(-25.0, 25.0))


def _rich(rng: np.random.Generator, layout: Layout) -> list[Stay]:
    levels = _levels(rng)
    up_and_down = (*levels, *levels[-2::-1])
    radius = layout.radius_m
    distances = np.array(RICH_Z_OVER_R[layout.name]) * rng.uniform(1.0, 1.08, 9) * radius
    places = [(float(z), 0.0) for z in distances]
    aside = ASIDE_M[layout.name]
    places += [(float(rng.uniform(1.0, 1.2)) * radius, x) for x in aside]
    places += [(float(rng.uniform(1.8, 2.2)) * radius, x) for x in aside]
    # The edge of the plate under the middle discs, quarters of them over it.
    for quarter in (*QUARTERS, float(rng.choice(QUARTERS))):
        inside = (quarter + float(rng.uniform(-0.06, 0.06))) * radius
        side = float(rng.choice([-1.0, 1.0]))
        near = float(rng.uniform(0.95, 1.1)) * radius
        places.append((near, side * (0.5 * layout.plate_m - inside)))
    # The nearest ones come again, so that a stage is seen from both sides.
    places += [(float(z), 0.0) for z in distances[[1, 3]]]
    order = rng.permutation(len(places))
    # A stay that comes again at once would not be seen from the other side.
    while any(places[a] == places[b] for a, b in pairwise(order)):
        order = rng.permutation(len(places))
    stays = []
    for count, index in enumerate(order):
        if count % 6 == 0:
            stays.append(_parked(layout, up_and_down))
        z, x = places[index]
        stays.append(Stay(z_m=_shown(z), x_m=_shown(x), levels_us=up_and_down))
    return [*stays, _parked(layout, up_and_down)]


def _poor(rng: np.random.Generator, layout: Layout, habit: int) -> list[Stay]:
    """Return few distances or few levels; never up and down, never aside, no tare rows."""
    levels = _levels(rng)
    chosen = (levels[[2]], levels, levels[[0, 2]])[habit]
    distances = ((0.9, 1.3, 2.0, 3.2), (1.0,), (0.9, 1.8))[habit]
    places = [float(rng.uniform(0.97, 1.05)) * z * layout.radius_m for z in distances]
    stays = []
    for _ in range(max(2, 8 // len(places))):
        stays.append(_parked(layout, tuple(chosen)))
        stays += [
            Stay(z_m=_shown(z), x_m=0.0, levels_us=tuple(chosen)) for z in rng.permutation(places)
        ]
    return stays


def _parked(layout: Layout, levels_us: tuple[float, ...]) -> Stay:
    return Stay(z_m=layout.park_m, x_m=0.0, levels_us=levels_us, kind="reference")


def _shown(place_m: float) -> float:
    return round(place_m, 4)


def _timed(rng: np.random.Generator, layout: Layout, stays: list[Stay]) -> tuple[Visit, ...]:
    visits = []
    clock_s = tared_s = TARE_S
    at_z, at_x, up_m = layout.park_m, 0.0, 0.0

    def add(stay: Stay, number: int, kind: Kind, level: float, start: float, still: float) -> None:
        visits.append(
            Visit(
                kind=kind,
                stay=number,
                z_m=stay.z_m,
                x_m=stay.x_m,
                level_us=level,
                start_s=start,
                middle_s=clock_s,
                tared_s=tared_s,
                still_s=still,
                from_below_m=up_m,
            )
        )

    for number, stay in enumerate(stays):
        still_s = STOP_S
        if number == 0 or clock_s - tared_s > TARE_EVERY_S:
            begun_s = clock_s
            clock_s += TARE_S
            tared_s = clock_s - 0.5
            add(stay, number, "tare", layout.pwm_start_us - 50.0, begun_s, 0.0)
            still_s += TARE_S
        moved_m = max(abs(stay.z_m - at_z), abs(stay.x_m - at_x))
        if stay.z_m != at_z:
            up_m = stay.z_m - at_z
        clock_s += STOP_S + moved_m / FEED_M_S
        still_s += moved_m / FEED_M_S
        at_z, at_x = stay.z_m, stay.x_m
        for level in stay.levels_us:
            begun_s = clock_s
            clock_s += RAMP_S + float(rng.uniform(1.0, 2.5)) + 0.5 * SAMPLE_S
            add(stay, number, stay.kind, level, begun_s, still_s)
            clock_s += 0.5 * SAMPLE_S
            still_s = 0.0
    return tuple(visits)
