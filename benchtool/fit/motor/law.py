"""Law of thrust over rotor speed, chosen on held-out throttle levels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.fit.motor.response import Solved, solve_weighted

LAWS = {"k w^2": (0,), "k w^2 + T_0": (0, 1), "c w^n": (0, 2)}
"""Free ones of (scale, T_0, n) by law, the simplest first."""

MAX_LEVELS = 12  # adjacent pulses are joined to this many levels; assumed

MISFIT_ITERATIONS = 6  # of weights with the misfit; assumed

MIN_THRUST_SHARE = 0.1  # of the highest thrust, from which the best single k is stated; assumed

IntArray = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ThrustLaw:
    """Thrust of one rotor over its speed w: scale (w / middle)^n + T_0.

    Attributes:
        name: a key of `LAWS`.
        covariance: of scale, T_0 and n (3, 3), 0 for those that the law lacks.
        speed_rad_s: lowest and highest level.
        scores: mean squared error of held-out levels by law, in squared standard errors.
    """

    name: str
    scale_N: float
    zero_N: float
    exponent: float
    middle_rad_s: float
    covariance: Array
    dof: int
    misfit_N: float  # standard deviation of level means about the law, beyond their errors
    speed_rad_s: tuple[float, float]
    level_speed_rad_s: Array  # (m,), root mean square
    level_thrust_N: Array  # (m,)
    scores: dict[str, float]

    def thrust_N(self, speed_rad_s: Any) -> Any:
        """Return the thrust of one rotor, not below 0: N."""
        x = np.asarray(speed_rad_s, float) / self.middle_rad_s
        return np.maximum(self.scale_N * x**self.exponent + self.zero_N, 0.0)

    def speed_at(self, thrust_N: float, scale_sd: float = 0.0) -> tuple[float, float]:
        """Return the speed of a thrust and its standard uncertainty: rad/s.

        Args:
            scale_sd: relative standard uncertainty of the load cell's scale.
        """
        power = max(thrust_N - self.zero_N, 1e-9 * self.scale_N) / self.scale_N
        x = float(power ** (1.0 / self.exponent))
        way = np.array([power, 1.0, self.scale_N * power * np.log(x)])
        own = way @ self.covariance @ way + self.misfit_N**2
        slope = self.exponent * self.scale_N * power / (x * self.middle_rad_s)
        return x * self.middle_rad_s, sqrt(own + (scale_sd * thrust_N) ** 2) / slope

    @property
    def coefficient(self) -> float:
        """The c of c w^n, k where n is 2: N/(rad/s)^n."""
        return float(self.scale_N / self.middle_rad_s**self.exponent)

    @property
    def _upper(self) -> NDArray[np.bool_]:
        least = MIN_THRUST_SHARE * self.level_thrust_N.max()
        return np.asarray(self.level_thrust_N >= least, bool)

    @property
    def k_speed_rad_s(self) -> tuple[float, float]:
        """Lowest and highest speed for which the single k is the best."""
        speed = self.level_speed_rad_s[self._upper]
        return float(speed.min()), float(speed.max())

    @property
    def k(self) -> float:
        """The law's own k, else that of k w^2 with the smallest largest relative error.

        Over `k_speed_rad_s`, in which T / w^2 is monotonic: k lies between its two ends.
        """
        if self.name == "k w^2":
            return self.coefficient
        ends = np.array(self.k_speed_rad_s)
        low, high = self.thrust_N(ends) / ends**2
        return float(2.0 * low * high / (low + high))

    @property
    def k_error(self) -> float:
        """Largest relative error of k w^2 at the levels over which it is stated."""
        speed, thrust = self.level_speed_rad_s[self._upper], self.level_thrust_N[self._upper]
        return float(np.abs(self.k * speed**2 / thrust - 1.0).max())

    @property
    def k_sd(self) -> float:
        """Standard uncertainty of k; its error counts as rectangular where the law is another."""
        own = self.k * sqrt(self.covariance[0, 0]) / self.scale_N
        error = 0.0 if self.name == "k w^2" else self.k * self.k_error / sqrt(3.0)
        return float(np.hypot(own, error))


def level_numbers(pulse_us: Array) -> IntArray:
    """Return the throttle level of each point (n,), adjacent pulses joined to `MAX_LEVELS`."""
    pulses = np.unique(pulse_us)
    first = [group[0] for group in np.array_split(pulses, min(len(pulses), MAX_LEVELS))]
    return np.asarray(np.searchsorted(first, pulse_us, side="right") - 1, np.intp)


def level_means(values: Array, level: IntArray) -> Array:
    """Return the mean over the points of each level (m,)."""
    return np.asarray(np.bincount(level, values) / np.bincount(level), float)


def solve_levels(
    residuals_N: Callable[[Array], Array],
    error_N: Array,
    zero_N2: Array,
    level: IntArray,
    start: Sequence[float] | Array,
) -> tuple[Solved, float]:
    """Return the weighted solution and the misfit, the standard deviation of level means about it.

    Points of a level share the misfit, so that their number does not reduce it; its variance is the
    excess of that of the level means over their errors (method of moments). Errors of the zero are
    in the covariance, not in the solution: thrusts are as they were measured.

    Args:
        error_N, zero_N2: independent errors of points (n,), covariance of their zero (n, n).
    """
    count = int(level.max()) + 1
    mean = np.zeros((count, len(level)))
    mean[level, np.arange(len(level))] = (1.0 / np.bincount(level))[level]
    own = float(np.mean(np.diag(mean @ (np.diag(error_N**2) + zero_N2) @ mean.T)))
    dof, misfit_N2 = max(count - len(start), 1), 0.0
    for _ in range(MISFIT_ITERATIONS):
        sd = np.sqrt(error_N**2 + np.diag(zero_N2) + misfit_N2)
        solved = solve_weighted(
            lambda values, sd=sd: np.asarray(residuals_N(values) / sd),  # type: ignore[misc]
            start,
        )
        left = mean @ residuals_N(solved.values)
        misfit_N2 = max(float(left @ left) / dof - own, 0.0)
    gain = np.linalg.pinv(solved.jacobian) / sd
    shared = misfit_N2 * (level[:, None] == level)
    covariance = gain @ (np.diag(solved.birge * error_N**2) + zero_N2 + shared) @ gain.T
    return solved._replace(covariance=covariance, dof=dof), sqrt(misfit_N2)


def choose_law(
    speed_rad_s: Array, thrust_N: Array, error_N: Array, zero_N2: Array, level: IntArray
) -> tuple[ThrustLaw, ThrustLaw]:
    """Return the law that the data support, and that with a free exponent.

    Each level is held out once. The law is the simplest whose mean squared error of held-out levels
    is within one standard error of that of the best, the standard error being that of the
    difference (Hastie, Tibshirani and Friedman, The Elements of Statistical Learning, 2009, 7.10).
    """
    middle = float(np.exp(np.log(speed_rad_s).mean()))
    x, error = speed_rad_s / middle, np.sqrt(error_N**2 + np.diag(zero_N2))
    start = np.array([np.median(thrust_N / x**2), max(1e-3, float(error.min())), 2.0])

    def whole(values: Array, free: tuple[int, ...]) -> Array:
        law = np.array([0.0, 0.0, 2.0])
        law[list(free)] = values
        return law

    def left(values: Array, free: tuple[int, ...], rows: Any = slice(None)) -> Array:
        scale, zero, power = whole(values, free)
        return np.asarray(scale * x[rows] ** power + zero - thrust_N[rows], float)

    def held_out(free: tuple[int, ...]) -> Array:
        losses = []
        for number in range(level.max() + 1):
            test, rest = level == number, level != number
            solved = solve_weighted(
                lambda values, rows=rest: left(values, free, rows) / error[rows],  # type: ignore[misc]
                start[list(free)],
            )
            losses.append(np.mean((left(solved.values, free, test) / error[test]) ** 2))
        return np.array(losses)

    losses = {name: held_out(free) for name, free in LAWS.items()}
    best = min(losses.values(), key=lambda loss: float(loss.mean()))

    def supported(loss: Array) -> bool:
        behind = loss - best
        return bool(behind.mean() <= behind.std(ddof=1) / sqrt(len(behind)))

    means = level_means(thrust_N, level)

    def law(name: str) -> ThrustLaw:
        free = LAWS[name]
        solved, misfit_N = solve_levels(
            lambda values: left(values, free), error_N, zero_N2, level, start[list(free)]
        )
        scale, zero, power = whole(solved.values, free)
        covariance = np.zeros((3, 3))
        covariance[np.ix_(free, free)] = solved.covariance
        return ThrustLaw(
            name=name, scale_N=float(scale), zero_N=float(zero), exponent=float(power),
            middle_rad_s=middle, covariance=covariance, dof=solved.dof,
            misfit_N=misfit_N,
            speed_rad_s=(float(speed_rad_s.min()), float(speed_rad_s.max())),
            level_speed_rad_s=np.sqrt(level_means(speed_rad_s**2, level)), level_thrust_N=means,
            scores={each: float(loss.mean()) for each, loss in losses.items()},
        )  # fmt: skip

    return law(next(name for name, loss in losses.items() if supported(loss))), law("c w^n")
