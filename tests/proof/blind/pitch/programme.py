"""What the bench is asked to do: reference, collective, dither and plate, rich or poor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tests.proof.blind.pitch.sheet import PARKED_M, SHEET

Array = NDArray[np.float64]
Excitation = Literal["rich", "poor"]

BLOCK_S = 30.0
DITHER_US = 15.0
DETENTS_M = (0.08, 0.1, 0.12, 0.15, 0.18, 0.22, 0.28, 0.35)
"""Distances at which this bench's plate can stand."""

CLEARANCE_M = 0.075  # nearest that a reference brings the covered rotor to the plate


@dataclass(frozen=True, slots=True, eq=False)
class Programme:
    """Hold one part's schedule, sample by sample."""

    theta_ref_rad: Array  # (n,)
    collective_us: Array  # (n,) mean of both pulses
    dither_us: Array  # (n,) added to pulse 1, taken from pulse 2
    plate_m: Array  # (n,) distance of the level beam from the plate; PARKED_M: none

    def __len__(self) -> int:
        return len(self.theta_ref_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class Habits:
    """Hold what learn and check part of one bench share: its detents and its collectives."""

    detents_m: tuple[float, ...]
    collectives_us: tuple[float, ...]


def habits(rng: np.random.Generator, excitation: Excitation) -> Habits:
    """Draw how this bench is run."""
    if excitation == "poor":
        return Habits(
            detents_m=(float(rng.choice(DETENTS_M[:5])),),
            collectives_us=(float(rng.integers(1420, 1581)),),
        )
    near = rng.choice(DETENTS_M[:2], 1)
    far = rng.choice(DETENTS_M[5:], 1)
    between = rng.choice(DETENTS_M[2:5], 2, replace=False)
    step = int(rng.integers(50, 66))
    return Habits(
        detents_m=tuple(float(z) for z in (*near, *between, *far)),
        collectives_us=tuple(SHEET.base_pwm + step * k for k in (-2.0, -1.0, 0.0, 1.0, 2.0)),
    )


def programme(
    rng: np.random.Generator, excitation: Excitation, shared: Habits, blocks: int
) -> Programme:
    """Draw a part of so many blocks of 30 s."""
    draw = _rich_block if excitation == "rich" else _poor_block
    parts = [draw(rng, shared) for _ in range(blocks)]
    return Programme(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("theta_ref_rad", "collective_us", "dither_us", "plate_m")
        )
    )


def _samples(seconds: float) -> int:
    return round(seconds / SHEET.dt)


def _held(levels: Array, n: int) -> Array:
    """Spread levels evenly over n samples, each held."""
    return levels[np.minimum(np.arange(n) * len(levels) // n, len(levels) - 1)]


def _rich_block(rng: np.random.Generator, shared: Habits) -> Programme:
    third, sixth = _samples(BLOCK_S / 3), _samples(BLOCK_S / 6)
    n = 3 * third
    levels = np.array([-20.0, -15.0, -10.0, -5.0, 0.0, 5.0, 10.0, 15.0, 20.0])
    steps = _held(rng.permutation(levels)[: int(rng.integers(6, 9))], third)
    triangle = _triangle(rng.uniform(6.0, 10.0), rng.uniform(2.0, 3.0), sixth)
    chirp = _chirp(rng.uniform(3.0, 5.0), rng.uniform(0.3, 0.6), rng.uniform(2.5, 4.0), sixth)
    slots = rng.permutation(np.array(shared.detents_m))
    plate = np.concatenate([np.full(2 * third, PARKED_M), _plate_slots(slots, third)])
    hold = third // (2 * len(slots))
    near = np.array([(_clear(rng, z, 6.0), 0.0) for z in slots]).ravel()
    close = np.append(np.repeat(near, hold), np.zeros(third - 2 * hold * len(slots)))
    collectives = rng.permutation(np.array(shared.collectives_us))
    collectives = np.append(collectives, rng.choice(shared.collectives_us))
    return Programme(
        np.radians(np.concatenate([steps, triangle, chirp, close])),
        _held(collectives, n),
        _dither(rng, n),
        plate,
    )


def _poor_block(rng: np.random.Generator, shared: Habits) -> Programme:
    n = _samples(BLOCK_S)
    z = shared.detents_m[0]
    count = int(rng.integers(5, 9))
    size = rng.uniform(2.0, 4.0)
    levels = np.array([_clear(rng, z, size) for _ in range(count)])
    # Half of the poor recordings have the plate in all the time, half only later on.
    entry = 0 if rng.random() < 0.5 else n // 2
    plate = np.full(n, z)
    plate[:entry] = PARKED_M
    return Programme(
        np.radians(_held(levels, n)),
        np.full(n, shared.collectives_us[0]),
        np.zeros(n),
        plate,
    )


def _clear(rng: np.random.Generator, plate_m: float, most_deg: float) -> float:
    """Draw an angle at which the covered rotor stays clear of the plate: degrees."""
    room = math.degrees(math.asin(min(max(plate_m - CLEARANCE_M, 0.0) / SHEET.L, 1.0)))
    return float(rng.uniform(-min(most_deg, room), most_deg))


def _triangle(amplitude_deg: float, period_s: float, n: int) -> Array:
    phase = (np.arange(n) * SHEET.dt / period_s) % 1.0
    return np.asarray(amplitude_deg * (4.0 * np.abs(phase - 0.5) - 1.0))


def _chirp(amplitude_deg: float, low_Hz: float, high_Hz: float, n: int) -> Array:
    t = np.arange(n) * SHEET.dt
    span = n * SHEET.dt
    return amplitude_deg * np.sin(
        2.0 * np.pi * (low_Hz * t + 0.5 * (high_Hz - low_Hz) * t * t / span)
    )


def _plate_slots(detents_m: Array, n: int) -> Array:
    """Hold each detent for four fifths of its slot, then park."""
    slot = n // len(detents_m)
    out = np.full(n, PARKED_M)
    for k, z in enumerate(detents_m):
        out[k * slot : k * slot + 4 * slot // 5] = z
    return out


def _dither(rng: np.random.Generator, n: int) -> Array:
    """Draw a random telegraph of a fixed clock: +-DITHER_US."""
    clock = int(rng.integers(10, 15))
    signs = rng.integers(0, 2, n // clock + 1) * 2.0 - 1.0
    return DITHER_US * np.repeat(signs, clock)[:n]
