"""How a load cell's zero wanders: 1/f noise and a random walk, as a rig states it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig, Sensor

DECADES_S = tuple(10.0**power for power in np.arange(-0.5, 5.0))  # 1/f noise, flat in 5 %


@dataclass(frozen=True, slots=True)
class ZeroNoise:
    """State how the zero of a load cell wanders.

    Attributes:
        walk: standard deviation of its random walk after one second: N/sqrt(s).
        flicker: standard deviation of its 1/f noise over one decade of frequency: N.
        dof: degrees of freedom behind the walk; infinite where it is stated.
    """

    walk: float = 0.0
    flicker: float = 0.0
    dof: float = np.inf


def zero_covariance(since_s: Array, noise: ZeroNoise) -> Array:
    """Return the covariance (m, m) of the zero at times (m,) since it was last known: N2.

    A random walk has w^2 min(t, t'). 1/f noise is a sum of Ornstein-Uhlenbeck processes of equal
    variance, their time constants a decade apart (Kasdin, Proc. IEEE 83, 1995), less its value
    when the zero was known.
    """
    t = np.concatenate([[0.0], since_s])
    apart = np.abs(t[:, None] - t)
    own = np.sum([np.exp(-apart / tau) for tau in DECADES_S], axis=0) * noise.flicker**2
    flicker = own[1:, 1:] - own[1:, :1] - own[:1, 1:] + own[0, 0]
    out: Array = noise.walk**2 * np.minimum(since_s[:, None], since_s) + flicker
    return out


def zero_variance(since_s: Array, noise: ZeroNoise) -> Array:
    """Return the diagonal (m,) of `zero_covariance`: N2."""
    decayed = np.sum([np.exp(-since_s / tau) for tau in DECADES_S], axis=0)
    flicker = 2.0 * noise.flicker**2 * (len(DECADES_S) - decayed)
    return np.asarray(noise.walk**2 * since_s + flicker, float)


def zero_noise(points: Recording, rig: Rig) -> ZeroNoise:
    """Return the noise of a run's zero: as its samples show it (`add_zero_drift`), else stated."""
    cell = rig.sensors.get("thrust_N", Sensor())
    walk, dof = (points.provenance.get(name, "") for name in ("zero_walk", "zero_walk_dof"))
    if not walk:
        return ZeroNoise(cell.walk, cell.flicker)
    return ZeroNoise(float(walk), cell.flicker, float(dof))
