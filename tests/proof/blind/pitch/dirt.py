"""A dirty bench: small real imperfections in everything, none of them worth a name.

Each stays at or below half of the tolerance that its effect has (`library.py`); those without an
effect of their own are as small as on a bench put together with care. All of them are guesses.
"""

from __future__ import annotations

import math

import numpy as np

from tests.proof.blind.pitch.plant import FrictionLaw, Plant
from tests.proof.blind.pitch.sheet import SHEET


def clean_bench() -> Plant:
    """Return a bench that is what its sheet says."""
    return Plant()


def dirty_bench(rng: np.random.Generator) -> Plant:
    """Draw a bench with more than twenty small imperfections."""

    def within(limit: float) -> float:
        return float(rng.uniform(-limit, limit))

    def up_to(limit: float) -> float:
        return float(rng.uniform(0.0, limit))

    laws: tuple[FrictionLaw, ...] = ("constraint", "smooth")
    gain = SHEET.rpm_per_us
    return Plant(
        inertia_kgm2=SHEET.J * (1.0 + within(0.05)),
        friction_Nm=up_to(0.001),
        friction_law=laws[int(rng.integers(2))],
        friction_width_rad_s=float(rng.uniform(0.003, 0.03)),
        damping_Nms=up_to(0.002),
        stiffness_Nm_per_rad=within(0.006),
        cog_x_m=within(0.0002),
        cog_below_m=within(0.0003),
        tau_s=SHEET.tau_m + within(0.001),
        tau_rise_ratio=1.0 + within(0.02),
        delay_s=up_to(0.001),
        rpm_per_us=(gain * (1.0 + within(0.003)), gain * (1.0 + within(0.003))),
        sag_per_s=up_to(0.0002),
        thrust_ratio=1.0 + within(0.005),
        thrust_exponent=2.0 + within(0.01),
        ge_rho=SHEET.ge_rho * (1.0 + within(0.05)),
        K_b=up_to(0.1),
        coverage_share=1.0 - up_to(0.04),
        plate_dz_m=within(0.001),
        aero_damping=up_to(0.25),
        gyro_bias_rad_s=within(math.radians(0.05)),
        gyro_scale=1.0 + within(0.008),
        encoder_wobble_rad=up_to(0.0004),
        encoder_phase_rad=float(rng.uniform(-math.pi, math.pi)),
        wake_sd_Nm=SHEET.sd_process * (1.0 + within(0.1)),
        wake_tau_s=SHEET.tau_process * (1.0 + within(0.1)),
    )
