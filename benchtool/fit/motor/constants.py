"""Thrust curve and motor constants from tests without a plate: throttle up and down, and steps.

Each law is one least-squares fit. Errors of the points are its weights, inflated where the points
scatter more (Birge ratio: Birge, Phys. Rev. 40 (1932) 207); intervals are Student's t. Per rotor:

- thrust over speed: T = T_0 + k w^2, and T = T_0 + k' w^n for n; T_0 is what a tare left,
- speed over pulse: w = s (p - p_0) (V / V_n)^q,
- thrust over throttle, brought to nominal voltage: T = T_max ((1 - e) u + e u^2), the form of
  ArduPilot's MOT_THST_EXPO and PX4's THR_MDL_FAC, u from `pwm_start_us` to `pwm_max_us`,
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
from benchtool.fit.motor.points import ThrottlePoints, joined_points
from benchtool.fit.motor.response import StepResponse, estimate_of, lags_of, solve_weighted
from benchtool.fit.motor.runs import read_motor_data

FEWEST_LEVELS = 4
"""Throttle levels below which no curve is fitted; a choice, one more than its parameters."""

LEAST_SURE = 0.25
"""Standard deviation of the voltage exponent above which it is not determined; a choice."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MotorFit:
    """Hold motor constants, and what they were fitted to.

    Attributes:
        estimates: by law, in the order of the module's list; `open` where data do not determine it.
        mass_kg: of the vehicle whose hover point is among them; None where nobody states it.
    """

    names: tuple[str, ...]
    rig: Rig
    points: ThrottlePoints
    steps: tuple[StepResponse, ...]
    estimates: tuple[Estimate, ...]
    mass_kg: float | None
    simulated: bool
    warnings: tuple[str, ...] = field(default=())

    def __getitem__(self, name: str) -> Estimate:
        return next(one for one in self.estimates if one.name == name)

    def value(self, name: str) -> float:
        """Return an estimate's value; nan where there is none of that name or it is open."""
        found = next((one for one in self.estimates if one.name == name and not one.open), None)
        return found.value if found is not None else float("nan")

    @property
    def throttle(self) -> Array:
        """Throttle of every point (n,), 0 to 1 of the rig's pulse range."""
        return throttle_of(self.points.pulse_us, self.rig)

    def curve_N(self, throttle: Any) -> Any:
        """Return the fitted thrust of one rotor at nominal voltage: N."""
        expo = self.value("expo")
        u = np.asarray(throttle, float)
        return self.value("T_max") * ((1.0 - expo) * u + expo * u * u)

    @property
    def nominal_thrust_N(self) -> Array:
        """Measured thrust brought to nominal voltage (n,): N."""
        return self.points.thrust_N * _to_nominal(self.points, self.rig, _exponent_of(self))


def throttle_of(pulse_us: Array, rig: Rig) -> Array:
    """Return pulses as throttle, 0 at `pwm_start_us`, 1 at `pwm_max_us`."""
    p = rig.propulsion
    return (pulse_us - p.pwm_start_us) / (p.pwm_max_us - p.pwm_start_us)


