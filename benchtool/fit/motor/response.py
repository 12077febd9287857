"""Step response of rotor speed: first-order lag with dead time, up and down separately."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi, sqrt
from typing import NamedTuple

import numpy as np

from benchtool.core.fit_result import Estimate
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.data.columns import speed_columns
from benchtool.fit.interval import half_widths

MIN_STEP_US = 20.0  # minimum change of pulse width within one sample; assumed
FIT_WINDOW_S = 0.6  # ten times a typical lag, before the voltage sags; assumed


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


class Solution(NamedTuple):
    """Solution, its covariance inflated by the squared Birge ratio, and degrees of freedom."""

    values: Array
    covariance: Array
    dof: int
    birge: float  # squared, at least 1
    jacobian: Array


def solve_weighted(residuals: Callable[[Array], Array], start: Sequence[float] | Array) -> Solution:
    """Return the least-squares solution of weighted residuals, with the Birge ratio applied."""
    from scipy.optimize import least_squares

    solution = least_squares(residuals, np.asarray(start, float), x_scale=np.abs(start))
    dof = len(solution.fun) - len(solution.x)
    birge = max(1.0, 2.0 * solution.cost / dof) if dof > 0 else 1.0
    jacobian = np.asarray(solution.jac, float)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * birge
    return Solution(np.asarray(solution.x, float), covariance, max(dof, 1), birge, jacobian)


def t_estimate(
    name: str, unit: str, value: float, sd: float, dof: int, open_: str = "", note: str = ""
) -> Estimate:
    """Return an estimate with intervals from Student's t."""
    interval_68, interval_95 = ((value - w * sd, value + w * sd) for w in half_widths(dof))
    return Estimate(name, unit, value, sd, interval_68, interval_95, note, open_)


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
