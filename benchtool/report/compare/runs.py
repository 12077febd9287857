"""Runs and recordings as a comparison takes them, and what each does at a wanted thrust."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, hypot, isfinite, log, nan, sqrt
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from benchtool.acquire.plan import plan_from_toml
from benchtool.core.array_type import Array
from benchtool.core.channel import error_channel_name
from benchtool.core.errors import FileFormatError
from benchtool.core.recording import Recording
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.data.columns import word_to_code
from benchtool.data.derived import QuantityValues, derive_quantities, run_circumstances
from benchtool.data.levels import read_levels, split_levels
from benchtool.data.run.read import is_run, read_points, read_samples
from benchtool.data.run.run import Run
from benchtool.data.run.settings import aggregate, settings_quantities

Over = Literal["thrust", "rpm", "power", "throttle", "distance"]
AXES: dict[Over, tuple[str, str]] = {  # column and label of each axis
    "thrust": ("thrust_N", "thrust [N]"),
    "rpm": ("rpm1", "rotor speed [rpm]"),
    "power": ("power_W", "electrical power [W]"),
    "throttle": ("pwm1_us", "pulse [µs]"),
    "distance": ("plate_z_m", "plate distance [m]"),
}
LOADED = 0.02  # rows below this share of a run's greatest thrust are idle; assumed
WINDOW = log(1.5)  # rows within a factor 1.5 of a thrust make its interpolation; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ComparedRun:
    """Hold one run or recording of a comparison."""

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
        """Which rows (n,) are not idle, where quotients are noise."""
        thrust = self.rows.column("thrust_N")
        return np.asarray(thrust > LOADED * np.nanmax(thrust), bool)

    def values(self, name: str) -> tuple[Array, Array] | None:
        """Return a column or quantity with its standard errors (n,); None where it has none."""
        for one in self.quantities:
            if one.name == name:
                return one.value, one.total_error
        if name not in self.rows or not np.isfinite(self.rows.column(name)).any():
            return None
        error = error_channel_name(name)
        none = np.full(len(self.rows), np.nan)
        return self.rows.column(name), self.rows.column(error) if error in self.rows else none


def read_compared(path: Path, over: Over = "thrust") -> ComparedRun:
    """Return a run folder, a recording, or a stand's table as an import reads it.

    Slow ramps are means of half a second. Over anything but distance, other sweeps are their
    references, or all of their settings without any. Raises FileFormatError without thrust.
    """
    if is_run(path) and (ramps := _ramps(path)) is not None:
        rows, found = ramps, derive_quantities(ramps, run_circumstances(path))
        run = ComparedRun(name=path.resolve().name, path=path, rows=rows, quantities=found)
    elif is_run(path):
        points = read_points(path)
        rows, found = aggregate(points), settings_quantities(path, points)
        parked = rows.column("kind") == word_to_code("kind", "reference")
        away = bool(parked.any()) and over != "distance"
        chosen = parked if away else ~parked if over == "distance" else np.ones(len(rows), bool)
        run = ComparedRun(name=path.resolve().name, path=path, rows=rows, quantities=found)
        run = replace(_selected(run, chosen), away=away)
    else:
        rows, known = read_levels(path)
        run = ComparedRun(
            name=path.stem, path=path, rows=rows, quantities=derive_quantities(rows, known)
        )
    if run.values("thrust_N") is None:
        raise FileFormatError(str(path), "it holds no thrust, so there is nothing to compare")
    return run


SLOW_S = 5.0  # a ramp that takes so long is steady: rotors lag by tenths of a second; assumed


def _ramps(path: Path) -> Recording | None:
    """Return the means along the slow ramps of a run without a plate; None of any other run."""
    plan = plan_from_toml(Run.open(path).plan_text, str(path / "plan.toml"))
    if plan.plate.used or plan.throttle.ramp_s < SLOW_S:
        return None
    samples = read_samples(path)
    phases = [word_to_code("phase", name) for name in ("ramp", "settle", "sample")]
    return split_levels(samples.select(np.isin(samples.column("phase"), phases)))


def _selected(run: ComparedRun, chosen: NDArray[np.bool_]) -> ComparedRun:
    found = tuple(
        replace(
            one, value=one.value[chosen], standard_error=one.standard_error[chosen],
            error_sources=tuple(source.of(np.flatnonzero(chosen)) for source in one.error_sources),
        )
        for one in run.quantities
    )  # fmt: skip
    return replace(run, rows=run.rows.select(chosen), quantities=found)


@dataclass(frozen=True, slots=True)
class AtThrust:
    """Hold what a run does at a wanted thrust."""

    run: str
    values: dict[str, tuple[float, float]]  # value and standard error; nan where unknown
    remark: str = ""  # why there are no values


# power of each efficiency; the first known one ranks runs
EFFICIENCIES = {"efficiency_gf_W": "power_W", "propeller_gf_W": "mechanical_power_W"}
SHOWN = ("power_W", "mechanical_power_W", "rpm1", "pwm1_us", "figure_of_merit")  # interpolated


@np.errstate(divide="ignore", invalid="ignore")
def at_thrust(run: ComparedRun, thrust_N: float) -> AtThrust:
    """Return a run's quantities at a thrust, interpolated between its rows.

    The logarithm of each is a line, or a parabola from six rows on, in that of thrust, by least
    squares over the rows within a factor 1.5 of the thrust (two on either side at least): power is
    nearly T^1.5. An efficiency is the thrust over the interpolated power, whose error knows that
    of thrust.
    """
    # Errors that nobody states are those that the scatter of the rows shows.
    thrust, error = run.values("thrust_N") or (np.empty(0), np.empty(0))
    known = thrust[run.loaded]
    if not known.size or not known.min() <= thrust_N <= known.max():
        reached = f"reaches {known.min():.3g} to {known.max():.3g} N" if known.size else "no thrust"
        return AtThrust(run.name, {}, reached)
    found = {}
    for name in SHOWN:
        pair = run.values(name)
        if pair is None:
            continue
        value, sd = _interpolated(run, name, thrust / thrust_N, error / thrust, pair[0])
        if isfinite(value):
            found[name] = value, sd
    for name, of in EFFICIENCIES.items():
        if of in found:
            value = 1e3 * thrust_N / STANDARD_GRAVITY_M_S2 / found[of][0]
            found[name] = value, value * found[of][1] / found[of][0]
    return AtThrust(run.name, found, "" if found else "nothing is known there but thrust")


def _interpolated(
    run: ComparedRun, name: str, thrust: Array, thrust_error: Array, values: Array
) -> tuple[float, float]:
    """Return value and standard error where thrust over the wanted one (n,) is 1."""
    apart = np.log(thrust)
    one = next((one for one in run.quantities if one.name == name), None)
    pair = run.values(name)
    own = one.standard_error if one is not None else pair[1] if pair else np.empty(0)
    good = run.loaded & np.isfinite(apart) & np.isfinite(values) & (values > 0.0)
    below, above = (np.flatnonzero(good & side) for side in (apart <= 0.0, apart >= 0.0))
    if not below.size or not above.size:
        return nan, nan
    near = good & (np.abs(apart) <= WINDOW)
    near[below[np.argsort(-apart[below])[:2]]] = True
    near[above[np.argsort(apart[above])[:2]]] = True
    x, y = apart[near], np.log(values[near])
    degree = 2 if near.sum() >= 6 else 1
    if np.ptp(x) < 1e-12:  # every row is at that thrust
        degree = 0
    design = np.vander(x, degree + 1, increasing=True)
    slope = float(np.polyfit(x, y, 1)[0]) if degree else 0.0
    sigma = np.hypot(own[near] / values[near], slope * thrust_error[near])
    stated = bool(np.isfinite(sigma).all() and (sigma > 0.0).all())
    weight = 1.0 / sigma if stated else np.ones(len(x))
    gain = np.linalg.pinv(design * weight[:, None]) * weight  # (p, m): coefficients of rows
    residual = (y - design @ (gain @ y)) * weight
    free = len(x) - design.shape[1]
    spread = float(residual @ residual) / free if free > 0 else nan
    if not stated:
        spread = _scatter(apart[good], np.log(values[good]), spread)
    scale = max(1.0, spread if isfinite(spread) else 1.0) if stated else spread
    sd = sqrt(scale) * float(np.linalg.norm(gain[0] / weight))
    value = exp(float(gain[0] @ y))
    shared = 0.0
    for source in one.error_sources if one is not None else ():
        moved = source.columns[near] / values[near, None]
        if source.name == "thrust scale":
            moved = moved - slope * source.sd
        shared = hypot(shared, float(np.linalg.norm(gain[0] @ moved)))
    if one is not None and not any(s.name == "thrust scale" for s in one.error_sources):
        scales = (s.sd for q in run.quantities for s in q.error_sources if s.name == "thrust scale")
        shared = hypot(shared, slope * next(scales, 0.0))
    return value, value * hypot(sd, shared)


def _scatter(x: Array, y: Array, local: float) -> float:
    """Return the variance of rows about a cubic over the upper 90 % of thrust; `local` for few."""
    upper = x > x.max() - log(10.0)
    free = int(upper.sum()) - 4
    if free < 3:
        return local
    left = y[upper] - np.polyval(np.polyfit(x[upper], y[upper], 3), x[upper])
    return float(left @ left) / free


def ranked(results: Sequence[AtThrust]) -> tuple[str, list[AtThrust]]:
    """Return by what runs are ranked, and those that have it, the best first, then the others."""
    known = (key for key in EFFICIENCIES if any(key in one.values for one in results))
    by = next(known, next(iter(EFFICIENCIES)))
    return by, sorted(
        results, key=lambda one: one.values[by][0] if by in one.values else -1.0, reverse=True
    )
