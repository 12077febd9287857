"""Runs and recordings of a comparison, and their values at a requested thrust."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, hypot, isfinite, log, nan, sqrt
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchtool.acquire.plan import plan_from_toml
from benchtool.core.channel import error_channel_name
from benchtool.core.choices import Over
from benchtool.core.errors import FileFormatError
from benchtool.core.recording import Recording
from benchtool.core.units import STANDARD_GRAVITY_M_S2, Array
from benchtool.data.columns import word_to_code
from benchtool.data.derived import QuantityValues, derive_quantities, load_run_context
from benchtool.data.levels import read_levels, split_levels
from benchtool.data.run.points import average_settings, settings_quantities
from benchtool.data.run.read import is_run, read_points, read_samples
from benchtool.data.run.run import Run

AXES: dict[Over, tuple[str, str]] = {  # column and label of each axis
    "thrust": ("thrust_N", "thrust [N]"),
    "rpm": ("rpm1", "rotor speed [rpm]"),
    "power": ("power_W", "electrical power [W]"),
    "throttle": ("pwm1_us", "pulse [µs]"),
    "distance": ("plate_z_m", "plate distance [m]"),
}
LOADED = 0.02  # rows below this share of a run's maximum thrust are idle; assumed
WINDOW = log(1.5)  # interpolation uses rows within a factor 1.5 of the thrust; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ComparedRun:
    """Run or recording of a comparison."""

    name: str
    path: Path
    rows: Recording  # settings of a sweep, or levels of a recording
    quantities: tuple[QuantityValues, ...]
    away: bool = False  # rows with the plate parked

    @property
    def simulated(self) -> bool:
        return self.rows.simulated

    @property
    def loaded(self) -> NDArray[np.bool_]:
        """True for rows (n,) that are not idle; ratios of idle rows are noise."""
        thrust = self.rows.column("thrust_N")
        return np.asarray(thrust > LOADED * np.nanmax(thrust), bool)

    def values(self, name: str) -> tuple[Array, Array] | None:
        """Return a column or quantity with its standard errors (n,), or None if it is missing."""
        for quantity in self.quantities:
            if quantity.name == name:
                return quantity.value, quantity.total_error
        if name not in self.rows or not np.isfinite(self.rows.column(name)).any():
            return None
        error = error_channel_name(name)
        none = np.full(len(self.rows), np.nan)
        return self.rows.column(name), self.rows.column(error) if error in self.rows else none


def read_compared(path: Path, over: Over = "thrust") -> ComparedRun:
    """Read a run folder, a recording, or the CSV file of a test stand.

    Slow ramps are averaged over half a second. Sweeps over distance use all settings but the
    references; other sweeps use the references, or all settings if there are none.

    Raises:
        FileFormatError: the data has no thrust.
    """
    name, away = path.resolve().name, False
    if not is_run(path):
        name, (rows, context) = path.stem, read_levels(path)
        quantities = derive_quantities(rows, context)
    elif (ramps := _ramps(path)) is not None:
        rows, quantities = ramps, derive_quantities(ramps, load_run_context(path))
    else:
        points = read_points(path)
        rows, quantities = average_settings(points), settings_quantities(path, points)
        parked = rows.column("kind") == word_to_code("kind", "reference")
        away = bool(parked.any()) and over != "distance"
        if away or over == "distance":
            selected = np.flatnonzero(parked if away else ~parked)
            rows = rows.select(selected)
            quantities = tuple(
                replace(
                    quantity,
                    value=quantity.value[selected],
                    standard_error=quantity.standard_error[selected],
                    error_sources=tuple(part.select(selected) for part in quantity.error_sources),
                )
                for quantity in quantities
            )
    run = ComparedRun(name=name, path=path, rows=rows, quantities=quantities, away=away)
    if run.values("thrust_N") is None:
        raise FileFormatError(str(path), "thrust is missing, required for a comparison")
    return run


MIN_RAMP_S = 5.0  # slower ramps are quasi-steady: rotor lags are tenths of a second; assumed


def _ramps(path: Path) -> Recording | None:
    """Return the means along slow ramps of a run without a plate; None for other runs."""
    plan = plan_from_toml(Run.open(path).plan_text, str(path / "plan.toml"))
    if plan.plate.used or plan.throttle.ramp_s < MIN_RAMP_S:
        return None
    samples = read_samples(path)
    phases = [word_to_code("phase", name) for name in ("ramp", "settle", "sample")]
    return split_levels(samples.select(np.isin(samples.column("phase"), phases)))


@dataclass(frozen=True, slots=True)
class AtThrust:
    """Values of a run at a requested thrust."""

    run: str
    values: dict[str, tuple[float, float]]  # value and standard error; nan where unknown
    remark: str = ""  # reason for missing values


# power of each efficiency; the first available efficiency ranks runs
EFFICIENCIES = {"efficiency_gf_W": "power_W", "propeller_gf_W": "mechanical_power_W"}
SHOWN = ("power_W", "mechanical_power_W", "rpm1", "pwm1_us", "figure_of_merit")  # interpolated


@np.errstate(divide="ignore", invalid="ignore")
def at_thrust(run: ComparedRun, thrust_N: float) -> AtThrust:
    """Return the quantities of a run at a thrust, interpolated between its rows.

    A least-squares polynomial of log value over log thrust is used, linear below six rows, else
    quadratic, over rows within a factor 1.5 of the thrust (at least two on either side): power is
    nearly T^1.5. An efficiency is the thrust over the interpolated power; the error of the power
    includes that of thrust.
    """
    thrust, error = run.values("thrust_N") or (np.empty(0), np.empty(0))
    loaded = thrust[run.loaded]
    if not loaded.size or not loaded.min() <= thrust_N <= loaded.max():
        problem = (
            f"reaches {loaded.min():.3g} to {loaded.max():.3g} N" if loaded.size else "no thrust"
        )
        return AtThrust(run.name, {}, problem)
    values = {}
    for name in SHOWN:
        if (pair := run.values(name)) is None:
            continue
        value, sd = _interpolate(run, name, thrust / thrust_N, error / thrust, *pair)
        if isfinite(value):
            values[name] = value, sd
    for name, power in EFFICIENCIES.items():
        if power in values:
            value = 1e3 * thrust_N / STANDARD_GRAVITY_M_S2 / values[power][0]
            values[name] = value, value * values[power][1] / values[power][0]
    return AtThrust(run.name, values, "" if values else "no quantities but thrust")


def _interpolate(
    run: ComparedRun, name: str, thrust: Array, thrust_error: Array, values: Array, errors: Array
) -> tuple[float, float]:
    """Return value and standard error at relative thrust 1; `thrust` (n,) is relative.

    Without stated errors, they are estimated from the scatter of the rows.
    """
    log_thrust = np.log(thrust)
    quantity = next((quantity for quantity in run.quantities if quantity.name == name), None)
    own_errors = errors if quantity is None else quantity.standard_error
    usable = run.loaded & np.isfinite(log_thrust) & np.isfinite(values) & (values > 0.0)
    below, above = (
        np.flatnonzero(usable & side) for side in (log_thrust <= 0.0, log_thrust >= 0.0)
    )
    if not below.size or not above.size:
        return nan, nan
    near = usable & (np.abs(log_thrust) <= WINDOW)
    near[below[np.argsort(-log_thrust[below])[:2]]] = True
    near[above[np.argsort(log_thrust[above])[:2]]] = True
    x, y = log_thrust[near], np.log(values[near])
    degree = 2 if near.sum() >= 6 else 1
    if np.ptp(x) < 1e-12:  # every row is at that thrust
        degree = 0
    design = np.vander(x, degree + 1, increasing=True)
    slope = float(np.polyfit(x, y, 1)[0]) if degree else 0.0
    sigma = np.hypot(own_errors[near] / values[near], slope * thrust_error[near])
    has_errors = bool(np.isfinite(sigma).all() and (sigma > 0.0).all())
    weight = 1.0 / sigma if has_errors else np.ones(len(x))
    coefficients = np.linalg.pinv(design * weight[:, None]) * weight  # (p, m): coefficients of rows
    residual = (y - design @ (coefficients @ y)) * weight
    dof = len(x) - design.shape[1]
    variance = float(residual @ residual) / dof if dof > 0 else nan
    if not has_errors:
        variance = _scatter(log_thrust[usable], np.log(values[usable]), variance)
    scale = max(1.0, variance if isfinite(variance) else 1.0) if has_errors else variance
    sd = sqrt(scale) * float(np.linalg.norm(coefficients[0] / weight))
    value = exp(float(coefficients[0] @ y))
    shared = 0.0
    for source in quantity.error_sources if quantity is not None else ():
        sensitivities = source.columns[near] / values[near, None]
        if source.name == "thrust scale":
            sensitivities = sensitivities - slope * source.sd
        shared = hypot(shared, float(np.linalg.norm(coefficients[0] @ sensitivities)))
    if quantity is not None and not any(s.name == "thrust scale" for s in quantity.error_sources):
        scales = (s.sd for q in run.quantities for s in q.error_sources if s.name == "thrust scale")
        shared = hypot(shared, slope * next(scales, 0.0))
    return value, value * hypot(sd, shared)


def _scatter(x: Array, y: Array, local: float) -> float:
    """Return the variance about a cubic over the upper decade of thrust; `local` for few rows."""
    upper = x > x.max() - log(10.0)
    dof = int(upper.sum()) - 4
    if dof < 3:
        return local
    residuals = y[upper] - np.polyval(np.polyfit(x[upper], y[upper], 3), x[upper])
    return float(residuals @ residuals) / dof


def ranked(results: Sequence[AtThrust]) -> tuple[str, list[AtThrust]]:
    """Return the ranking efficiency and the sorted results, best first, results without it last."""
    available = (key for key in EFFICIENCIES if any(key in item.values for item in results))
    by = next(available, next(iter(EFFICIENCIES)))
    return by, sorted(
        results, key=lambda item: item.values[by][0] if by in item.values else -1.0, reverse=True
    )
