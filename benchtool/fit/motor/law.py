"""Laws of a motor: thrust over speed, selected by cross-validation, and speed after a step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from benchtool.core.fit_result import Estimate
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.data.columns import speed_columns
from benchtool.fit.problem import IntArray
from benchtool.fit.statistics import half_widths

# Indices of the free parameters among (scale, T_0, n) by law, the simplest first.
LAWS = {"k w^2": [0], "k w^2 + T_0": [0, 1], "c w^n": [0, 2]}
MAX_LEVELS = 12  # adjacent pulse widths are merged to this many levels; assumed
MISFIT_ITERATIONS = 6  # of weights with the misfit; assumed
MIN_STEP_US = 20.0  # minimum change of pulse width within one sample; assumed
FIT_WINDOW_S = 0.6  # ten times a typical lag, before the voltage sags; assumed


class Solution(NamedTuple):
    """Solution, its covariance inflated by the squared Birge ratio, and degrees of freedom."""

    values: Array
    covariance: Array
    dof: int
    birge: float  # squared, at least 1
    jacobian: Array


def solve_weighted(residuals: Callable[[Array], Array], start: Sequence[float] | Array) -> Solution:
    """Return the least-squares solution of weighted residuals, with the Birge ratio applied."""
    solution = least_squares(residuals, np.asarray(start, float), x_scale=np.abs(start))
    dof = len(solution.fun) - len(solution.x)
    birge = max(1.0, 2.0 * solution.cost / dof) if dof > 0 else 1.0
    jacobian = np.asarray(solution.jac, float)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * birge
    return Solution(np.asarray(solution.x, float), covariance, max(dof, 1), birge, jacobian)


def t_estimate(name: str, unit: str, value: float, sd: float, dof: int, note: str = "") -> Estimate:
    """Return an estimate with intervals from Student's t."""
    interval_68, interval_95 = ((value - w * sd, value + w * sd) for w in half_widths(dof))
    return Estimate(name, unit, value, sd, interval_68, interval_95, note)


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
        )  # fmt: skip

    return law(chosen), law("c w^n")


@dataclass(frozen=True, slots=True, eq=False)
class StepResponse:
    """Speed after one step: time since the step (n,) s, speed (n,) rad/s, and its fit.

    Attributes:
        seen_lag_s: observed time constant of the speed.
        lag_s: time constant at constant voltage. A voltage sag dV during a step from w_0 to w_1
            lowers the final speed; to first order the observed response is faster by the factor
            1 + (w_1 / (w_1 - w_0)) (dV / V). Equal to seen_lag_s without measured voltage.
    """

    up: bool
    time_s: Array
    speed_rad_s: Array
    before_rad_s: float
    after_rad_s: float
    seen_lag_s: float
    lag_s: float
    delay_s: float


def column_or_nan(recording: Recording, name: str) -> Array:
    """Return a column (n,); nan if the recording lacks it."""
    return recording.column(name) if name in recording else np.full(len(recording), np.nan)


def step_responses(samples: Recording, rig: Rig) -> tuple[StepResponse, ...]:
    """Return the fitted responses to all steps between two throttles with turning rotors.

    Mean speed of the turning rotors; without tachometers the square root of thrust.
    """
    names = speed_columns(samples.names, "pwm")
    if not names:
        return ()
    pulses = np.stack([samples.column(name) for name in names])
    rotors = np.flatnonzero(np.nanmax(pulses, axis=1) > rig.propulsion.pwm_start_us)
    if not len(rotors):
        return ()
    level, time_s = pulses[rotors[0]], samples.column("time_s")
    voltage = column_or_nan(samples, "voltage_V")
    speeds = [column_or_nan(samples, f"rpm{rotor + 1}") * pi / 30.0 for rotor in rotors]
    signal = np.mean(speeds, axis=0)
    if not np.isfinite(signal).any():
        signal = np.sqrt(np.maximum(column_or_nan(samples, "thrust_N"), 0.0))
    changes = np.flatnonzero(np.abs(np.diff(level)) > 0.0) + 1
    responses = []
    for number, index in enumerate(changes):
        before_us, after_us = level[index - 1], level[index]
        if abs(after_us - before_us) < MIN_STEP_US:
            continue
        if min(before_us, after_us) <= rig.propulsion.pwm_start_us:
            continue
        last = changes[number - 1] if number else 0
        until = changes[number + 1] if number + 1 < len(changes) else len(level)
        zero_s = time_s[index - 1]
        before = (time_s > zero_s - FIT_WINDOW_S) & (np.arange(len(level)) < index)
        before[:last] = False
        after = (time_s <= zero_s + FIT_WINDOW_S) & (np.arange(len(level)) >= index)
        after[until:] = False
        after &= np.isfinite(signal)
        before &= np.isfinite(signal)
        if after.sum() < 12 or before.sum() < 4 or time_s[after][-1] - zero_s < 0.5 * FIT_WINDOW_S:
            continue
        late = after & (time_s > zero_s + 0.5 * FIT_WINDOW_S)
        sag = 1.0 - _mean(voltage[late]) / _mean(voltage[before])
        responses.append(
            _response(
                bool(after_us > before_us),
                time_s[after] - zero_s,
                signal[after],
                float(signal[before].mean()),
                sag if np.isfinite(sag) else 0.0,
            )
        )
    return tuple(responses)


def _response(up: bool, time_s: Array, speed: Array, before: float, sag: float) -> StepResponse:
    """Return one step with fitted lag, dead time and final speed."""
    tail = float(speed[time_s > 0.7 * time_s[-1]].mean())
    scale = max(abs(tail - before), 1e-9)

    def residuals(values: Array) -> Array:
        lag, delay, after = values
        share = np.where(time_s > delay, np.exp(-(time_s - delay) / max(lag, 1e-4)), 1.0)
        return np.asarray((after + (before - after) * share - speed) / scale, float)

    solved = solve_weighted(residuals, (0.06, 0.002, tail))
    lag, delay, after = solved.values
    at_constant = float(lag * (1.0 + sag * after / (after - before)))
    return StepResponse(
        up, time_s, speed, before, float(after), float(lag), at_constant, float(delay)
    )


def _mean(values: Array) -> float:
    present = values[np.isfinite(values)]
    return float(present.mean()) if len(present) else float("nan")


def step_lags(steps: Sequence[StepResponse]) -> list[Estimate]:
    """Return mean lag and dead time over the steps up and down."""
    estimates = []
    for name, up in (("up", True), ("down", False)):
        selected = [step for step in steps if step.up is up]
        if len(selected) < 2:
            continue
        for quantity in ("lag", "delay"):
            values = np.array([getattr(step, f"{quantity}_s") for step in selected])
            sd = float(values.std(ddof=1)) / sqrt(len(values))
            if quantity == "lag":
                # Sag is not linear in speed: the correction has a rectangular uncertainty of half
                # width equal to itself (JCGM 100:2008, 4.3.7).
                corrected = [step.lag_s - step.seen_lag_s for step in selected]
                sd = float(np.hypot(sd, np.mean(corrected) / sqrt(3.0)))
            mean = float(values.mean())
            estimates.append(t_estimate(f"{quantity}_{name}", "s", mean, sd, len(values) - 1))
    return estimates
