"""T_IGE/T_OGE against z/R: measured points, model curves with bands, closed-form equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.physics import VALIDITY_Z_OVER_R
from benchtool.physics.bases import ground_effect_ratio
from benchtool.physics.conditions import Conditions
from benchtool.physics.distance_law import CONTACT_Z_OVER_R
from benchtool.physics.effects.neighbour_images import EFFECT as NEIGHBOUR_IMAGES
from benchtool.physics.model import Model
from benchtool.report.figure import legend_patch
from benchtool.report.palette import DASHED, GREY, SERIES_STYLES, Role
from benchtool.report.panels import points

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


DISTANCE_LABEL = "distance to the plate  $z/R$ [–]"
BASES: dict[str, str] = {  # quantity that is equal for both thrusts of a ratio
    "equal_power": "equal electrical power",
    "equal_pwm": "equal pwm",
    "equal_rpm2": "equal rpm²",
}
_DASHES: dict[str, Any] = {"fit": "-", "formula": DASHED}
_BAND_ALPHA: dict[float, float] = {68: 0.30, 95: 0.13}


@dataclass(frozen=True, slots=True, eq=False)
class RatioPoints:
    """Measured or simulated thrust ratios."""

    z_over_R: Array  # (m,) dimensionless
    ratio: Array  # (m,) dimensionless
    sd: Array  # (m,) length of the error bars; nan for none
    label: str
    role: Role = "measurement"
    left_out: NDArray[np.bool_] | None = None  # (m,) True: excluded from the fit, drawn hollow


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Interval of a curve at one level: lower and upper (m,), level in percent."""

    lower: Array
    upper: Array
    level: float = 68


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Model curve."""

    z_over_R: Array  # (m,) dimensionless
    ratio: Array  # (m,) dimensionless
    label: str
    role: Role = "formula"
    style: Literal["fit", "formula"] = "formula"  # solid or dashed
    bands: tuple[Band, ...] = ()  # statistical, at most one per level
    nearest_z_over_R: float = VALIDITY_Z_OVER_R  # lower end of the drawn range

    @property
    def valid(self) -> NDArray[np.bool_]:
        """True within the validity range of the curve's law (m,)."""
        return np.asarray(self.z_over_R >= self.nearest_z_over_R, bool)


def conditions_over(rig: Rig, speed_rad_s: Array, z_over_R: Array) -> Conditions:
    """Return conditions of a level plate under every disc; z/R (m,), speeds (n_rotors, 1)."""
    plate_z_m, coverage = z_over_R * rig.propulsion.radius_m, np.ones((rig.n_discs, 1))
    return Conditions.build(rig, speed_rad_s=speed_rad_s, plate_z_m=plate_z_m, coverage=coverage)


def ratio_values(model: Model, draws: Mapping[str, Array] | None = None) -> list[Any]:
    """Return all parameter values of a model; draws (d, 1) replace the model's values."""
    drawn = draws or {}
    return [drawn.get(name, item.value) for name, item in model.parameters.items()]


def factor_at_distance(
    model: Model,
    speed_rad_s: Array,
    z_over_R: Array,
    draws: Mapping[str, Array] | None = None,
    basis: str = "equal_rpm2",
) -> Any:
    """Return T_IGE/T_OGE (m,) at a basis, or (d, m) with draws."""
    conditions = conditions_over(model.rig, speed_rad_s, z_over_R)
    return ground_effect_ratio(model, basis, conditions, ratio_values(model, draws))


def uncertainty_band(ratio_draws: Array, level: float) -> Band:
    """Return the central interval of draws (d, m) at a level in percent."""
    lower, upper = np.percentile(ratio_draws, [50.0 - level / 2.0, 50.0 + level / 2.0], axis=0)
    return Band(lower, upper, level)


def uncertainty_bands(
    model: Model,
    speed_rad_s: Array,
    z_over_R: Array,
    draws: Mapping[str, Array],
    basis: str = "equal_rpm2",
    levels: Sequence[float] = (68, 95),
) -> tuple[Band, ...]:
    """Return the bands of a model curve at levels in percent; empty without draws."""
    if not draws:
        return ()
    ratio_draws = np.asarray(factor_at_distance(model, speed_rad_s, z_over_R, draws, basis), float)
    ratio_draws = np.broadcast_to(ratio_draws, (len(next(iter(draws.values()))), len(z_over_R)))
    return tuple(uncertainty_band(ratio_draws, level) for level in levels)


def model_curve(
    model: Model,
    speed_rad_s: Array,
    z_over_R: Array,
    draws: Mapping[str, Array],
    basis: str,
    label: str,
    levels: Sequence[float] = (68, 95),
) -> Curve:
    """Return the curve of a model, with its bands if there are draws."""
    ratio = factor_at_distance(model, speed_rad_s, z_over_R, basis=basis)
    bands = uncertainty_bands(model, speed_rad_s, z_over_R, draws, basis, levels)
    return Curve(z_over_R, ratio, label, "model", "fit", bands, model.nearest_z_over_R)


def formula_curves(rig: Rig, speed_rad_s: Array, z_over_R: Array) -> list[Curve]:
    """Return the curve of eq. (2), and of eq. (3) if more than one rotor turns."""
    single = Model.single(rig)
    turning = int(np.asarray(speed_rad_s > 0.0).sum())
    alone = factor_at_distance(single, speed_rad_s, z_over_R)
    curves = [Curve(z_over_R, alone, "eq. (2), one rotor", "formula")]
    if turning > 1:
        images = single.with_effect(NEIGHBOUR_IMAGES)
        label = f"eq. (3), {turning} rotors" if turning != 4 else "eq. (3), quadrotor"
        curves.append(
            Curve(z_over_R, factor_at_distance(images, speed_rad_s, z_over_R), label, "quad")
        )
    return curves


