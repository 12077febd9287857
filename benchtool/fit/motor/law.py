"""Law of thrust over rotor speed, selected by cross-validation over throttle levels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.fit.motor.response import Solution, solve_weighted

# Indices of the free parameters among (scale, T_0, n) by law, the simplest first.
LAWS = {"k w^2": [0], "k w^2 + T_0": [0, 1], "c w^n": [0, 2]}
MAX_LEVELS = 12  # adjacent pulse widths are merged to this many levels; assumed
MISFIT_ITERATIONS = 6  # of weights with the misfit; assumed
MIN_THRUST_SHARE = 0.1  # lower end of the range of a single k, relative to max thrust; assumed

IntArray = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ThrustLaw:
    """Thrust of one rotor over its speed w: scale (w / middle)^n + T_0."""

    name: str  # a key of `LAWS`
    values: tuple[float, float, float]  # scale in N, T_0 in N, n
    middle_rad_s: float
    covariance: Array  # (3, 3) of the values, 0 for fixed ones
    dof: int
    residual_N: float  # standard deviation of level means about the law
    level_speed_rad_s: Array  # (m,), root mean square
    level_thrust_N: Array  # (m,)
    scores: dict[str, float]  # by law: squared error of held-out levels over standard error

    def thrust_N(self, speed_rad_s: Any) -> Any:
        """Return the thrust of one rotor, not below 0: N."""
        scale, zero, power = self.values
        x = np.asarray(speed_rad_s, float) / self.middle_rad_s
        return np.maximum(scale * x**power + zero, 0.0)

    def speed_at(self, thrust_N: float) -> tuple[float, float]:
        """Return the speed of a thrust and its standard uncertainty: rad/s."""
        scale, zero, power = self.values
        share = max(thrust_N / scale - zero / scale, 1e-9)
        x = float(share ** (1.0 / power))
        way = np.array([share, 1.0, scale * share * np.log(x)])
        sd = sqrt(way @ self.covariance @ way + self.residual_N**2)
        speed = x * self.middle_rad_s
        return speed, sd * speed / (power * scale * share)

    @property
    def coefficient(self) -> float:
        """The c of c w^n; k for n = 2: N/(rad/s)^n."""
        return float(self.values[0] / self.middle_rad_s ** self.values[2])

    @property
    def single_k(self) -> tuple[float, float, float, float, float]:
        """The k of T = k w^2, its standard uncertainty, maximum relative error, speed range.

        For another law, k minimises the maximum relative error above `MIN_THRUST_SHARE` of the
        highest thrust; that error adds to the uncertainty as a rectangular distribution.
        """
        used = self.level_thrust_N >= MIN_THRUST_SHARE * self.level_thrust_N.max()
        speed, thrust = self.level_speed_rad_s[used], self.level_thrust_N[used]
        low, high = float(speed.min()), float(speed.max())
        # T / w^2 is monotonic in every law: its extremes are at the ends.
        k_low, k_high = (float(self.thrust_N(end)) / end**2 for end in (low, high))
        exact = self.name == "k w^2"
        k = self.coefficient if exact else 2.0 * k_low * k_high / (k_low + k_high)
        error = float(np.abs(k * speed**2 / thrust - 1.0).max())
        relative = sqrt(self.covariance[0, 0]) / self.values[0]
        sd = k * float(np.hypot(relative, 0.0 if exact else error / sqrt(3.0)))
        return k, sd, error, low, high


def level_numbers(pulse_us: Array) -> IntArray:
    """Return the throttle level of each point (n,); pulse widths are merged to `MAX_LEVELS`."""
    pulses = np.unique(pulse_us)
    first = [group[0] for group in np.array_split(pulses, min(len(pulses), MAX_LEVELS))]
    return np.asarray(np.searchsorted(first, pulse_us, side="right") - 1, np.intp)


def solve_levels(
    residuals_N: Callable[[Array], Array],
    error_N: Array,
    zero_N2: Array,
    level: IntArray,
    start: Sequence[float] | Array,
) -> tuple[Solution, float]:
    """Return the weighted solution and the standard deviation of level means about it: N.

    Points of a level share the misfit, whose variance is that of level means less their errors
    (method of moments). Thrusts are not corrected for the zero, which enters the covariance.

    Args:
        error_N, zero_N2: independent errors of points (n,), covariance of their zero (n, n).
    """
    mean = (level == np.arange(level.max() + 1)[:, None]) / np.bincount(level)[:, None]
    own_N2 = float(np.mean(np.diag(mean @ (np.diag(error_N**2) + zero_N2) @ mean.T)))
    dof, misfit_N2 = max(len(mean) - len(start), 1), 0.0
    for _ in range(MISFIT_ITERATIONS):
        sd = np.sqrt(error_N**2 + np.diag(zero_N2) + misfit_N2)
        solved = solve_weighted(lambda values, sd=sd: residuals_N(values) / sd, start)  # type: ignore[misc]
        residual_N2 = float(np.sum((mean @ residuals_N(solved.values)) ** 2)) / dof
        misfit_N2 = max(residual_N2 - own_N2, 0.0)
    gain = np.linalg.pinv(solved.jacobian) / sd
    shared = misfit_N2 * (level[:, None] == level)
    covariance = gain @ (np.diag(solved.birge * error_N**2) + zero_N2 + shared) @ gain.T
    return solved._replace(covariance=covariance, dof=dof), sqrt(residual_N2)


def choose_law(
    speed_rad_s: Array, thrust_N: Array, error_N: Array, zero_N2: Array, scale_sd: float,
    level: IntArray,
) -> tuple[ThrustLaw, ThrustLaw]:  # fmt: skip
    """Return the law that the data support, and the law with a free exponent.

    Each level is held out once. The simplest law is selected whose mean squared prediction error is
    within one standard error (of the difference) of the best one (Hastie, Tibshirani and Friedman,
    The Elements of Statistical Learning, 2009, 7.10).
    `scale_sd` is the relative standard uncertainty of the load cell's scale.
    """
    middle = float(np.exp(np.log(speed_rad_s).mean()))
    x, error = speed_rad_s / middle, np.sqrt(error_N**2 + np.diag(zero_N2))
    start = np.array([np.median(thrust_N / x**2), max(1e-3, float(error.min())), 2.0])
    counts = np.bincount(level)

    def expand(values: Array, free: list[int]) -> Array:
        law = np.array([0.0, 0.0, 2.0])
        law[free] = values
        return law

    def residuals(values: Array, free: list[int], rows: Any = slice(None)) -> Array:
        scale, zero, power = expand(values, free)
        return np.asarray(scale * x[rows] ** power + zero - thrust_N[rows], float)

    def held_out(free: list[int], number: int) -> float:
        test, others = level == number, level != number
        solved = solve_weighted(lambda v: residuals(v, free, others) / error[others], start[free])
        return float(np.mean((residuals(solved.values, free, test) / error[test]) ** 2))

    losses = {n: np.array([held_out(f, i) for i in range(len(counts))]) for n, f in LAWS.items()}
    best = min(losses.values(), key=lambda loss: float(loss.mean()))

    excess = {name: loss - best for name, loss in losses.items()}
    is_supported = (loss.mean() <= loss.std(ddof=1) / sqrt(len(loss)) for loss in excess.values())
    chosen = next(name for name, supported in zip(LAWS, is_supported, strict=True) if supported)

    def law(name: str) -> ThrustLaw:
        free = LAWS[name]
        solved, residual_N = solve_levels(
            lambda values: residuals(values, free), error_N, zero_N2, level, start[free]
        )
        scale, zero, power = (float(value) for value in expand(solved.values, free))
        covariance = scale_sd**2 * np.outer((scale, zero, 0.0), (scale, zero, 0.0))
        covariance[np.ix_(free, free)] += solved.covariance
        return ThrustLaw(
            name=name, values=(scale, zero, power), middle_rad_s=middle, covariance=covariance,
            dof=solved.dof, residual_N=residual_N,
            level_speed_rad_s=np.sqrt(np.bincount(level, speed_rad_s**2) / counts),
            level_thrust_N=np.bincount(level, thrust_N) / counts,
            scores={name: float(loss.mean()) for name, loss in losses.items()},
        )  # fmt: skip

    return law(chosen), law("c w^n")
