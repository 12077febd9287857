"""The figures of a sweep's run, from its folder to the report's plain arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchtool.data.columns import code_of
from benchtool.fit.model_band import Believed
from benchtool.fit.swept import Swept
from benchtool.report.fit.curves import (
    band_of,
    bands_over,
    conditions_over,
    factor_over,
    formula_curves,
    values_at,
)
from benchtool.report.page import Figure
from benchtool.report.palette import Role
from benchtool.report.sweep.distance import DistanceSeries, distance_figure
from benchtool.report.sweep.ground_effect import Curve, RatioPoints, ratio_figure
from benchtool.report.sweep.order import Order, order_figure
from benchtool.report.sweep.sweep import PointWindow, SweepTraces, sweep_figure
from benchtool.report.sweep.visits import Visits, visits_figure

Array = NDArray[np.float64]

RUN_ROLES: tuple[Role, ...] = (
    "single_rotor",
    "second_rig",
    "three_rotors",
    "measurement",
    "muted",
)
"""Colours and markers of several runs in one figure, in their order."""


def speeds_of(run: Swept) -> Array:
    """Return the speeds (n_rotors, 1) of the setting whose rotors turn fastest: rad/s."""
    n = run.rig.n_rotors
    speeds = np.array([run.column(f"rpm{rotor + 1}") for rotor in range(n)]) * np.pi / 30.0
    if not np.isfinite(speeds).any():
        p = run.rig.propulsion
        pulses = np.array([run.column(f"pwm{rotor + 1}_us") for rotor in range(n)])
        speeds = p.speed_per_us_rad_s * np.maximum(pulses - p.pwm_start_us, 0.0)
    speeds = np.nan_to_num(speeds)
    return np.asarray(speeds[:, [int(np.argmax(speeds.sum(axis=0)))]], float)


def plain(run: Swept) -> NDArray[np.bool_]:
    """Tell which settings have a level plate in the middle (s,): those a curve stands for."""
    level: NDArray[np.bool_] = run.measured()
    for name in ("plate_tilt_deg", "plate_x_m"):
        level = level & (np.abs(np.nan_to_num(run.column(name))) < 1e-6)
    return level


def run_points(run: Swept, label: str, role: Role = "measurement") -> list[RatioPoints]:
    """Return the measured ratios of a run; settings with a tilted or shifted plate apart."""
    z, straight, near = run.z_over_R(run.settings), plain(run), run.measured()
    out = []
    for rows, name, own in (
        (straight, label, role),
        (near & ~straight, f"{label}, plate tilted or to the side", "muted"),
    ):
        rows = rows & np.isfinite(run.ratio)
        if rows.any():
            out.append(RatioPoints(z[rows], run.ratio[rows], run.ratio_error[rows], name, own))
    return out


def run_ratio(run: Swept, model: Believed | None) -> Figure | None:
    """Draw T_IGE/T_OGE of a run over the closed formulae and a model with its bands."""
    points = run_points(run, f"{'simulated bench' if run.simulated else 'measured'}, mean ± error")
    if not points:
        return None
    speeds, z = speeds_of(run), _distances(points)
    curves = formula_curves(run.rig, speeds, z)
    if model is not None:
        curves.insert(0, model_curve(model, speeds, z))
    return ratio_figure(
        points, curves, title=f"Ground effect: {run.name}", simulated=run.simulated, basis=run.basis
    )


def runs_ratio(runs: list[Swept], model: Believed | None) -> Figure | None:
    """Draw T_IGE/T_OGE of several runs, each with its own marker."""
    points = [
        item
        for place, run in enumerate(runs)
        for item in run_points(run, run.name, RUN_ROLES[place % len(RUN_ROLES)])
    ]
    if not points:
        return None
    first, z = runs[0], _distances(points)
    curves = formula_curves(first.rig, speeds_of(first), z)[-1:]
    if model is not None:
        curves.insert(0, model_curve(model, speeds_of(first), z))
    return ratio_figure(
        points,
        curves,
        title="Runs compared",
        simulated=any(run.simulated for run in runs),
        basis=first.basis,
    )


def model_curve(model: Believed, speed_rad_s: Array, z_over_R: Array) -> Curve:
    """Return a model's curve with the bands of its uncertain numbers."""
    middle = factor_over(model.model, speed_rad_s, z_over_R)
    bands = bands_over(model.model, speed_rad_s, z_over_R, model.draws)
    label = f"{'fit' if model.fitted_to else 'model'}: {model.model.name}"
    return Curve(z_over_R, middle, label, "body_lift", "fit", bands)


def _distances(points: list[RatioPoints]) -> Array:
    farthest = max(float(np.nanmax(item.z_over_R)) for item in points)
    return np.linspace(0.5, max(1.1 * farthest, 2.0), 240)


def thrust_distance(run: Swept, model: Believed | None) -> Figure:
    """Draw thrust against plate distance, one colour per throttle level."""
    levels, near = run.level_us(), run.measured() & plain(run)
    z, thrust = run.z_over_R(run.settings), run.settings.column("thrust_N")
    if not near.any():
        near = run.measured()
    series = []
    for level in np.unique(levels[near]):
        rows = np.flatnonzero(near & (levels == level))
        rows = rows[np.argsort(z[rows], kind="stable")]
        away = ~run.measured() & (levels == level)
        series.append(
            DistanceSeries(
                label=f"{level:g} µs",
                z_over_R=z[rows],
                thrust_N=thrust[rows],
                error_N=run.thrust_error_N[rows],
                away_N=float(np.mean(thrust[away])) if away.any() else float("nan"),
                **(_model_line(run, model, rows) if model is not None else {}),
            )
        )
    name = "" if model is None else model.model.name
    return distance_figure(
        series, title=f"Thrust against distance: {run.name}", simulated=run.simulated, model=name
    )


