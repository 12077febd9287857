"""Drive the pitch bench by pulses that somebody logged, whatever controller made them."""

from __future__ import annotations

import numpy as np

from benchtool.core.array import Array
from benchtool.core.errors import InputError
from benchtool.core.schedule import PARKED_M, SampledSchedule
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.run import PitchJob, PitchLoop

PARKED_FROM_M = 0.95 * PARKED_M
"""Plate readings from here on count as parked: a noisy reading of 1.0 is no plate."""


def replay_pulses(
    bench: PitchBench,
    pwm_us: Array,
    *,
    plate_z_m: Array,
    rate_Hz: float,
    theta_rad: float = 0.0,
    rate_rad_s: float = 0.0,
    speed_rad_s: Array | None = None,
) -> Array:
    """Return the true attitude (m,) under logged pulses, from a given state on: rad.

    Args:
        bench: the plant; its sensors do not matter.
        pwm_us: (n_discs, m) pulses, each held until the next.
        plate_z_m: (m,) distance with the beam level; about 1 m and beyond is parked.
        rate_Hz: of the log.
        theta_rad: attitude at the first sample.
        rate_rad_s: rate there.
        speed_rad_s: (n_discs,) rotor speeds there; settled at the first pulses when None.
    """
    n_discs, ticks = bench.model.rig.n_discs, len(plate_z_m)
    if pwm_us.shape != (n_discs, ticks):
        raise InputError(
            f"pulses have the shape {pwm_us.shape}, but {n_discs} discs and {ticks} plate "
            f"distances need ({n_discs}, {ticks})"
        )
    schedule = SampledSchedule(
        rate_Hz=rate_Hz,
        time_s=np.arange(ticks) / rate_Hz,
        reference_rad=np.zeros(ticks),
        collective=np.ones(ticks),
        dither_us=np.zeros(ticks),
        plate_z_m=np.asarray(plate_z_m, float),
        plate_share=(np.asarray(plate_z_m) < PARKED_FROM_M).astype(float),
        observer=np.zeros(ticks),
        feedforward=np.zeros(ticks),
    )
    control = PitchControl(name="logged", gains=None, rate_Hz=rate_Hz)
    loop = PitchLoop([PitchJob(bench, control)], schedule, 0, [0], external=True)
    loop.view("hinge.theta_rad")[:], loop.view("hinge.rate_rad_s")[:] = theta_rad, rate_rad_s
    loop.drive(np.ascontiguousarray(pwm_us, float))
    p = bench.model.rig.propulsion
    settled = p.speed_per_us_rad_s * np.maximum(pwm_us[:, 0] - p.pwm_start_us, 0.0)
    turning = settled if speed_rad_s is None else speed_rad_s
    loop.view("rotors.speed_rad_s")[:, 0] = turning
    loop.run()
    attitude: Array = loop.log[:, 8, 0].copy()
    return attitude
