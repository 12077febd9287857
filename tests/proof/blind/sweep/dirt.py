"""A dirty bench: small real imperfections in everything, none of them worth a name.

Each stays at or below half of the tolerance that its effect has (`library.py`); those without an
effect of their own are as small as on a bench put together with care. All of them are guesses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.proof.blind.sweep.bench import Bench
from tests.proof.blind.sweep.layouts import Layout
from tests.proof.blind.sweep.library import NAMED


def clean_bench(layout: Layout) -> Bench:
    """Return a bench that is what its sheet says."""
    return Bench(layout=layout)


def dirty_bench(rng: np.random.Generator, layout: Layout) -> Bench:
    """Draw a bench with more than fifteen small imperfections."""

    def within(limit: float) -> float:
        return float(rng.uniform(-limit, limit))

    def each(limit: float) -> tuple[float, ...]:
        return tuple((1.0 + rng.uniform(-limit, limit, layout.rotors)).tolist())

    # The nearer a quadrotor's terms come to one, the more a soft law departs from a hard one.
    softness = 1.0 + within(0.22 if layout.rotors == 1 else 0.12)
    bench = Bench(
        layout=layout,
        k_ratio=1.0 + within(0.02),
        k_of_rotor=each(0.01),
        radius_ratio=1.0 + within(0.04),
        softness=softness,
        near=within(0.03),
        plate_x0_m=within(0.002),
        plate_scatter_m=float(rng.uniform(0.0, 0.0001)),
        stage_play_m=float(rng.uniform(0.0, 0.0003)),
        gain_of_rotor=each(0.003),
        pwm_start_off_us=within(3.0),
        full_V=float(rng.uniform(11.8, 12.4)),
        resistance_ohm=float(rng.uniform(0.006, 0.02)),
        sag_curve=within(0.1),
        hysteresis_slope=within(0.2),
        bow_N=within(0.0001) * layout.full_scale_N,
        density_loss_per_s=within(5e-7),
        noise_ratio=1.0 + within(0.15),
    )
    for effect in NAMED.values():
        if layout.name in effect.layouts:
            low = -0.5 if effect.most_below else 0.0
            size = float(rng.uniform(low, 0.5))
            if effect.name == "neighbour_images":
                # On a quadrotor they are there: half a tolerance about what the sheet says.
                bench = replace(bench, neighbours=1.0 + 2.0 * (size - 0.25) * 0.2)
            else:
                bench = effect.put_into(bench, size)
    return bench