def _model_line(run: Swept, model: Believed, rows: NDArray[np.intp]) -> dict[str, Array]:
    """Return the model's thrust at one level's mean speeds, with its 95 % band."""
    n = run.rig.n_rotors
    rpm = np.array([np.nanmean(run.column(f"rpm{rotor + 1}")[rows]) for rotor in range(n)])
    if not np.isfinite(rpm).all():
        return {}
    z = run.z_over_R(run.settings)[rows]
    at = np.linspace(max(0.5, 0.9 * float(z.min())), 1.05 * float(z.max()), 160)
    conditions = conditions_over(run.rig, rpm[:, None] * np.pi / 30.0, at)
    line = np.broadcast_to(model.model.thrust_N(conditions), at.shape)
    if not model.draws:
        return {"line_z_over_R": at, "line_N": line}
    spread = model.model.thrust_N(conditions, values_at(model.model, model.draws))
    band = band_of(np.broadcast_to(np.asarray(spread, float), (len(spread), len(at))), 95)
    return {"line_z_over_R": at, "line_N": line, "lower_N": band.lower, "upper_N": band.upper}


def samples_over_time(run: Swept) -> Figure | None:
    """Draw every sample with the stretches that became points."""
    if run.samples is None:
        return None
    return sweep_figure(
        SweepTraces.from_recording(run.samples),
        _windows(run),
        title=f"Every sample: {run.name}",
        simulated=run.simulated,
        radius_m=run.rig.propulsion.radius_m,
    )


def _windows(run: Swept) -> list[PointWindow]:
    assert run.samples is not None
    number, time_s = run.samples.column("point"), run.samples.column("time_s")
    sampled = run.samples.column("phase") == code_of("phase", "sample")
    kinds = dict(zip(run.points.column("point"), run.kinds, strict=True))
    windows = []
    for point, kind in kinds.items():
        rows = np.flatnonzero(sampled & (number == point))
        if rows.size:
            windows.append(PointWindow(float(time_s[rows[0]]), float(time_s[rows[-1]]), kind))
    return windows


def raw_beside_averaged(run: Swept) -> Figure | None:
    """Draw the raw samples of every visit beside their mean.

    With a calibration the raw counts go through its slope about the visit's own mean.
    """
    samples, points = run.samples, run.points
    if samples is None:
        return None
    calibration = run.metadata.get("calibration") or {}
    slope = float(calibration.get("slope_N_per_count", np.nan))
    name = "thrust_raw" if np.isfinite(slope) and "thrust_raw" in samples else "thrust_N"
    if name not in samples:
        return None
    rows = samples.column("phase") == code_of("phase", "sample")
    rows &= np.isfinite(samples.column(name))
    number, values = samples.column("point")[rows], samples.column(name)[rows]
    if name == "thrust_raw":
        counts, values = values, np.full(values.shape, np.nan)
        means = zip(points.column("point"), points.column("thrust_N"), strict=True)
        for point, mean in means:
            own = number == point
            if own.any():
                values[own] = mean + slope * (counts[own] - counts[own].mean())
    return visits_figure(
        Visits(
            number=points.column("point"),
            kind=run.kinds,
            mean_N=points.column("thrust_N"),
            sd_N=points.column("thrust_sd_N"),
            se_N=points.column("thrust_se_N"),
            sample_number=number,
            sample_N=values,
        ),
        title=f"Raw samples beside their means: {run.name}",
        simulated=run.simulated,
    )


def order_and_drift(run: Swept, residual_N: float) -> Figure:
    """Draw the order of measurement, anchors and tares."""
    anchor_s, anchor_N, anchor_se_N = anchor_changes(run)
    tares, none = run.tares, np.empty(0)
    return order_figure(
        Order(
            time_s=run.points.column("time_s"),
            z_over_R=run.z_over_R(run.points),
            kind=run.kinds,
            anchor_s=anchor_s,
            anchor_N=anchor_N,
            anchor_se_N=anchor_se_N,
            tare_s=none if tares is None else tares.column("time_s"),
            tare_N=none if tares is None else tares.column("thrust_N"),
            tare_se_N=none if tares is None else tares.column("thrust_se_N"),
            residual_N=residual_N,
        ),
        title=f"Order, anchors and tares: {run.name}",
        simulated=run.simulated,
    )


def anchor_changes(run: Swept) -> tuple[Array, Array, Array]:
    """Return time, change since the first and its standard error of the anchors (a,) each.

    Thrust is brought to the first anchor's summed squared speed, so that a battery that sags is
    not taken for a load cell that drifts.
    """
    rows = np.flatnonzero(np.array([kind == "anchor" for kind in run.kinds]))
    part = run.points.select(rows)
    if not rows.size:
        return np.empty(0), np.empty(0), np.empty(0)
    squares = np.zeros(len(part))
    for name in part.names:
        if name.startswith("rpm") and not name.endswith("_se"):
            squares = squares + np.nan_to_num(part.column(name)) ** 2
    scale = np.divide(squares[0], squares, out=np.ones(len(part)), where=squares > 0.0)
    thrust, se = part.column("thrust_N") * scale, part.column("thrust_se_N")
    change = thrust - thrust[0]
    error = np.hypot(se, se[0])
    error[0] = 0.0
    return part.column("time_s"), change, error
