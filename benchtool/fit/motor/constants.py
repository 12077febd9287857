"""Thrust curve and motor constants from tests without a plate: throttle up and down, and steps.

Each law is one least-squares fit. Errors of the points are its weights, inflated where the points
scatter more (Birge ratio: Birge, Phys. Rev. 40 (1932) 207); intervals are Student's t. Per rotor:

- thrust over speed: k w^2, k w^2 + T_0 or c w^n, see `choose_law`,
- speed over pulse: w = s (p - p_0) (V / V_n)^q,
- thrust over throttle: T = T_max ((1 - e) u + e u^2), the form of ArduPilot's MOT_THST_EXPO and
  PX4's THR_MDL_FAC, u from `pwm_start_us` to full throttle, see `FullThrottle`,
- speed after a step: w = w_1 + (w_0 - w_1) exp(-(t - d) / tau), up and down apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.errors import EstimationError, InputError, check_number
from benchtool.core.fit_result import Estimate
from benchtool.core.plural import pluralize
from benchtool.core.rig import UNSPECIFIED, Propeller, Rig
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.fit.motor.law import ThrustLaw, choose_law, level_numbers, solve_levels
from benchtool.fit.motor.points import ThrottlePoints, joined_points
from benchtool.fit.motor.response import Solved, StepResponse, estimate_of, lags_of, solve_weighted
from benchtool.fit.motor.runs import read_motor_data

FEWEST_LEVELS = 4  # throttle levels that a curve needs; assumed, one more than its parameters
LEAST_SURE = 0.25  # sd of the voltage exponent above which it is 1 with this sd; assumed
MAX_OVER_VOLTAGE, MAX_OVER_COMMAND = 0.15, 0.10  # extrapolated without a request; assumed


class FullThrottle(NamedTuple):
    """Pulse and voltage of throttle 1, the rig's unless that is extrapolated too far."""

    pulse_us: float  # else the highest measured one
    voltage_V: float  # else nan: voltages as measured
    measured_V: float  # mean at the highest measured pulse; nan where it was not measured
    note: str  # pulse and voltage, what is extrapolated and what was refused

    @classmethod
    def of(cls, p: ThrottlePoints, rig: Rig, extrapolate: bool) -> FullThrottle:
        """Return full throttle, extrapolated beyond the limits on request alone."""
        own, pulse_us = rig.propulsion, float(p.pulse_us.max())
        measured_V = volts = float(np.mean(p.voltage_V[p.pulse_us == pulse_us]))
        command = (own.pwm_max_us - pulse_us) / (pulse_us - own.pwm_start_us)
        voltage, voltage_V, notes = own.voltage_nominal_V / measured_V - 1.0, float("nan"), []
        if extrapolate or command <= MAX_OVER_COMMAND:
            pulse_us = own.pwm_max_us
        if abs(voltage) <= (np.inf if extrapolate else MAX_OVER_VOLTAGE):
            voltage_V = volts = own.voltage_nominal_V
        for what, over, limit in (
            ("command", max(command, 0.0), MAX_OVER_COMMAND),
            (f"voltage from {measured_V:.4g} V", voltage, MAX_OVER_VOLTAGE),
        ):
            if abs(over) > limit and not extrapolate:
                notes.append(f"; {100.0 * over:+.0f} % in {what} is refused without --extrapolate")
            elif abs(over) > 5e-4:
                notes.append(f"; extrapolated by {100.0 * over:+.1f} % in {what}")
        at = f"at {pulse_us:g} us" + (f" and {volts:.4g} V" if volts > 0.0 else "")
        return cls(pulse_us, voltage_V, measured_V, at + "".join(notes))

    def over_measured(self, voltage_V: Array) -> Array:
        """Return the voltage of full throttle over measured ones (n,), 1 where either is absent."""
        ratio = self.voltage_V / voltage_V
        return np.where(np.isfinite(ratio), ratio, 1.0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MotorFit:
    """Hold motor constants, and what they were fitted to.

    Attributes:
        estimates: by law, in the order of the module's list; `open` where data do not determine it.
        mass_kg: of the vehicle whose hover point is among them; None where it is not stated.
    """

    names: tuple[str, ...]
    rig: Rig
    points: ThrottlePoints
    steps: tuple[StepResponse, ...]
    estimates: tuple[Estimate, ...]
    mass_kg: float | None
    simulated: bool
    full: FullThrottle  # throttle 1
    law: ThrustLaw | None  # of thrust over speed; None where no speed was measured

    def __getitem__(self, name: str) -> Estimate:
        return next(one for one in self.estimates if one.name == name)

    def value(self, name: str) -> float:
        """Return an estimate's value; nan where there is none of that name or it is open."""
        found = next((one for one in self.estimates if one.name == name and not one.open), None)
        return found.value if found is not None else float("nan")

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
        """Return the fitted thrust of one rotor at speeds: N; nan where no speed was measured."""
        if self.law is None:
            return np.full_like(np.asarray(speed_rad_s, float), np.nan)
        return self.law.thrust_N(speed_rad_s)

    @property
    def thrust_at_full_voltage_N(self) -> Array:
        """Measured thrust brought to the voltage of full throttle (n,): N."""
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
        runs: run folders, of a plate sweep its references are taken; logs of stands, as
            `benchtool import` wrote them or as the stand did.
        mass_kg: of the vehicle; the rig's when left out, where it states one.
        rig: of logs, whose pulses and voltage it states; made from the logs when left out.
        propeller: of logs that do not state theirs.
        rotors: that carry the mass; the rig's when left out.
        extrapolate: full throttle is the rig's longest pulse and nominal voltage, however far.

    Raises:
        InputError: none is given, the runs have different rigs, or the mass is too heavy.
        EstimationError: too few throttle levels, and no step.
    """
    if not runs:
        raise InputError("nothing is given; name runs without a plate, or logs of a stand")
    if mass_kg is not None:
        check_number("the mass", mass_kg, "kg")
    read = read_motor_data([Path(path) for path in runs], rig, propeller)
    rig = read[0].rig
    for path, one in zip(runs, read, strict=True):
        if (one.rig.propulsion, one.rig.n_rotors) != (rig.propulsion, rig.n_rotors):
            raise InputError(
                f"{path} was measured on rig {one.rig.name}, {runs[0]} on {rig.name}, whose "
                f"propulsion differs; fit them apart"
            )
    points = joined_points([one.points for one in read])
    steps = tuple(step for one in read for step in one.steps)
    stated = not rig.sources.get("body.mass_kg", "").startswith(UNSPECIFIED)
    mass = rig.body.mass_kg if mass_kg is None and stated else mass_kg
    levels = len(np.unique(points.pulse_us))
    estimates: list[Estimate] = []
    law, full = None, FullThrottle.of(points, rig, extrapolate)
    carriers = rig.n_rotors if rotors is None else rotors
    if rig.n_rotors not in (1, carriers):
        raise InputError(f"--rotors is {carriers}, but rig {rig.name!r} has {rig.n_rotors}")
    if levels >= FEWEST_LEVELS:
        from scipy.linalg import block_diag

        zero_N2, scale_sd = block_diag(*[e.zero_N2 for e in read]), max(e.scale_sd for e in read)
        estimates, law = _curves(points, rig, mass, carriers, scale_sd, zero_N2, full)
    estimates += lags_of(steps)
    if not estimates:
        raise EstimationError(
            f"{pluralize(levels, 'throttle level')} at which the rotor turned far from a plate, "
            f"{FEWEST_LEVELS} are needed for a curve, "
            f"and no step of the pulse; sweep with --plan steps or --plan response"
        )
    return MotorFit(
        names=tuple(Path(path).resolve().name for path in runs),
        rig=rig,
        points=points,
        steps=steps,
        estimates=tuple(estimates),
        mass_kg=mass,
        simulated=any(one.simulated for one in read),
        full=full,
        law=law,
    )


def _curves(
    p: ThrottlePoints, rig: Rig, mass_kg: float | None, rotors: int, scale_sd: float,
    zero_N2: Array, full: FullThrottle,
) -> tuple[list[Estimate], ThrustLaw | None]:  # fmt: skip
    """Return the constants of thrust and speed, and the law; no speed where it was not measured."""
    found, law, level = [_measured_maximum(p, scale_sd)], None, level_numbers(p.pulse_us)
    error, exponent, power = _thrust_error(p), estimate_of("", "1", 1.0, LEAST_SURE, 1), 2.0
    if np.isfinite(p.speed_rad_s).all() and (p.speed_rad_s > 0.0).all():
        law, free = choose_law(p.speed_rad_s, p.thrust_N, error, zero_N2, scale_sd, level)
        power, speed = law.values[2], _speed_law(p, rig)
        exponent = exponent if speed[-1].open else speed[-1]
        found += [*_law_constants(law, free), *speed]
    start_us = rig.propulsion.pwm_start_us
    u = (p.pulse_us - start_us) / (full.pulse_us - start_us)

    def curve_at(q: float) -> tuple[Solved, float]:
        """Fit the curve at the voltage of full throttle, speed as its power q."""
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

    def add(name: str, unit: str, value: float, way: Sequence[float], per_N: float) -> None:
        """Add what changes by `way` with the coefficients and by `per_N` with thrust."""
        own = float(np.array(way) @ covariance @ np.array(way))
        sd = sqrt(own + (residual_N * per_N) ** 2)
        found.append(estimate_of(name, unit, float(value), sd, curve.dof, note=note))

    note = full.note
    if np.isfinite(full.voltage_V):
        note += f", thrust as V^{power * exponent.value:.3g} (± {power * exponent.sd:.2g})"
    add("T_max", "N", full_N, (1.0, 1.0), 1.0)
    note = f"u is 1 {full.note.partition(';')[0]}"
    way = (-square / full_N**2, linear / full_N**2)
    add("expo", "1", square / full_N, way, 1.0 / full_N)
    if mass_kg is None:
        return found, law
    hover_N = mass_kg * STANDARD_GRAVITY_M_S2 / rotors
    if hover_N > full_N:
        raise InputError(
            f"{mass_kg:g} kg on {pluralize(rotors, 'rotor')} need {hover_N:.3g} N of each, which "
            f"reaches {full_N:.3g} N {full.note}; give another --mass-kg or --rotors"
        )
    hover = 2.0 * hover_N / (linear + sqrt(linear**2 + 4.0 * square * hover_N))
    slope = linear + 2.0 * square * hover
    note = f"{start_us + hover * (full.pulse_us - start_us):.0f} us"
    note += f" at {full.voltage_V:.4g} V" if np.isfinite(full.voltage_V) else ""
    way = (-hover / slope, -(hover**2) / slope)
    add("hover_throttle", "1", hover, way, 1.0 / slope)
    share_sd = hover_N / full_N * found[-3].sd / full_N
    found.append(estimate_of("hover_thrust_share", "1", hover_N / full_N, share_sd, curve.dof))
    if law is not None:
        rpm, sd = (30.0 / pi * each for each in law.speed_at(hover_N))
        found.append(estimate_of("hover_rpm", "rpm", rpm, sd, law.dof))
    return found, law


def _measured_maximum(p: ThrottlePoints, scale_sd: float) -> Estimate:
    """Return the highest mean thrust of one pulse and run."""
    settings = np.unique(np.column_stack([p.run, p.pulse_us]), axis=0)
    groups = [(p.run == run) & (p.pulse_us == pulse_us) for run, pulse_us in settings]
    here = max(groups, key=lambda rows: float(p.thrust_N[rows].mean()))
    thrust, count, volts = p.thrust_N[here], int(here.sum()), float(np.mean(p.voltage_V[here]))
    variance = float(np.mean(_thrust_error(p)[here] ** 2) + thrust.var()) / count
    sd = sqrt(variance + (scale_sd * thrust.mean()) ** 2)
    note = f"at {p.pulse_us[here][0]:g} us" + (f" and {volts:.4g} V" if volts > 0.0 else "")
    return estimate_of("T_measured", "N", float(thrust.mean()), sd, max(count - 1, 3), note=note)


def _law_constants(law: ThrustLaw, free: ThrustLaw) -> list[Estimate]:
    """Return the single k with its error, the free exponent, and T_0 where the law has one."""
    k, sd, error, *ends = law.single_k
    low, high = (each * 30.0 / pi for each in ends)
    note = f"{'' if law.name == 'k w^2' else 'the best '}from {low:.0f} to {high:.0f} rpm"
    found = [
        estimate_of("k", "N/(rad/s)^2", k, sd, law.dof, note=note),
        estimate_of("k_error", "1", error, 0.0, law.dof, note=note),
        estimate_of("n", "1", free.values[2], sqrt(free.covariance[2, 2]), free.dof),
    ]
    if law.name == "k w^2 + T_0":
        found.append(estimate_of("T_0", "N", law.values[1], sqrt(law.covariance[1, 1]), law.dof))
    return found


def _thrust_error(p: ThrottlePoints) -> Array:
    """Return the standard errors of thrusts (n,), that of their speeds in them."""
    speed = np.nan_to_num(p.speed_se_rad_s / np.where(p.speed_rad_s > 0.0, p.speed_rad_s, np.nan))
    error = np.hypot(p.thrust_se_N, 2.0 * p.thrust_N * speed)
    known = error[np.isfinite(error) & (error > 0.0)]
    least = float(np.median(known)) if known.size else 1.0
    return np.where(np.isfinite(error) & (error > 0.0), error, least)


def _speed_law(p: ThrottlePoints, rig: Rig) -> list[Estimate]:
    """Return slope, zero and voltage exponent of speed over pulse.

    Where the voltage hardly moved, its exponent is open and held at 1: speed goes with voltage.
    """
    own = rig.propulsion
    relative = np.where(np.isfinite(p.voltage_V), p.voltage_V, own.voltage_nominal_V)
    relative = relative / own.voltage_nominal_V
    error = np.maximum(p.speed_se_rad_s, 1e-4 * p.speed_rad_s)
    error = np.where(np.isfinite(error), error, 1e-3 * p.speed_rad_s)

    def residuals(values: Array, exponent: float) -> Array:
        law = values[0] * (p.pulse_us - values[1]) * relative**exponent
        return np.asarray((law - p.speed_rad_s) / error, float)

    start = (own.speed_per_us_rad_s, own.pwm_start_us)
    free = solve_weighted(lambda values: residuals(values[:2], float(values[2])), (*start, 1.0))
    sd = sqrt(free.covariance[2, 2])
    spread = float(np.ptp(relative))
    sure = spread > 0.0 and sd < LEAST_SURE
    solved = free if sure else solve_weighted(lambda values: residuals(values, 1.0), start)
    remark = "" if sure else (
        f"the voltage moved by {100.0 * spread:.2g} % only; sweep on a pack that empties"
    )  # fmt: skip
    sds = np.sqrt(np.diag(solved.covariance))
    return [
        estimate_of("speed_per_us", "rad/s/us", float(solved.values[0]), sds[0], solved.dof),
        estimate_of("pulse_zero", "us", float(solved.values[1]), sds[1], solved.dof),
        estimate_of("voltage_exponent", "1", float(free.values[2]), sd, free.dof, remark),
    ]
