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
from dataclasses import dataclass, field
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.array import Array
from benchtool.core.counted import counted
from benchtool.core.errors import EstimationError, InputError, check_number
from benchtool.core.fit_result import Estimate
from benchtool.core.rig import NOT_STATED, Propeller, Rig
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.fit.motor.law import (
    ThrustLaw,
    choose_law,
    level_means,
    level_numbers,
    solve_levels,
)  # fmt: skip
from benchtool.fit.motor.points import ThrottlePoints, joined_points
from benchtool.fit.motor.response import (
    Solved,
    StepResponse,
    estimate_of,
    lags_of,
    solve_weighted,
)  # fmt: skip
from benchtool.fit.motor.runs import read_motor_data

FEWEST_LEVELS = 4
"""Throttle levels below which no curve is fitted; a choice, one more than its parameters."""

LEAST_SURE = 0.25
"""Standard deviation of the voltage exponent above which it is not determined; a choice. It then
counts as 1 with this standard uncertainty."""

MAX_OVER_VOLTAGE, MAX_OVER_COMMAND = 0.15, 0.10
"""Extrapolation, over what was measured, beyond which it must be requested; from issue 37."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FullThrottle:
    """Pulse and voltage of full throttle, and how far they are from what was measured.

    Attributes:
        pulse_us: of throttle 1: the rig's longest, or the highest measured one where the rig's is
            refused as an extrapolation.
        voltage_V: the rig's nominal voltage, or nan for voltages as measured where it is refused or
            no voltage was measured.
        measured_us, measured_V: highest pulse, and the mean voltage at it.
    """

    pulse_us: float
    voltage_V: float
    measured_us: float
    measured_V: float
    over_command: float  # relative, of the rig's longest pulse
    over_voltage: float  # relative, of the nominal voltage; nan where no voltage was measured

    @classmethod
    def of(cls, p: ThrottlePoints, rig: Rig, extrapolate: bool) -> FullThrottle:
        """Return full throttle, as far as it may be extrapolated."""
        own, top_us = rig.propulsion, float(p.pulse_us.max())
        at_top = p.voltage_V[p.pulse_us == top_us]
        top_V = float(np.nanmean(at_top)) if np.isfinite(at_top).any() else float("nan")
        command = (own.pwm_max_us - own.pwm_start_us) / (top_us - own.pwm_start_us) - 1.0
        voltage = own.voltage_nominal_V / top_V - 1.0
        refused = not extrapolate and command > MAX_OVER_COMMAND
        as_measured = not np.isfinite(voltage) or (
            not extrapolate and abs(voltage) > MAX_OVER_VOLTAGE
        )
        return cls(
            pulse_us=top_us if refused else own.pwm_max_us,
            voltage_V=float("nan") if as_measured else own.voltage_nominal_V,
            measured_us=top_us, measured_V=top_V, over_command=command, over_voltage=voltage,
        )  # fmt: skip

    def over_measured(self, voltage_V: Array) -> Array:
        """Return the voltage of full throttle over measured ones (n,), 1 where either is absent."""
        ratio = self.voltage_V / voltage_V
        return np.asarray(np.where(np.isfinite(ratio), ratio, 1.0), float)

    @property
    def words(self) -> str:
        """Where full throttle is: pulse and voltage."""
        at = f"at {self.pulse_us:g} us"
        if np.isfinite(self.voltage_V):
            return f"{at} and {self.voltage_V:.4g} V"
        return f"{at}, as measured at {self.measured_V:.4g} V" if self.measured_V > 0.0 else at

    def note(self, exponent: Estimate, power: float) -> str:
        """Return where full throttle is, what is extrapolated, and what is refused."""
        out = self.words
        if self.pulse_us > self.measured_us:
            out += f"; extrapolated by {100.0 * self.over_command:.1f} % in command"
        elif self.over_command > 0.0:
            out += (
                f"; {100.0 * self.over_command:.0f} % more command is refused without --extrapolate"
            )
        if np.isfinite(self.voltage_V):
            out += (
                f"; extrapolated by {100.0 * self.over_voltage:.1f} % in voltage from "
                f"{self.measured_V:.4g} V, thrust as V^{power * exponent.value:.3g} "
                f"(± {power * exponent.sd:.2g})"
            )
        elif np.isfinite(self.over_voltage):
            out += (
                f"; {100.0 * self.over_voltage:+.0f} % in voltage is refused without --extrapolate"
            )
        return out


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MotorFit:
    """Hold motor constants, and what they were fitted to.

    Attributes:
        estimates: by law, in the order of the module's list; `open` where data do not determine it.
        mass_kg: of the vehicle whose hover point is among them; None where it is not stated.
        full: what throttle 1 is.
        law: of thrust over speed; None where no speed was measured.
    """

    names: tuple[str, ...]
    rig: Rig
    points: ThrottlePoints
    steps: tuple[StepResponse, ...]
    estimates: tuple[Estimate, ...]
    mass_kg: float | None
    simulated: bool
    full: FullThrottle
    law: ThrustLaw | None
    rotors: int = 1  # that carry the mass
    warnings: tuple[str, ...] = field(default=())

    def __getitem__(self, name: str) -> Estimate:
        return next(one for one in self.estimates if one.name == name)

    def value(self, name: str) -> float:
        """Return an estimate's value; nan where there is none of that name or it is open."""
        found = next((one for one in self.estimates if one.name == name and not one.open), None)
        return found.value if found is not None else float("nan")

    @property
    def throttle(self) -> Array:
        """Throttle of every point (n,), 1 at full throttle."""
        return throttle_of(self.points.pulse_us, self.rig, self.full.pulse_us)

    def thrust_at_throttle_N(self, throttle: Any) -> Any:
        """Return the fitted thrust of one rotor at throttles: N.

        Throttle is 0 at `pwm_start_us` and 1 at `full.pulse_us`, voltage `full.voltage_V`.
        """
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
        power = 2.0 if self.law is None else self.law.exponent
        exponent = self.value("voltage_exponent")
        exponent = exponent if np.isfinite(exponent) else 1.0
        ratio = self.full.over_measured(self.points.voltage_V)
        return np.asarray(self.points.thrust_N * ratio ** (power * exponent), float)


