"""Zero drift of a load cell: 1/f noise and a random walk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchtool.core.recording import Recording
from benchtool.core.rig import Rig, Sensor
from benchtool.core.units import Array

DECADES_S = tuple(10.0**power for power in np.arange(-0.5, 5.0))  # 1/f noise, flat in 5 %


@dataclass(frozen=True, slots=True)
class ZeroNoise:
    """Parameters of the zero drift of a load cell.

    Attributes:
        walk: standard deviation of its random walk after one second: N/sqrt(s).
        flicker: standard deviation of its 1/f noise over one decade of frequency: N.
        dof: degrees of freedom of the estimated walk; infinite if it is from the rig.
    """

    walk: float = 0.0
    flicker: float = 0.0
    dof: float = np.inf


def zero_covariance(since_s: Array, noise: ZeroNoise) -> Array:
    """Return the covariance (m, m) of the zero drift, at times (m,) since the last known zero: N2.

    A random walk has w^2 min(t, t'). 1/f noise is a sum of Ornstein-Uhlenbeck processes of equal
    variance, with time constants a decade apart (Kasdin, Proc. IEEE 83, 1995), minus its value at
    the last known zero.
    """
    t = np.concatenate([[0.0], since_s])
    lag_s = np.abs(t[:, None] - t)
    process = np.sum([np.exp(-lag_s / tau) for tau in DECADES_S], axis=0) * noise.flicker**2
    flicker = process[1:, 1:] - process[1:, :1] - process[:1, 1:] + process[0, 0]
    covariance: Array = noise.walk**2 * np.minimum(since_s[:, None], since_s) + flicker
    return covariance


def zero_variance(since_s: Array, noise: ZeroNoise) -> Array:
    """Return the diagonal (m,) of `zero_covariance`: N2."""
    decayed = np.sum([np.exp(-since_s / tau) for tau in DECADES_S], axis=0)
    flicker = 2.0 * noise.flicker**2 * (len(DECADES_S) - decayed)
    return np.asarray(noise.walk**2 * since_s + flicker, float)


def zero_noise(points: Recording, rig: Rig) -> ZeroNoise:
    """Return the zero drift of a run; its walk is from `add_zero_drift`, else from the rig."""
    load_cell = rig.sensors.get("thrust_N", Sensor())
    walk, dof = (points.provenance.get(name, "") for name in ("zero_walk", "zero_walk_dof"))
    if not walk:
        return ZeroNoise(load_cell.walk, load_cell.flicker)
    return ZeroNoise(float(walk), load_cell.flicker, float(dof))