def fit_motor(
    runs: Sequence[str | Path],
    mass_kg: float | None = None,
    rig: Rig | None = None,
    propeller: Propeller | None = None,
) -> MotorFit:
    """Return thrust curve and motor constants from one or several runs or logs of one rig.

    Args:
        runs: run folders, of a plate sweep its references are taken; logs of stands, as
            `benchtool import` wrote them or as the stand did.
        mass_kg: of the vehicle; the rig's when left out, where it states one.
        rig: of logs, whose pulses and voltage it states; made from the logs when left out.
        propeller: of logs that do not state theirs.

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
    if levels >= FEWEST_LEVELS:
        from scipy.linalg import block_diag

        zero_N2 = block_diag(*[one.zero_N2 for one in read])
        estimates += _curves(points, rig, mass, max(one.scale_sd for one in read), zero_N2)
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
    )


def _curves(
    p: ThrottlePoints, rig: Rig, mass_kg: float | None, scale_sd: float, zero_N2: Array
) -> list[Estimate]:
    """Return the constants of thrust and speed; nothing of speed where it was not measured."""
    found: list[Estimate] = []
    exponent, exponent_sd, k = 1.0, 0.0, float("nan")
    if np.isfinite(p.speed_rad_s).all() and (p.speed_rad_s > 0.0).all():
        law = _thrust_law(p, scale_sd, zero_N2)
        speed = _speed_law(p, rig)
        k, exponent = law[0].value, 1.0 if speed[-1].open else speed[-1].value
        exponent_sd = 0.0 if speed[-1].open else speed[-1].sd
        found += [*law, *speed]
    at_nominal = _to_nominal(p, rig, exponent)
    u, thrust = throttle_of(p.pulse_us, rig), p.thrust_N * at_nominal
    # How far off the highest thrusts are where the voltage exponent is: T goes with V^2q.
    at_top = p.pulse_us == p.pulse_us.max()
    to_nominal_sd = abs(float(np.log(at_nominal[at_top]).mean())) / exponent * exponent_sd
    white = _whitener(_thrust_error(p) * at_nominal, zero_N2 * np.outer(at_nominal, at_nominal))

    def residuals(values: Array) -> Array:
        return np.asarray(white @ (values[0] * u + values[1] * u * u - thrust), float)

    top = float(thrust.max())
    curve = solve_weighted(residuals, (0.1 * top, 0.9 * top))
    linear, square = curve.values
    full = linear + square

    def derived(name: str, unit: str, value: float, gradient: tuple[float, float]) -> Estimate:
        way = np.array(gradient)
        sd = float(np.sqrt(way @ curve.covariance @ way))
        if unit == "N":
            sd = float(np.hypot(np.hypot(sd, scale_sd * value), to_nominal_sd * value))
        return estimate_of(name, unit, float(value), sd, curve.dof)

    found.append(derived("T_max", "N", full, (1.0, 1.0)))
    found.append(derived("expo", "1", square / full, (-square / full**2, linear / full**2)))
    if mass_kg is None:
        return found
    hover_N = mass_kg * STANDARD_GRAVITY_M_S2 / rig.n_rotors
    if hover_N > full:
        raise InputError(
            f"{mass_kg:g} kg need {hover_N:.3g} N of each of {rig.n_rotors} rotors, which reach "
            f"{full:.3g} N at full throttle; give another --mass-kg"
        )
    hover = (-linear + sqrt(linear**2 + 4.0 * square * hover_N)) / (2.0 * square) if (
        abs(square) > 1e-12 * full
    ) else hover_N / linear  # fmt: skip
    slope = linear + 2.0 * square * hover
    # The scale of the load cell moves every thrust, and with it where the mass hovers.
    sd = np.array([-hover, -(hover**2)]) / slope
    own = float(np.sqrt(sd @ curve.covariance @ sd))
    hover_sd = float(np.hypot(own, scale_sd * hover_N / slope))
    found.append(estimate_of("hover_throttle", "1", float(hover), hover_sd, curve.dof))
    share_sd = hover_N / full * found[-3].sd / full
    found.append(estimate_of("hover_thrust_share", "1", hover_N / full, share_sd, curve.dof))
    if np.isfinite(k):
        rpm = sqrt(hover_N / k) * 30.0 / pi
        found.append(estimate_of("hover_rpm", "rpm", rpm, 0.5 * rpm * found[0].sd / k, curve.dof))
    return found


def _thrust_error(p: ThrottlePoints) -> Array:
    """Return the standard errors of thrusts (n,), that of their speeds in them."""
    speed = np.nan_to_num(p.speed_se_rad_s / np.where(p.speed_rad_s > 0.0, p.speed_rad_s, np.nan))
    error = np.hypot(p.thrust_se_N, 2.0 * p.thrust_N * speed)
    known = error[np.isfinite(error) & (error > 0.0)]
    least = float(np.median(known)) if known.size else 1.0
    return np.where(np.isfinite(error) & (error > 0.0), error, least)


def _whitener(error: Array, zero_N2: Array) -> Array:
    """Return the matrix (n, n) that makes independent unit errors of those of the thrusts."""
    return np.linalg.inv(np.linalg.cholesky(np.diag(error**2) + zero_N2))


def _thrust_law(p: ThrottlePoints, scale_sd: float, zero_N2: Array) -> list[Estimate]:
    error, w = _thrust_error(p), p.speed_rad_s
    white = _whitener(error, zero_N2)
    middle = float(np.exp(np.log(w).mean()))
    start_k = float(np.median(p.thrust_N / w**2))

    def square(values: Array) -> Array:
        return np.asarray(white @ (values[0] * w**2 + values[1] - p.thrust_N), float)

    def free(values: Array) -> Array:
        law = values[0] * (w / middle) ** values[2] + values[1]
        return np.asarray(white @ (law - p.thrust_N), float)

    rest = max(1e-3, float(error.min()))
    fixed = solve_weighted(square, (start_k, rest))
    power = solve_weighted(free, (start_k * middle**2, rest, 2.0))
    k = float(fixed.values[0])
    k_sd = float(np.hypot(sqrt(fixed.covariance[0, 0]), scale_sd * k))
    return [
        estimate_of("k", "N/(rad/s)^2", k, k_sd, fixed.dof),
        estimate_of("n", "1", float(power.values[2]), sqrt(power.covariance[2, 2]), power.dof),
    ]


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


def _exponent_of(fit: MotorFit) -> float:
    exponent = fit.value("voltage_exponent")
    return exponent if np.isfinite(exponent) else 1.0


def _to_nominal(p: ThrottlePoints, rig: Rig, exponent: float) -> Array:
    """Return what brings thrust to nominal voltage (n,); 1 where no voltage was measured."""
    ratio = rig.propulsion.voltage_nominal_V / p.voltage_V
    return np.asarray(np.where(np.isfinite(ratio), ratio, 1.0) ** (2.0 * exponent), float)