def throttle_of(pulse_us: Array, rig: Rig, full_us: float) -> Array:
    """Return pulses as throttle, 0 at `pwm_start_us`, 1 at full throttle."""
    start_us = rig.propulsion.pwm_start_us
    return (pulse_us - start_us) / (full_us - start_us)


def fit_motor(
    runs: Sequence[str | Path],
    mass_kg: float | None = None,
    rig: Rig | None = None,
    propeller: Propeller | None = None,
    *,
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
    stated = not rig.sources.get("body.mass_kg", "").startswith(NOT_STATED)
    mass = rig.body.mass_kg if mass_kg is None and stated else mass_kg
    levels = len(np.unique(points.pulse_us))
    estimates: list[Estimate] = []
    law, full = None, FullThrottle.of(points, rig, extrapolate)
    n_rotors = rig.n_rotors if rotors is None else rotors
    if rig.n_rotors not in (1, n_rotors) or n_rotors < 1:
        raise InputError(f"--rotors is {n_rotors}, but rig {rig.name!r} has {rig.n_rotors}")
    if levels >= FEWEST_LEVELS:
        from scipy.linalg import block_diag

        zero_N2, scale_sd = block_diag(*[e.zero_N2 for e in read]), max(e.scale_sd for e in read)
        estimates, law = _curves(points, rig, mass, scale_sd, zero_N2, n_rotors, full)
    estimates += lags_of(steps)
    if not estimates:
        raise EstimationError(
            f"{counted(levels, 'throttle level')} at which the rotor turned far from a plate, "
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
        rotors=n_rotors,
    )


def _curves(
    p: ThrottlePoints, rig: Rig, mass_kg: float | None, scale_sd: float, zero_N2: Array,
    rotors: int, full: FullThrottle,
) -> tuple[list[Estimate], ThrustLaw | None]:  # fmt: skip
    """Return the constants of thrust and speed, and the law; no speed where it was not measured."""
    found, law, level = [_measured_maximum(p)], None, level_numbers(p.pulse_us)
    error, exponent, power = _thrust_error(p), estimate_of("", "1", 1.0, LEAST_SURE, 1), 2.0
    if np.isfinite(p.speed_rad_s).all() and (p.speed_rad_s > 0.0).all():
        law, free = choose_law(p.speed_rad_s, p.thrust_N, error, zero_N2, level)
        speed = _speed_law(p, rig)
        exponent = exponent if speed[-1].open else speed[-1]
        power = law.exponent
        found += [*_law_estimates(law, free, scale_sd), *speed]
    u = throttle_of(p.pulse_us, rig, full.pulse_us)

    def curve_at(q: float) -> tuple[Solved, float]:
        """Fit the curve at the voltage of full throttle, speed in proportion to its power q."""
        at_full = full.over_measured(p.voltage_V) ** (power * q)
        thrust = p.thrust_N * at_full
        top = float(thrust.max())
        return solve_levels(
            lambda values: np.asarray(values[0] * u + values[1] * u * u - thrust, float),
            error * at_full, zero_N2 * np.outer(at_full, at_full), level, (0.1 * top, 0.9 * top),
        )  # fmt: skip

    curve, misfit_N = curve_at(exponent.value)
    shift = curve_at(exponent.value + exponent.sd)[0].values - curve.values
    covariance = curve.covariance + np.outer(shift, shift)
    linear, square = curve.values
    full_N = linear + square

    def derived(name: str, unit: str, value: float, way: tuple[float, float], per_N: float) -> None:
        """Add what changes by `way` with the two coefficients, by `per_N` with their thrust."""
        own = np.array(way) @ covariance @ np.array(way)
        at_N = full_N if name in ("T_max", "expo") else hover_N
        beside = np.hypot(misfit_N, scale_sd * at_N if name != "expo" else 0.0) * per_N
        note = {"T_max": full.note(exponent, power), "expo": full.words}.get(name, "")
        if name == "hover_throttle":
            start_us = rig.propulsion.pwm_start_us
            note = f"{start_us + value * (full.pulse_us - start_us):.0f} us"
        found.append(
            estimate_of(name, unit, float(value), float(np.hypot(sqrt(own), beside)), curve.dof,
                        note=note)
        )  # fmt: skip

    derived("T_max", "N", full_N, (1.0, 1.0), 1.0)
    derived("expo", "1", square / full_N, (-square / full_N**2, linear / full_N**2), 1.0 / full_N)
    if mass_kg is None:
        return found, law
    hover_N = mass_kg * STANDARD_GRAVITY_M_S2 / rotors
    if hover_N > full_N:
        raise InputError(
            f"{mass_kg:g} kg need {hover_N:.3g} N of each of {rotors} rotors, which reach "
            f"{full_N:.3g} N {full.words}; give another --mass-kg or --rotors"
        )
    hover = (-linear + sqrt(linear**2 + 4.0 * square * hover_N)) / (2.0 * square) if (
        abs(square) > 1e-12 * full_N
    ) else hover_N / linear  # fmt: skip
    slope = linear + 2.0 * square * hover
    derived("hover_throttle", "1", hover, (-hover / slope, -(hover**2) / slope), 1.0 / slope)
    share_sd = hover_N / full_N * found[-3].sd / full_N
    found.append(estimate_of("hover_thrust_share", "1", hover_N / full_N, share_sd, curve.dof))
    if law is not None:
        rpm, sd = (30.0 / pi * each for each in law.speed_at(hover_N, scale_sd))
        found.append(estimate_of("hover_rpm", "rpm", rpm, sd, law.dof))
    return found, law


def _measured_maximum(p: ThrottlePoints) -> Estimate:
    """Return the highest mean thrust of a pulse and run."""
    _, number = np.unique(np.column_stack([p.run, p.pulse_us]), axis=0, return_inverse=True)
    number = number.ravel()
    here = number == int(np.argmax(level_means(p.thrust_N, number)))
    count = int(here.sum())
    own = float(np.sqrt(np.sum(_thrust_error(p)[here] ** 2))) / count
    scatter = float(p.thrust_N[here].std(ddof=1)) / sqrt(count) if count > 1 else 0.0
    at = f"at {p.pulse_us[here][0]:g} us"
    if np.isfinite(p.voltage_V[here]).any():
        at += f" and {np.nanmean(p.voltage_V[here]):.4g} V"
    mean = float(p.thrust_N[here].mean())
    return estimate_of("T_measured", "N", mean, max(own, scatter), max(count - 1, 3), note=at)


def _thrust_error(p: ThrottlePoints) -> Array:
    """Return the standard errors of thrusts (n,), that of their speeds in them."""
    speed = np.nan_to_num(p.speed_se_rad_s / np.where(p.speed_rad_s > 0.0, p.speed_rad_s, np.nan))
    error = np.hypot(p.thrust_se_N, 2.0 * p.thrust_N * speed)
    known = error[np.isfinite(error) & (error > 0.0)]
    least = float(np.median(known)) if known.size else 1.0
    return np.where(np.isfinite(error) & (error > 0.0), error, least)


def _law_estimates(law: ThrustLaw, free: ThrustLaw, scale_sd: float) -> list[Estimate]:
    """Return k with its largest error, the free exponent, and the law's offset where it has one."""
    low, high = (each * 30.0 / pi for each in law.k_speed_rad_s)
    over = "" if law.name == "k w^2" else "of the best T = k w^2, "
    note = f"{over}{low:.0f} to {high:.0f} rpm"
    k_sd = float(np.hypot(law.k_sd, scale_sd * law.k))
    found = [
        estimate_of("k", "N/(rad/s)^2", law.k, k_sd, law.dof, note=note),
        estimate_of("k_error", "1", law.k_error, 0.0, law.dof, note=note),
        estimate_of("n", "1", free.exponent, sqrt(free.covariance[2, 2]), free.dof),
    ]
    if law.name == "k w^2 + T_0":
        found.append(estimate_of("T_0", "N", law.zero_N, sqrt(law.covariance[1, 1]), law.dof))
    return found


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
