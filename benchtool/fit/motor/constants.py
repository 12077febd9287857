"""Thrust curve and motor constants from tests without a plate: throttle up and down, and steps.

Each law is one weighted least-squares fit. If the points scatter more than their errors, errors are
inflated (Birge ratio: Birge, Phys. Rev. 40 (1932) 207); intervals are Student's t. Per rotor:

- thrust over speed: k w^2, k w^2 + T_0 or c w^n, see `choose_law`,
- speed over pulse: w = s (p - p_0) (V / V_n)^q,
- thrust over throttle: T = T_max ((1 - e) u + e u^2), the form of ArduPilot's MOT_THST_EXPO and
  PX4's THR_MDL_FAC, u from `pwm_start_us` to full throttle, see `FullThrottle`,
- speed after a step: w = w_1 + (w_0 - w_1) exp(-(t - d) / tau), up and down separately.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from benchtool.core.errors import EstimationError, InputError, check_number
from benchtool.core.fit_result import Estimate
from benchtool.core.rig import Propeller, Rig
from benchtool.core.text import pluralize
from benchtool.core.units import STANDARD_GRAVITY_M_S2, Array
from benchtool.fit.motor.law import (
    Solution,
    StepResponse,
    ThrustLaw,
    choose_law,
    level_numbers,
    solve_levels,
    solve_weighted,
    step_lags,
    t_estimate,
)
from benchtool.fit.motor.runs import MotorData, ThrottlePoints, concatenate_points, read_motor_data

MIN_LEVELS = 4  # throttle levels of a curve: one more than its parameters; assumed
MAX_EXPONENT_SD = 0.25  # above it the voltage exponent is set to 1 with this sd; assumed
MIN_THRUST_SHARE = 0.1  # lower end of the range of a single k, relative to max thrust; assumed
MAX_OVER_VOLTAGE, MAX_OVER_COMMAND = 0.15, 0.10  # extrapolation without --extrapolate; assumed


class FullThrottle(NamedTuple):
    """Pulse width and voltage at throttle 1: from the rig unless extrapolated too far."""

    pulse_us: float  # fallback: the highest measured one
    voltage_V: float  # nan: no correction to the nominal voltage
    measured_V: float  # mean at the highest measured pulse width; nan if not measured
    note: str  # pulse width, voltage, extrapolations done and rejected

    @classmethod
    def of(cls, p: ThrottlePoints, rig: Rig, extrapolate: bool) -> FullThrottle:
        """Return full throttle; the limits of extrapolation apply unless `extrapolate` is set."""
        propulsion, pulse_us = rig.propulsion, float(p.pulse_us.max())
        measured_V = volts = float(np.mean(p.voltage_V[p.pulse_us == pulse_us]))
        command = (propulsion.pwm_max_us - pulse_us) / (pulse_us - propulsion.pwm_start_us)
        voltage, voltage_V = propulsion.voltage_nominal_V / measured_V - 1.0, float("nan")
        notes = []
        if extrapolate or command <= MAX_OVER_COMMAND:
            pulse_us = propulsion.pwm_max_us
        if abs(voltage) <= (np.inf if extrapolate else MAX_OVER_VOLTAGE):
            voltage_V = volts = propulsion.voltage_nominal_V
        for quantity, excess, limit in (
            ("command", max(command, 0.0), MAX_OVER_COMMAND),
            (f"voltage from {measured_V:.4g} V", voltage, MAX_OVER_VOLTAGE),
        ):
            if abs(excess) > limit and not extrapolate:
                percent = f"{100.0 * excess:+.0f} %"
                notes.append(f"; {percent} in {quantity} is refused without --extrapolate")
            elif abs(excess) > 5e-4:
                notes.append(f"; extrapolated by {100.0 * excess:+.1f} % in {quantity}")
        text = f"at {pulse_us:g} us" + (f" and {volts:.4g} V" if volts > 0.0 else "")
        return cls(pulse_us, voltage_V, measured_V, text + "".join(notes))

    def over_measured(self, voltage_V: Array) -> Array:
        """Return the ratio of full-throttle to measured voltages (n,); 1 if either is missing."""
        ratio = self.voltage_V / voltage_V
        return np.where(np.isfinite(ratio), ratio, 1.0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MotorFit:
    """Motor constants and the data of their fit."""

    names: tuple[str, ...]
    rig: Rig
    points: ThrottlePoints
    steps: tuple[StepResponse, ...]
    estimates: tuple[Estimate, ...]  # in the order of the laws in the module docstring
    mass_kg: float | None  # of the vehicle, for the hover point; None if unknown
    simulated: bool
    full: FullThrottle  # throttle 1
    law: ThrustLaw | None  # thrust over speed; None without measured speed

    def __getitem__(self, name: str) -> Estimate:
        return next(estimate for estimate in self.estimates if estimate.name == name)

    def value(self, name: str) -> float:
        """Return the value of an estimate; nan if missing or open."""
        values = [item.value for item in self.estimates if item.name == name and not item.open]
        return values[0] if values else float("nan")

    @property
    def throttle(self) -> Array:
        """Throttle of every point (n,), 1 at full throttle."""
        start_us = self.rig.propulsion.pwm_start_us
        return (self.points.pulse_us - start_us) / (self.full.pulse_us - start_us)

    def thrust_at_throttle_N(self, throttle: Any) -> Any:
        """Return the thrust of one rotor at throttles from 0 (`pwm_start_us`) to 1 (`full`): N."""
        expo = self.value("expo")
        u = np.asarray(throttle, float)
        return self.value("T_max") * ((1.0 - expo) * u + expo * u * u)

    def thrust_at_speed_N(self, speed_rad_s: Any) -> Any:
        """Return the fitted thrust of one rotor at speeds: N; nan without measured speed."""
        if self.law is None:
            return np.full_like(np.asarray(speed_rad_s, float), np.nan)
        return self.law.thrust_N(speed_rad_s)

    @property
    def thrust_at_full_voltage_N(self) -> Array:
        """Measured thrust corrected to the voltage of full throttle (n,): N."""
        power = 2.0 if self.law is None else self.law.values[2]
        power *= float(np.nan_to_num(self.value("voltage_exponent"), nan=1.0))
        return self.points.thrust_N * self.full.over_measured(self.points.voltage_V) ** power


def fit_motor(
    runs: Sequence[str | Path],
    mass_kg: float | None = None,
    rig: Rig | None = None,
    propeller: Propeller | None = None,
    rotors: int | None = None,
    extrapolate: bool = False,
) -> MotorFit:
    """Return thrust curve and motor constants from one or several runs or logs of one rig.

    Args:
        runs: run folders (of a plate sweep, the reference points are used); test stand logs,
            imported with `benchtool import` or original.
        mass_kg: vehicle mass; by default the rig's, if known.
        rig: rig of the logs with pulse widths and voltage; by default built from the logs.
        propeller: propeller of logs that do not contain it.
        rotors: number of rotors that carry the mass; by default the rig's.
        extrapolate: no limits of extrapolation to the rig's maximum pulse width and voltage.

    Raises:
        InputError: no input, runs of different rigs, or a mass beyond the maximum thrust.
        EstimationError: too few throttle levels, and no step.
    """
    if not runs:
        raise InputError("no input; give run folders without a plate, or test stand logs")
    if mass_kg is not None:
        check_number("the mass", mass_kg, "kg")
    recordings = read_motor_data([Path(path) for path in runs], rig, propeller)
    rig = recordings[0].rig
    for path, recording in zip(runs, recordings, strict=True):
        if (recording.rig.propulsion, recording.rig.n_rotors) != (rig.propulsion, rig.n_rotors):
            raise InputError(
                f"{path} was measured on rig {recording.rig.name}, {runs[0]} on {rig.name}, whose "
                f"propulsion differs; fit them separately"
            )
    points = concatenate_points([recording.points for recording in recordings])
    steps = tuple(step for recording in recordings for step in recording.steps)
    if mass_kg is None and "body.mass_kg" not in rig.not_stated:
        mass_kg = rig.body.mass_kg
    levels = len(np.unique(points.pulse_us))
    estimates: list[Estimate] = []
    law, full = None, FullThrottle.of(points, rig, extrapolate)
    carriers = rig.n_rotors if rotors is None else rotors
    if rig.n_rotors not in (1, carriers):
        raise InputError(f"--rotors is {carriers}, but rig {rig.name!r} has {rig.n_rotors}")
    if levels >= MIN_LEVELS:
        estimates, law = _curves(recordings, points, full, mass_kg, carriers)
    estimates += step_lags(steps)
    if not estimates:
        raise EstimationError(
            f"no step of the pulse width, and only {pluralize(levels, 'throttle level')} with a "
            f"turning rotor and no plate; minimum for a curve: {MIN_LEVELS}; sweep with --plan "
            f"steps or --plan response"
        )
    return MotorFit(
        names=tuple(Path(path).resolve().name for path in runs),
        rig=rig,
        points=points,
        steps=steps,
        estimates=tuple(estimates),
        mass_kg=mass_kg,
        simulated=any(recording.simulated for recording in recordings),
        full=full,
        law=law,
    )


def _curves(
    recordings: Sequence[MotorData],
    p: ThrottlePoints,
    full: FullThrottle,
    mass_kg: float | None,
    rotors: int,
) -> tuple[list[Estimate], ThrustLaw | None]:
    """Return the constants of thrust and speed, and the law (None without measured speed)."""
    rig, zero_N2 = recordings[0].rig, block_diag(*(recording.zero_N2 for recording in recordings))
    scale_sd = max(recording.scale_sd for recording in recordings)
    estimates, law, level = [_measured_maximum(p, scale_sd)], None, level_numbers(p.pulse_us)
    error, exponent, power = _thrust_error(p), t_estimate("", "1", 1.0, MAX_EXPONENT_SD, 1), 2.0
    if np.isfinite(p.speed_rad_s).all() and (p.speed_rad_s > 0.0).all():
        law, free = choose_law(p.speed_rad_s, p.thrust_N, error, zero_N2, scale_sd, level)
        power, speed = law.values[2], _speed_law(p, rig)
        exponent = exponent if speed[-1].open else speed[-1]
        estimates += [*_law_constants(law, free), *speed]
    start_us = rig.propulsion.pwm_start_us
    u = (p.pulse_us - start_us) / (full.pulse_us - start_us)

    def curve_at(q: float) -> tuple[Solution, float]:
        """Fit the curve at the voltage of full throttle, with speed as voltage to this power."""
        at_full = full.over_measured(p.voltage_V) ** (power * q)
        thrust = p.thrust_N * at_full
        return solve_levels(
            lambda values: np.asarray(values[0] * u + values[1] * u * u - thrust, float),
            error * at_full, zero_N2 * np.outer(at_full, at_full), level,
            (0.1 * thrust.max(), 0.9 * thrust.max()),
        )  # fmt: skip

    curve, residual_N = curve_at(exponent.value)
    shift = curve_at(exponent.value + exponent.sd)[0].values - curve.values
    # The scale of the load cell multiplies both coefficients.
    scaled = scale_sd * curve.values
    covariance = curve.covariance + np.outer(shift, shift) + np.outer(scaled, scaled)
    linear, square = curve.values
    full_N = linear + square

    def add(name: str, unit: str, value: float, gradient: Sequence[float], per_N: float) -> None:
        """Add an estimate from its gradients by the coefficients and by thrust (`per_N`)."""
        variance = float(np.array(gradient) @ covariance @ np.array(gradient))
        sd = sqrt(variance + (residual_N * per_N) ** 2)
        estimates.append(t_estimate(name, unit, float(value), sd, curve.dof, note))

    note = full.note
    if np.isfinite(full.voltage_V):
        note += f", thrust as V^{power * exponent.value:.3g} (± {power * exponent.sd:.2g})"
    add("T_max", "N", full_N, (1.0, 1.0), 1.0)
    note = f"u is 1 {full.note.partition(';')[0]}"
    gradient = (-square / full_N**2, linear / full_N**2)
    add("expo", "1", square / full_N, gradient, 1.0 / full_N)
    if mass_kg is None:
        return estimates, law
    hover_N = mass_kg * STANDARD_GRAVITY_M_S2 / rotors
    if hover_N > full_N:
        raise InputError(
            f"{mass_kg:g} kg on {pluralize(rotors, 'rotor')} need {hover_N:.3g} N each; maximum: "
            f"{full_N:.3g} N {full.note}; change --mass-kg or --rotors"
        )
    hover = 2.0 * hover_N / (linear + sqrt(linear**2 + 4.0 * square * hover_N))
    slope = linear + 2.0 * square * hover
    note = f"{start_us + hover * (full.pulse_us - start_us):.0f} us"
    note += f" at {full.voltage_V:.4g} V" if np.isfinite(full.voltage_V) else ""
    gradient = (-hover / slope, -(hover**2) / slope)
    add("hover_throttle", "1", hover, gradient, 1.0 / slope)
    share_sd = hover_N / full_N * estimates[-3].sd / full_N
    estimates.append(t_estimate("hover_thrust_share", "1", hover_N / full_N, share_sd, curve.dof))
    if law is not None:
        rpm, sd = (30.0 / pi * value for value in law.speed_at(hover_N))
        estimates.append(t_estimate("hover_rpm", "rpm", rpm, sd, law.dof))
    return estimates, law


def _measured_maximum(p: ThrottlePoints, scale_sd: float) -> Estimate:
    """Return the highest mean thrust over the pulse widths of each run."""
    settings = np.unique(np.column_stack([p.run, p.pulse_us]), axis=0)
    groups = [(p.run == run) & (p.pulse_us == pulse_us) for run, pulse_us in settings]
    rows = max(groups, key=lambda rows: float(p.thrust_N[rows].mean()))
    thrust, count, volts = p.thrust_N[rows], int(rows.sum()), float(np.mean(p.voltage_V[rows]))
    variance = float(np.mean(_thrust_error(p)[rows] ** 2) + thrust.var()) / count
    sd = sqrt(variance + (scale_sd * thrust.mean()) ** 2)
    note = f"at {p.pulse_us[rows][0]:g} us" + (f" and {volts:.4g} V" if volts > 0.0 else "")
    return t_estimate("T_measured", "N", float(thrust.mean()), sd, max(count - 1, 3), note)


def _law_constants(law: ThrustLaw, free: ThrustLaw) -> list[Estimate]:
    """Return the single k with its error, the free exponent, and T_0 if the law has one.

    For another law than T = k w^2, k minimises the maximum relative error above `MIN_THRUST_SHARE`
    of the highest thrust; that error adds to the uncertainty as a rectangular distribution.
    """
    used = law.level_thrust_N >= MIN_THRUST_SHARE * law.level_thrust_N.max()
    speed, thrust = law.level_speed_rad_s[used], law.level_thrust_N[used]
    ends = float(speed.min()), float(speed.max())
    # T / w^2 is monotonic in every law: its extremes are at the ends.
    k_low, k_high = (float(law.thrust_N(end)) / end**2 for end in ends)
    is_exact = law.name == "k w^2"
    k = law.coefficient if is_exact else 2.0 * k_low * k_high / (k_low + k_high)
    error = float(np.abs(k * speed**2 / thrust - 1.0).max())
    relative = sqrt(law.covariance[0, 0]) / law.values[0]
    sd = k * float(np.hypot(relative, 0.0 if is_exact else error / sqrt(3.0)))
    low, high = (end * 30.0 / pi for end in ends)
    note = f"{'' if is_exact else 'best single k '}from {low:.0f} to {high:.0f} rpm"
    estimates = [
        t_estimate("k", "N/(rad/s)^2", k, sd, law.dof, note),
        t_estimate("k_error", "1", error, 0.0, law.dof, note),
        t_estimate("n", "1", free.values[2], sqrt(free.covariance[2, 2]), free.dof),
    ]
    if law.name == "k w^2 + T_0":
        estimates.append(t_estimate("T_0", "N", law.values[1], sqrt(law.covariance[1, 1]), law.dof))
    return estimates


def _thrust_error(p: ThrottlePoints) -> Array:
    """Return the standard errors of thrusts (n,), including those of their speeds."""
    speed = np.nan_to_num(p.speed_se_rad_s / np.where(p.speed_rad_s > 0.0, p.speed_rad_s, np.nan))
    error = np.hypot(p.thrust_se_N, 2.0 * p.thrust_N * speed)
    usable = error[np.isfinite(error) & (error > 0.0)]
    default_error = float(np.median(usable)) if usable.size else 1.0
    return np.where(np.isfinite(error) & (error > 0.0), error, default_error)


def _speed_law(p: ThrottlePoints, rig: Rig) -> list[Estimate]:
    """Return slope, zero and voltage exponent of speed over pulse width.

    If the voltage range is too small, the exponent is open and fixed at 1.
    """
    propulsion = rig.propulsion
    relative = np.where(np.isfinite(p.voltage_V), p.voltage_V, propulsion.voltage_nominal_V)
    relative = relative / propulsion.voltage_nominal_V
    error = np.maximum(p.speed_se_rad_s, 1e-4 * p.speed_rad_s)
    error = np.where(np.isfinite(error), error, 1e-3 * p.speed_rad_s)

    def residuals(values: Array, exponent: float) -> Array:
        law = values[0] * (p.pulse_us - values[1]) * relative**exponent
        return np.asarray((law - p.speed_rad_s) / error, float)

    start = (propulsion.speed_per_us_rad_s, propulsion.pwm_start_us)
    free = solve_weighted(lambda values: residuals(values[:2], float(values[2])), (*start, 1.0))
    sd = sqrt(free.covariance[2, 2])
    voltage_range = float(np.ptp(relative))
    is_determined = voltage_range > 0.0 and sd < MAX_EXPONENT_SD
    solved = free if is_determined else solve_weighted(lambda values: residuals(values, 1.0), start)
    exponent = t_estimate("voltage_exponent", "1", float(free.values[2]), sd, free.dof)
    if not is_determined:
        percent = f"{100.0 * voltage_range:.2g} %"
        reason = f"voltage range {percent} is too small; sweep on a discharging battery"
        exponent = replace(exponent, open=reason)
    sds = np.sqrt(np.diag(solved.covariance))
    return [
        t_estimate("speed_per_us", "rad/s/us", float(solved.values[0]), sds[0], solved.dof),
        t_estimate("pulse_zero", "us", float(solved.values[1]), sds[1], solved.dof),
        exponent,
    ]