def curve_distances(series: Sequence[RatioPoints], model: Model | None = None) -> Array:
    """Return z/R (240,) from the lower end of validity to 1.1 times the last point, at least 2."""
    nearest = VALIDITY_Z_OVER_R if model is None else model.nearest_z_over_R
    farthest = max(float(np.nanmax(item.z_over_R)) for item in series)
    return np.linspace(min(nearest, VALIDITY_Z_OVER_R), max(1.1 * farthest, 2.0), 240)


def draw_ratio(
    figure: Figure, series: Sequence[RatioPoints], curves: Sequence[Curve], basis: str
) -> None:
    """Draw thrust ratios over curves with bands; distances outside validity are hatched."""
    axes = figure.subplots()
    for item in series:
        _draw_points(axes, item)
    for curve in curves:
        _draw_curve(axes, curve)
    axes.axhline(1.0, color=GREY, linewidth=0.9, zorder=0.5)
    nearest = min((curve.nearest_z_over_R for curve in curves), default=VALIDITY_Z_OVER_R)
    if nearest > CONTACT_Z_OVER_R:
        axes.axvspan(
            0.0, nearest, facecolor="none", edgecolor=GREY, hatch="////", alpha=0.45, lw=0.0
        )
        axes.text(
            nearest / 2.0, 0.5, "outside the validity range of the formulae",
            transform=axes.get_xaxis_transform(), rotation=90, ha="center", va="center", fontsize=8,
            color=GREY, bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5, "alpha": 0.9},
        )  # fmt: skip
    ylabel = "$T_{IGE}\\,/\\,T_{OGE}$ [–]  at " + BASES[basis]
    axes.set(xlabel=DISTANCE_LABEL, ylabel=ylabel)
    distances = np.concatenate(
        [[1.0], *(item.z_over_R for item in series), *(item.z_over_R for item in curves)]
    )
    axes.set_xlim(0.0, 1.03 * float(distances[np.isfinite(distances)].max()))
    axes.set_ylim(*_limits(series, curves))
    _legend(axes, curves)


def _draw_curve(axes: Axes, curve: Curve) -> None:
    color, valid = SERIES_STYLES[curve.role].color, curve.valid
    z = curve.z_over_R[valid]
    for band in sorted(curve.bands, key=lambda item: -item.level):
        axes.fill_between(
            z, band.lower[valid], band.upper[valid], color=color, alpha=_BAND_ALPHA[band.level],
            linewidth=0.0, gid=f"band-{band.level}",
        )  # fmt: skip
    axes.plot(
        z, curve.ratio[valid], color=color, linestyle=_DASHES[curve.style], label=curve.label,
        zorder=2.0 if curve.style == "fit" else 2.2,
    )  # fmt: skip


def _draw_points(axes: Axes, series: RatioPoints) -> None:
    style = SERIES_STYLES[series.role]
    is_excluded = np.zeros(series.ratio.shape, bool) if series.left_out is None else series.left_out
    for rows, fill, label in (
        (~is_excluded, style.color, series.label),
        (is_excluded, "white", f"{series.label}, excluded from the fit"),
    ):
        if rows.any():
            points(
                axes, series.z_over_R[rows], series.ratio[rows], series.sd[rows], style.color,
                style.marker, mfc=fill, mec=style.color, elinewidth=1.2, capsize=3.5, label=label,
                zorder=3,
            )  # fmt: skip


def _limits(series: Sequence[RatioPoints], curves: Sequence[Curve]) -> tuple[float, float]:
    values = [1.0]
    for points_drawn in series:
        sd = np.nan_to_num(points_drawn.sd)
        values += [*(points_drawn.ratio - sd), *(points_drawn.ratio + sd)]
    for curve in curves:
        for line in (curve.ratio, *(band.upper for band in curve.bands)):
            values += list(line[curve.valid])
    finite = np.array([ratio for ratio in values if np.isfinite(ratio)])
    span = max(finite.max() - finite.min(), 0.02)
    return float(finite.min() - 0.05 * span), float(finite.max() + 0.06 * span)


LINE_SHARE = 0.006  # line width over axes height, approximately


def _legend(axes: Axes, curves: Sequence[Curve]) -> None:
    """Add a legend: measured series, then curves, then band levels."""
    from matplotlib.container import ErrorbarContainer

    entries = list(zip(*axes.get_legend_handles_labels(), strict=True))
    entries.sort(key=lambda entry: not isinstance(entry[0], ErrorbarContainer))
    for level in sorted({band.level for curve in curves for band in curve.bands}):
        patch = legend_patch(facecolor=GREY, alpha=2.0 * _BAND_ALPHA[level], linewidth=0.0)
        widest = max(
            float(np.nanmax((band.upper - band.lower)[curve.valid], initial=0.0))
            for curve in curves
            for band in curve.bands
            if band.level == level
        )
        low, high = axes.get_ylim()
        thin = ", thinner than its line" if widest < LINE_SHARE * (high - low) else ""
        entries.append((patch, f"{level} % band of the fit{thin}"))
    if entries:
        axes.legend(*map(list, zip(*entries, strict=True)), loc="upper right")
