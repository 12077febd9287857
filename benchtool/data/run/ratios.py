"""T_IGE/T_OGE of every visit of a run: thrust over that of its out-of-ground-effect references."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.channel import channel_family, error_channel_name
from benchtool.core.error_source import ErrorSource, UncertainValues
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig, Sensor
from benchtool.data.columns import speed_columns, word_to_code

RATIO_BASES: tuple[str, ...] = ("equal_rpm2", "equal_pwm", "equal_power")  # held equal
MOMENTUM_POWER = 2.0 / 3.0  # T^(3/2) ~ P in hover; used where references have one power
EXPONENT_SD = 0.05  # stands show 0.6 to 0.75 for electrical power; assumed
VOLTAGE_POWER, VOLTAGE_POWER_SD = 2.0, 0.25  # 1.5 to 2, less with windings; assumed


@dataclass(frozen=True, slots=True, eq=False)
class Ratios(UncertainValues):
    """Hold T_IGE/T_OGE of every visit; nan where a visit has no reference."""

    share: Array  # (n, n) by how much each other visit makes a visit's T_OGE: 1 over their number
    by_thrust: Array  # (n, n) change of each ratio by that of each thrust, to first order: 1/N


def ratios(points: Recording, basis: str, rig: Rig | None = None) -> Ratios:
    """Return T_IGE/T_OGE of every visit, with what its errors share.

    A visit is compared with the references of the same pulses and the same repeat, or with the
    mean of those of the same pulses where its repeat has none. At equal pulse width thrusts are
    divided, at equal squared speed thrusts over the summed squared speeds, and at equal
    electrical power thrust over the references' thrust at that power, a power law between them.

    With a rig whose controllers do not hold the speed, thrusts at equal pulse width are brought to
    the voltage of their references where voltage is measured: a pack that empties from visit to
    visit is no ground effect.

    Errors are relative and small, so that products are taken to first order (a mean of references
    known to 1 % is inverted 0.01 % too large). Every reference is one column of the source
    "reference": ratios over the same reference err together, and so do those at one power law that
    was fitted to all of them.

    Args:
        points: visits with `kind`, `repeat`, pulses, speeds, thrust; voltage and current for power.
        basis: one of `RATIO_BASES`.
        rig: of the points; its sensors say how far voltage and current are off where points do not.
    """
    if basis not in RATIO_BASES:
        raise UnknownChoice("basis", basis, RATIO_BASES)
    if "kind" not in points:
        raise InputError(
            "thrust ratios need points of kind 'reference' (plate parked, out of ground effect); "
            "fit with --basis joint, or sweep with references"
        )
    thrust = points.column("thrust_N")
    parked = points.column("kind") == word_to_code("kind", "reference")
    if not parked.any():
        raise InputError(
            "the run holds no reference points out of ground effect, so there is no T_OGE to "
            "divide by; fit with --basis joint, or sweep with references"
        )
    relative, level = _relative_error(points, thrust), thrust
    law: _PowerLaw | None = None
    sensors = {} if rig is None else rig.sensors
    if basis == "equal_rpm2":
        relative = np.hypot(relative, relative_speed_error(points))
        level = thrust / _squared_speed(points)
    elif basis == "equal_power":
        law = _power_law(points, thrust, parked)
        electrical = _relative_error_of(points, ("voltage_V", "current_A"), sensors)
    elif rig is not None and not (rig.motor and rig.motor.governed) and _has(points, "voltage_V"):
        voltage = points.column("voltage_V")
        log_voltage = np.log(np.where(voltage > 0.0, voltage, np.nan))
        law = _PowerLaw(
            "voltage", log_voltage, VOLTAGE_POWER, np.zeros(len(points)), VOLTAGE_POWER_SD
        )
        electrical = _relative_error_of(points, ("voltage_V",), sensors)
    if law is not None:
        relative = np.hypot(relative, law.exponent * electrical)
        level = thrust / np.exp(law.exponent * law.log_x)
    share = _shares(points, parked, level)
    mean = np.where(share.any(axis=1), share @ np.nan_to_num(level), np.nan)
    ratio = level / mean
    # The part of each reference in the logarithm of the ratio, to first order.
    part = np.nan_to_num(share * level / mean[:, None])
    stated = bool(np.isfinite(relative).any())
    scatter = np.nan_to_num(relative) if stated else np.ones(len(ratio))
    sources = []
    if law is not None:
        lever = np.nan_to_num(law.log_x - part @ np.nan_to_num(law.log_x))
        part += np.outer(lever, law.gain)
        if law.exponent_sd > 0.0:
            columns = -np.nan_to_num(ratio * lever)[:, None] * law.exponent_sd
            sources.append(
                ErrorSource(
                    name=f"exponent of {law.name}",
                    kind="B",
                    unit="1",
                    sd=law.exponent_sd,
                    columns=columns,
                )
            )
    shown = np.flatnonzero(parked)
    reference = ErrorSource(
        name="reference",
        kind="A",
        unit="1",
        sd=float(np.sqrt(np.mean(scatter[shown] ** 2))),
        columns=-np.nan_to_num(ratio)[:, None] * part[:, shown] * scatter[shown],
        scaled=True,
    )
    own = np.abs(ratio) * relative if stated else np.full(len(ratio), np.nan)
    by_log = np.nan_to_num(ratio)[:, None] * (np.eye(len(ratio)) - part)
    by_thrust = by_log / np.where(thrust > 0.0, thrust, np.inf)
    return Ratios(ratio, own, (reference, *sources), share, by_thrust)


def _shares(points: Recording, parked: NDArray[np.bool_], level: Array) -> Array:
    """Return `Ratios.share`: of references of the same pulses (nan from a device without echo)."""
    names, alone = speed_columns(points.names, "pwm"), np.zeros((len(points), 1))
    pulses = _stack(points, names).round(3) if names else alone
    part = points.column("part") if "part" in points else alone[:, 0]  # of a merged run
    repeat = points.column("repeat") if "repeat" in points else alone[:, 0]
    alike = ((pulses[:, None] == pulses) | np.isnan(pulses)).all(axis=2) & parked
    alike &= part[:, None] == part
    paired = alike & (repeat[:, None] == repeat)
    chosen = np.where(paired.any(axis=1)[:, None], paired, alike) & np.isfinite(level)
    out: Array = chosen / np.maximum(chosen.sum(axis=1), 1)[:, None]
    return out


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
        points.to_si(name) if name in points else nothing
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
    thrust = points.to_si("thrust_N")
    return np.hypot(error, thrust * relative_speed_error(points)), bool(of_samples.any())


def ratio_error(points: Recording) -> Array | None:
    """Return the standard error of every ratio that a table gives (n,), None where none is."""
    for name in ("thrust_ratio_se", "thrust_ratio_sd"):
        if _has(points, name):
            return points.column(name)
    return None


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


def _has(points: Recording, name: str) -> bool:
    return name in points and bool(np.isfinite(points.column(name)).any())


def _relative_error_of(
    points: Recording, names: Sequence[str], sensors: Mapping[str, Sensor]
) -> Array:
    """Return the relative standard error of the product of each visit's channels (n,).

    From the channels' standard errors, else from what the rig says of their sensors; 0 where
    neither is known.
    """
    total = np.zeros(len(points))
    for name in names:
        error = standard_error(points, name, sensors)
        total = np.hypot(total, np.nan_to_num(error / points.column(name), posinf=0.0, neginf=0.0))
    return total


def standard_error(points: Recording, name: str, sensors: Mapping[str, Sensor]) -> Array:
    """Return the standard error of each row of a channel (n,); nan where nothing states one.

    The channel's own, else what noise and step of the rig's sensor make of a mean over a visit's
    samples.
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
    """Hold the references' power law, thrust ~ x^exponent."""

    name: str  # of x
    log_x: Array  # (n,) of every visit
    exponent: float
    gain: Array  # (n,) change of the exponent by a visit's error in the logarithm of thrust
    exponent_sd: float  # where it was not fitted; 0 where it was


def _power_law(points: Recording, thrust: Array, parked: NDArray[np.bool_]) -> _PowerLaw:
    for name in ("voltage_V", "current_A"):
        if not _has(points, name):
            raise InputError(
                f"equal electrical power needs voltage_V and current_A, but {name} is not there; "
                f"choose --basis equal_pwm or equal_rpm2"
            )
    power = points.column("voltage_V") * points.column("current_A")
    good = parked & (power > 0.0) & (thrust > 0.0)
    if not good.any():
        raise InputError("no reference point drew any power; check the current sensor")
    log_power = np.log(np.where(power > 0.0, power, np.nan))
    from_mean = np.where(good, log_power - log_power[good].mean(), 0.0)
    if np.ptp(log_power[good]) <= 0.2:
        return _PowerLaw("power", log_power, MOMENTUM_POWER, np.zeros(len(power)), EXPONENT_SD)
    gain = from_mean / float(from_mean @ from_mean)
    exponent = float(gain[good] @ np.log(thrust[good]))
    return _PowerLaw("power", log_power, exponent, gain, 0.0)
