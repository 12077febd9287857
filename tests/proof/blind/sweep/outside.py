"""Effects that no library names: what an honest tool calls unknown.

Full ones are sized so that no thrust coefficient and no effective radius takes them up (`gap.py`
measures it, a test states it); weak ones are smaller. All sizes are ours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.proof.blind.families import Strength
from tests.proof.blind.sweep.bench import Bench

WEAK = 0.25  # size of a weak effect in a full one's

Outside = Callable[[np.random.Generator, Bench, float], Bench]


def recirculation(rng: np.random.Generator, bench: Bench, scale: float) -> Bench:
    """Let the air of a closed room come round again and take thrust, the longer the more."""
    return replace(
        bench,
        room_loss=scale * float(rng.uniform(0.05, 0.1)),
        room_s=float(rng.uniform(6.0, 15.0)),
    )


def flutter_step(rng: np.random.Generator, bench: Bench, scale: float) -> Bench:
    """Let thrust jump above a speed within the range of the sweep."""
    sheet = bench.layout
    pulse_us = float(rng.uniform(1465.0, 1530.0))
    speed = sheet.gain_rad_s_us * (pulse_us - sheet.pwm_start_us) * 11.9 / sheet.nominal_V
    return replace(
        bench,
        flutter_rad_s=speed,
        flutter_jump=scale * float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.04, 0.08)),
    )


def stage_backlash(rng: np.random.Generator, bench: Bench, scale: float) -> Bench:
    """Let the plate stand short of where the stage thinks, on the side that it came from."""
    return replace(bench, stage_play_m=scale * float(rng.uniform(0.012, 0.02)))


def cell_saturation(rng: np.random.Generator, bench: Bench, scale: float) -> Bench:
    """Let the amplifier clip the greatest thrusts."""
    reach = float(rng.uniform(1.05, 1.2)) / (0.7 + 0.3 * scale)
    return replace(bench, saturation_N=reach * bench.layout.hover_N)


def cell_creep(rng: np.random.Generator, bench: Bench, scale: float) -> Bench:
    """Let the load cell follow a part of the load late, as glue and metal do."""
    return replace(
        bench,
        creep_share=scale * float(rng.uniform(0.04, 0.08)),
        creep_s=float(np.exp(rng.uniform(np.log(20.0), np.log(90.0)))),
    )


def stand_resonance(rng: np.random.Generator, bench: Bench, scale: float) -> Bench:
    """Let the stand shake near one rotor speed, and the cell's mean lose with the square of it."""
    sheet = bench.layout
    pulse_us = float(rng.uniform(1420.0, 1560.0))
    return replace(
        bench,
        shaking_rad_s=sheet.gain_rad_s_us
        * (pulse_us - sheet.pwm_start_us)
        * 11.9
        / sheet.nominal_V,
        shaking_share=scale * float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.05, 0.1)),
        shaking_damping=float(rng.uniform(0.05, 0.1)),
    )


def warming_blades(rng: np.random.Generator, bench: Bench, scale: float) -> Bench:
    """Let blades and motors warm up with the power through them, and the coefficient fall."""
    return replace(
        bench,
        warm_loss=scale * float(rng.uniform(0.04, 0.08)),
        warm_s=float(np.exp(rng.uniform(np.log(60.0), np.log(300.0)))),
    )


def bending_plate(rng: np.random.Generator, bench: Bench, scale: float) -> Bench:
    """Let a thin plate give way under the wash, the more the nearer and the harder it blows."""
    return replace(bench, plate_yield_m=scale * float(rng.uniform(0.015, 0.025)))


OUTSIDE: dict[str, Outside] = {
    draw.__name__: draw
    for draw in (
        recirculation,
        flutter_step,
        stage_backlash,
        cell_saturation,
        cell_creep,
        stand_resonance,
        warming_blades,
        bending_plate,
    )
}


def put_outside(name: str, rng: np.random.Generator, bench: Bench, strength: Strength) -> Bench:
    """Return the bench with an effect from outside the library."""
    return OUTSIDE[name](rng, bench, WEAK if strength == "weak" else 1.0)


def without_outside(bench: Bench) -> Bench:
    """Return the bench as a library could at best describe it."""
    return replace(
        bench,
        room_loss=0.0,
        flutter_jump=0.0,
        stage_play_m=0.0,
        saturation_N=0.0,
        creep_share=0.0,
        shaking_share=0.0,
        warm_loss=0.0,
        plate_yield_m=0.0,
    )
