"""T_IGE/T_OGE of every visit of a run: thrust over that of its out-of-ground-effect references."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.recording import Recording
from benchtool.data.columns import code_of, speed_columns

RATIO_BASES: tuple[str, ...] = ("equal_rpm2", "equal_pwm", "equal_power")
"""What is held equal between a visit and its references."""

MOMENTUM_POWER = 2.0 / 3.0
"""Exponent of thrust over power in hover by momentum theory (T^(3/2) ~ P); used where the
references stand at one power only."""


def ratios(points: Recording, basis: str) -> tuple[Array, Array]:
    """Return T_IGE/T_OGE (n,) and its standard error (n,); nan where a visit has no reference.

    A visit is compared with the references of the same pulses and the same repeat, or with the
    mean of those of the same pulses where its repeat has none. At equal pulse width thrusts are
    divided, at equal squared speed thrusts over the summed squared speeds, and at equal
    electrical power thrust over the references' thrust at that power, a power law between them.

    Args:
        points: visits with `kind`, `repeat`, pulses, speeds, thrust; voltage and current for power.
        basis: one of `RATIO_BASES`.
    """
    if basis not in RATIO_BASES:
        raise UnknownChoice("basis", basis, RATIO_BASES)
    if "kind" not in points:
        raise InputError(
            "thrust ratios need points of kind 'reference' (plate parked, out of ground effect); "
            "fit with --basis joint, or sweep with references"
        )
    thrust = points.column("thrust_N")
    parked = points.column("kind") == code_of("kind", "reference")
    if not parked.any():
        raise InputError(
            "the run holds no reference points out of ground effect, so there is no T_OGE to "
            "divide by; fit with --basis joint, or sweep with references"
        )
    relative = _relative_error(points, thrust)
    if basis == "equal_rpm2":
        relative = np.hypot(relative, relative_speed_error(points))
    chosen = [_references(points, parked, row) for row in range(len(points))]
    if basis == "equal_power":
        level = thrust / _thrust_at_power(points, thrust, parked)
    elif basis == "equal_rpm2":
        level = thrust / _squared_speed(points)
    else:
        level = thrust
    ratio, error = np.full(len(thrust), np.nan), np.full(len(thrust), np.nan)
    for row, rows in enumerate(chosen):
        if np.isfinite(level[rows]).any():
            ratio[row] = level[row] / np.nanmean(level[rows])
            own = np.sqrt(np.nansum(relative[rows] ** 2)) / rows.size
            error[row] = ratio[row] * np.hypot(relative[row], own)
    return ratio, error


def _references(points: Recording, parked: NDArray[np.bool_], row: int) -> NDArray[np.intp]:
    """Return the references of one visit: same pulses (a device that does not echo them is nan)."""
    pulses = _stack(points, speed_columns(points.names, "pwm")).round(3)
    alike = parked & ((pulses == pulses[row]) | np.isnan(pulses)).all(axis=1)
    paired = alike & (points.column("repeat") == points.column("repeat")[row])
    return np.flatnonzero(paired if paired.any() else alike)


def _squared_speed(points: Recording) -> Array:
    speeds = _stack(points, speed_columns(points.names, "rpm"))
    squared = np.nansum(speeds**2, axis=1)
    squared[np.isnan(speeds).all(axis=1) | (squared == 0.0)] = np.nan
    return np.asarray(squared, float)


def thrust_error(points: Recording) -> tuple[Array, bool] | None:
    """Return the standard error of every thrust (n,) in N, None where none is stated.

    `thrust_se_N` is one. `thrust_sd_N` beside `n_samples` is the scatter of samples, and that of
    their mean is sd sqrt(g/n): g, what the samples' autocorrelation costs, is that of the rows that
    state both, else 1. `thrust_sd_N` alone counts as the standard error. The speeds' errors are
    taken in (`relative_speed_error`).

    Returns:
        The errors, and whether they are of samples within a visit and so say nothing of what
        differs between visits.
    """
    nothing = np.full(len(points), np.nan)
    error, sd, n = (
        points.si(name) if name in points else nothing
        for name in ("thrust_se_N", "thrust_sd_N", "n_samples")
    )
    of_samples = np.isnan(error) & np.isfinite(sd) & (n >= 1.0)
    if of_samples.any():
        known = (error / sd) ** 2 * n
        known = known[np.isfinite(known)]
        inefficiency = max(float(np.median(known)), 1.0) if known.size else 1.0
        error = np.where(of_samples, sd * np.sqrt(inefficiency / n), error)
    elif not np.isfinite(error).any():
        error = sd
    if not np.isfinite(error).any():
        return None
    thrust = points.si("thrust_N")
    return np.hypot(error, thrust * relative_speed_error(points)), bool(of_samples.any())


def relative_speed_error(points: Recording) -> Array:
    """Return the relative error (n,) that the speeds' errors make in k times the sum of w^2.

    Thrust is compared at measured speeds, and those have errors too: 2 sqrt(sum (w se)^2) over
    sum w^2; 0 where no errors of speed are given.
    """
    names = speed_columns(points.names, "rpm")
    if not names or any(f"{name}_se" not in points for name in names):
        return np.zeros(len(points))
    errors = np.nan_to_num(_stack(points, [f"{name}_se" for name in names]))
    speeds = np.nan_to_num(_stack(points, names))
    squared = np.sum(speeds**2, axis=1)
    spread = 2.0 * np.sqrt(np.sum((speeds * errors) ** 2, axis=1))
    out: Array = np.divide(spread, squared, out=np.zeros(len(points)), where=squared > 0.0)
    return out


def _stack(points: Recording, names: list[str]) -> Array:
    return np.column_stack([points.column(name) for name in names])


def _relative_error(points: Recording, thrust: Array) -> Array:
    if "thrust_se_N" not in points:
        return np.full(len(thrust), np.nan)
    return points.column("thrust_se_N") / np.abs(thrust)


def _thrust_at_power(points: Recording, thrust: Array, parked: NDArray[np.bool_]) -> Array:
    """Return the thrust that the references give at each visit's electrical power (n,): N."""
    for name in ("voltage_V", "current_A"):
        if name not in points or not np.isfinite(points.column(name)).any():
            raise InputError(
                f"equal electrical power needs voltage_V and current_A, but {name} is not there; "
                f"choose --basis equal_pwm or equal_rpm2"
            )
    power = points.column("voltage_V") * points.column("current_A")
    good = parked & (power > 0.0) & (thrust > 0.0)
    if not good.any():
        raise InputError("no reference point drew any power; check the current sensor")
    x, y = np.log(power[good]), np.log(thrust[good])
    slope = float(np.polyfit(x, y, 1)[0]) if np.ptp(x) > 0.2 else MOMENTUM_POWER
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.exp(y.mean() + slope * (np.log(power) - x.mean())), float)
