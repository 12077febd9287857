"""Parts of a pitch recording in words: where an effect shows, a reader should find it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchtool.explain.engine.evidence import EARLY, LATE
from benchtool.simulate.pitch.follow import LoggedPitch

Mask = NDArray[np.bool_]

NEAR_Z_OVER_R = 2.0
"""Below this distance over radius the plate is near; a choice."""

SLOW_RAD_S = 0.05
"""Below this rate the beam is slow; a choice, 3 degrees a second."""

AROUND_S = 0.15
"""How long before and after a change of sign a reversal lasts; a choice."""


def pitch_regimes(logged: LoggedPitch, radius_m: float) -> dict[str, Mask]:
    """Return masks (n,) by the words that a report uses."""
    n = len(logged)
    rate = np.nan_to_num(logged.gyro_rad_s)
    if not rate.any():
        rate = np.gradient(np.nan_to_num(logged.theta_rad)) * logged.rate_Hz
    width = max(1, round(0.05 * logged.rate_Hz))
    calm = np.convolve(rate, np.ones(width) / width, mode="same")
    slow = np.abs(calm) < SLOW_RAD_S
    turns = np.zeros(n, bool)
    turns[1:] = np.sign(calm[1:]) != np.sign(calm[:-1])
    near_turn = np.convolve(turns, np.ones(2 * round(AROUND_S * logged.rate_Hz) + 1), "same") > 0
    mean = logged.pwm_us.mean(axis=0)
    step = np.abs(np.gradient(logged.pwm_us[0] - logged.pwm_us[-1]))
    settled = np.convolve(step, np.ones(width) / width, "same") < np.median(step) + 1e-9
    low, high = np.quantile(mean, [1.0 / 3.0, 2.0 / 3.0])
    covered = logged.plate_share > 0.0
    near = covered & (logged.plate_z_m < NEAR_Z_OVER_R * radius_m)
    time = np.arange(n)
    out = {
        f"z/R below {NEAR_Z_OVER_R:g}": near,
        "plate in": covered,
        "plate parked": ~covered,
        "slow reversals": slow & near_turn,
        "at rest": slow & ~near_turn,
        "fast motion": np.abs(calm) > np.quantile(np.abs(calm), 0.8),
        LATE: time > 2 * n // 3,
        EARLY: time < n // 3,
        "quick changes of the pulses": ~settled,
    }
    if high - low > 0.05 * (high - 1000.0):
        out |= {"high collective": mean >= high, "low collective": mean <= low}
    return {name: mask for name, mask in out.items() if 0.01 * n < mask.sum() < 0.95 * n}
