"""Thrust ratios T_IGE/T_OGE of the points of a run over their reference points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import channel_family, error_channel_name
from benchtool.core.error_source import ErrorSource, UncertainValues
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig, Sensor
from benchtool.core.units import Array
from benchtool.data.columns import speed_columns, word_to_code

RATIO_BASES: tuple[str, ...] = ("equal_rpm2", "equal_pwm", "equal_power")  # quantity kept equal
MOMENTUM_POWER = 2.0 / 3.0  # T^(3/2) ~ P in hover; used where references have one power
EXPONENT_SD = 0.05  # 0.6 to 0.75 in test data for electrical power; assumed
VOLTAGE_POWER, VOLTAGE_POWER_SD = 2.0, 0.25  # 1.5 to 2, less with windings; assumed


@dataclass(frozen=True, slots=True, eq=False)
class Ratios(UncertainValues):
    """Thrust ratio T_IGE/T_OGE of each point; nan if a point has no reference."""

    reference_weights: Array  # (n, n) of each point (column) in the T_OGE of each point (row)
    thrust_jacobian: Array  # (n, n) derivative of each ratio (row) by each thrust (column): 1/N


def ratios(points: Recording, basis: str, rig: Rig | None = None) -> Ratios:
    """Return T_IGE/T_OGE of each point, with independent and shared errors.

    The references of a point are those of the same pulse widths and the same repeat, or all of the
    same pulse widths if its repeat has none. At equal pulse width, the ratio is that of thrusts; at
    equal squared speed, that of thrusts over the sum of squared speeds; at equal electrical power,
    thrust over the references' thrust at that power, by a power law between them.

    If the rig's controllers do not govern the speed and voltage is measured, thrusts at equal pulse
    width are corrected to the voltage of their references, which removes voltage sag.

    Errors are relative and small, so products are of first order (the inverse of a mean of
    references known to 1 % is 0.01 % too large). Each reference is one column of the source
    "reference", so the errors of ratios over the same reference are correlated, as are those at a
    power law fitted to all references.

    Args:
        points: with `kind`, `repeat`, pulse widths, speeds, thrust; voltage and current for power.
        rig: of the points; its sensors are the fallback for errors of voltage and current.
    """
    if basis not in RATIO_BASES:
        raise UnknownChoice("basis", basis, RATIO_BASES)
    if "kind" not in points:
        raise InputError(
            "thrust ratios need points of kind 'reference' (plate parked, out of ground effect); "
            "use --basis joint or a sweep with references"
        )
    thrust = points.column("thrust_N")
    is_reference = points.column("kind") == word_to_code("kind", "reference")
    if not is_reference.any():
        raise InputError(
            "no reference points out of ground effect, needed for T_IGE/T_OGE; use --basis joint "
            "or a sweep with references"
        )
    relative_se, level = np.full(len(thrust), np.nan), thrust
    if "thrust_se_N" in points:
        relative_se = points.column("thrust_se_N") / np.abs(thrust)
    law: _PowerLaw | None = None
    sensors = {} if rig is None else rig.sensors
    if basis == "equal_rpm2":
        relative_se = np.hypot(relative_se, relative_speed_error(points))
        level = thrust / _squared_speed(points)
    elif basis == "equal_power":
        law = _fit_power_law(points, thrust, is_reference)
        electrical_se = _relative_product_error(points, ("voltage_V", "current_A"), sensors)
    elif rig is not None and not (rig.motor and rig.motor.governed) and _has(points, "voltage_V"):
        voltage = points.column("voltage_V")
        log_voltage = np.log(np.where(voltage > 0.0, voltage, np.nan))
        law = _PowerLaw(
            "voltage", log_voltage, VOLTAGE_POWER, np.zeros(len(points)), VOLTAGE_POWER_SD
        )
        electrical_se = _relative_product_error(points, ("voltage_V",), sensors)
    if law is not None:
        relative_se = np.hypot(relative_se, law.exponent * electrical_se)
        level = thrust / np.exp(law.exponent * law.log_x)
    weights = _reference_weights(points, is_reference, level)
    mean = np.where(weights.any(axis=1), weights @ np.nan_to_num(level), np.nan)
    ratio = level / mean
    # Negative derivative of each log ratio by the log of each reference, to first order.
    log_slopes = np.nan_to_num(weights * level / mean[:, None])
    has_errors = bool(np.isfinite(relative_se).any())
    scatter = np.nan_to_num(relative_se) if has_errors else np.ones(len(ratio))
    sources = []
    if law is not None:
        log_distance = np.nan_to_num(law.log_x - log_slopes @ np.nan_to_num(law.log_x))
        log_slopes += np.outer(log_distance, law.gain)
        if law.exponent_sd > 0.0:
            name, sd = f"exponent of {law.name}", law.exponent_sd
            columns = -np.nan_to_num(ratio * log_distance)[:, None] * sd
            sources.append(ErrorSource(name=name, kind="B", unit="1", sd=sd, columns=columns))
    references = np.flatnonzero(is_reference)
    reference = ErrorSource(
        name="reference",
        kind="A",
        unit="1",
        sd=float(np.sqrt(np.mean(scatter[references] ** 2))),
        columns=-np.nan_to_num(ratio)[:, None] * log_slopes[:, references] * scatter[references],
        scaled=True,
    )
    ratio_se = np.abs(ratio) * relative_se if has_errors else np.full(len(ratio), np.nan)
    log_jacobian = np.nan_to_num(ratio)[:, None] * (np.eye(len(ratio)) - log_slopes)
    jacobian = log_jacobian / np.where(thrust > 0.0, thrust, np.inf)
    return Ratios(ratio, ratio_se, (reference, *sources), weights, jacobian)


def _reference_weights(points: Recording, is_reference: NDArray[np.bool_], level: Array) -> Array:
    """Return the weight (n, n) of each reference in each T_OGE; nan pulse widths match all."""
    names, zeros = speed_columns(points.names, "pwm"), np.zeros((len(points), 1))
    pwm_us = _stack(points, names).round(3) if names else zeros
    part = points.column("part") if "part" in points else zeros[:, 0]  # of a merged run
    repeat = points.column("repeat") if "repeat" in points else zeros[:, 0]
    same_pwm = ((pwm_us[:, None] == pwm_us) | np.isnan(pwm_us)).all(axis=2) & is_reference
    same_pwm &= part[:, None] == part
    same_repeat = same_pwm & (repeat[:, None] == repeat)
    used = np.where(same_repeat.any(axis=1)[:, None], same_repeat, same_pwm) & np.isfinite(level)
    weights: Array = used / np.maximum(used.sum(axis=1), 1)[:, None]
    return weights


def _squared_speed(points: Recording) -> Array:
    speeds = _stack(points, speed_columns(points.names, "rpm"))
    squared = np.nansum(speeds**2, axis=1)
    squared[np.isnan(speeds).all(axis=1) | (squared == 0.0)] = np.nan
    return np.asarray(squared, float)


def thrust_error(points: Recording) -> tuple[Array, bool] | None:
    """Return the standard error of each thrust (n,) in N, None if the table has none.

    `thrust_se_N` is used as it is. Without it, `thrust_sd_N` and `n_samples` give sd sqrt(g/n), g
    being the statistical inefficiency (autocorrelation), from the rows with both errors, else 1.
    `thrust_sd_N` alone is used as the standard error. Errors of speeds are added
    (`relative_speed_error`).

    Returns:
        The errors, and whether some derive from samples within a point, which do not include the
        variation between points.
    """
    missing = np.full(len(points), np.nan)
    thrust_se, sd, n = (
        points.to_si(name) if name in points else missing
        for name in ("thrust_se_N", "thrust_sd_N", "n_samples")
    )
    is_from_samples = np.isnan(thrust_se) & np.isfinite(sd) & (n >= 1.0)
    if is_from_samples.any():
        inefficiencies = (thrust_se / sd) ** 2 * n
        inefficiencies = inefficiencies[np.isfinite(inefficiencies)]
        inefficiency = max(float(np.median(inefficiencies)), 1.0) if inefficiencies.size else 1.0
        thrust_se = np.where(is_from_samples, sd * np.sqrt(inefficiency / n), thrust_se)
    elif not np.isfinite(thrust_se).any():
        thrust_se = sd
    if not np.isfinite(thrust_se).any():
        return None
    thrust = points.to_si("thrust_N")
    total_se = np.hypot(thrust_se, thrust * relative_speed_error(points))
    return total_se, bool(is_from_samples.any())


def ratio_error(points: Recording) -> Array | None:
    """Return the standard error of each ratio in a table (n,), None if it has none."""
    for name in ("thrust_ratio_se", "thrust_ratio_sd"):
        if _has(points, name):
            return points.column(name)
    return None


def relative_speed_error(points: Recording) -> Array:
    """Return the relative standard error (n,) of the sum of squared speeds w.

    2 sqrt(sum (w se)^2) over sum w^2; 0 if the points have no errors of speeds.
    """
    names = speed_columns(points.names, "rpm")
    if not names or any(f"{name}_se" not in points for name in names):
        return np.zeros(len(points))
    errors = np.nan_to_num(_stack(points, [f"{name}_se" for name in names]))
    speeds = np.nan_to_num(_stack(points, names))
    squared = np.sum(speeds**2, axis=1)
    squared_se = 2.0 * np.sqrt(np.sum((speeds * errors) ** 2, axis=1))
    relative: Array = np.divide(squared_se, squared, out=np.zeros(len(points)), where=squared > 0.0)
    return relative


def _stack(points: Recording, names: list[str]) -> Array:
    return np.column_stack([points.column(name) for name in names])


def _has(points: Recording, name: str) -> bool:
    return name in points and bool(np.isfinite(points.column(name)).any())


def _relative_product_error(
    points: Recording, names: Sequence[str], sensors: Mapping[str, Sensor]
) -> Array:
    """Return the relative standard error (n,) of the product of channels; unknown errors are 0."""
    total = np.zeros(len(points))
    for name in names:
        error = standard_error(points, name, sensors)
        total = np.hypot(total, np.nan_to_num(error / points.column(name), posinf=0.0, neginf=0.0))
    return total


def standard_error(points: Recording, name: str, sensors: Mapping[str, Sensor]) -> Array:
    """Return the standard error (n,) of a channel; nan if unknown.

    Falls back from the channel's error column to the error of a mean over the samples of a point,
    from noise and resolution of the rig's sensor.
    """
    error = np.full(len(points), np.nan)
    if error_channel_name(name) in points:
        error = points.column(error_channel_name(name))
    if (sensor := sensors.get(channel_family(name))) is not None:
        n = points.column("n_samples") if "n_samples" in points else np.ones(len(points))
        error = np.where(np.isnan(error), sensor.mean_error(n), error)
    return error


@dataclass(frozen=True, slots=True, eq=False)
class _PowerLaw:
    """Power law of the references, thrust ~ x^exponent."""

    name: str  # of x
    log_x: Array  # (n,)
    exponent: float
    gain: Array  # (n,) derivative of the exponent by the log thrust of each point
    exponent_sd: float  # of an assumed exponent; 0 if fitted


def _fit_power_law(points: Recording, thrust: Array, is_reference: NDArray[np.bool_]) -> _PowerLaw:
    for name in ("voltage_V", "current_A"):
        if not _has(points, name):
            raise InputError(
                f"channel {name} is missing, needed for equal electrical power; "
                f"use --basis equal_pwm or equal_rpm2"
            )
    power = points.column("voltage_V") * points.column("current_A")
    is_valid = is_reference & (power > 0.0) & (thrust > 0.0)
    if not is_valid.any():
        raise InputError("no reference point has positive power; check the current sensor")
    log_power = np.log(np.where(power > 0.0, power, np.nan))
    centred = np.where(is_valid, log_power - log_power[is_valid].mean(), 0.0)
    if np.ptp(log_power[is_valid]) <= 0.2:
        return _PowerLaw("power", log_power, MOMENTUM_POWER, np.zeros(len(power)), EXPONENT_SD)
    gain = centred / float(centred @ centred)
    exponent = float(gain[is_valid] @ np.log(thrust[is_valid]))
    return _PowerLaw("power", log_power, exponent, gain, 0.0)
