"""T_IGE/T_OGE against z/R: the picture that the whole project is about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from benchtool.physics.validity import VALIDITY_Z_OVER_R
from benchtool.report.fit.lengths import refuse_unequal
from benchtool.report.palette import GREY, LOOKS, Role
from benchtool.report.style import new_figure, ratio_label, styled

Array = NDArray[np.float64]

_DASHES = {"fit": "-", "formula": (0, (5, 2.2)), "other": (0, (1.2, 1.6))}
_BAND_ALPHA = {68: 0.30, 95: 0.13}


@dataclass(frozen=True, slots=True, eq=False)
class RatioPoints:
    """Hold measured (or simulated) thrust ratios.

    Attributes:
        z_over_R, ratio: (m,) each, dimensionless.
        sd: (m,) standard deviation over repeats; nan where there was one repeat, which then has
            no error bar.
        label: legend entry.
        role: what it is; gives colour and marker.
        left_out: (m,) True for points that the fit left out, drawn hollow; None when all were used.
    """

    z_over_R: Array
    ratio: Array
    sd: Array
    label: str
    role: Role = "measurement"
    left_out: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        refuse_unequal(
            f"the series {self.label!r}",
            z_over_R=self.z_over_R,
            ratio=self.ratio,
            sd=self.sd,
            left_out=None if self.left_out is None else self.left_out.astype(float),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Hold the interval of a curve at one level: lower and upper (m,), level in per cent."""

    lower: Array
    upper: Array
    level: Literal[68, 95] = 68


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Hold a model's curve.

    Attributes:
        z_over_R, ratio: (m,) each, dimensionless.
        label: legend entry.
        role: what it is; gives the colour.
        style: "fit" (solid), "formula" (dashed, as the paper draws its PFI curves) or
            "other" (dotted).
        bands: intervals of the curve, at most one per level.
    """

    z_over_R: Array
    ratio: Array
    label: str
    role: Role = "formula"
    style: Literal["fit", "formula", "other"] = "formula"
    bands: tuple[Band, ...] = ()

    def __post_init__(self) -> None:
        refuse_unequal(f"the curve {self.label!r}", z_over_R=self.z_over_R, ratio=self.ratio)
        for band in self.bands:
            refuse_unequal(
                f"the {band.level} % band of {self.label!r}",
                z_over_R=self.z_over_R,
                lower=band.lower,
                upper=band.upper,
            )


@styled
def ratio_figure(
    points: Sequence[RatioPoints],
    curves: Sequence[Curve],
    *,
    title: str,
    simulated: bool,
    basis: str,
    validity_limit: float = VALIDITY_Z_OVER_R,
) -> Figure:
    """Draw thrust ratios with error bars over model curves with their bands.

    Args:
        points: series of measured ratios.
        curves: model curves; parts below the validity limit are not drawn.
        title: one line that says what is to be seen.
        simulated: whether the points come from no physical bench.
        basis: what is held equal, one of `style.BASES`.
        validity_limit: z/R below which the region is hatched.
    """
    figure = new_figure(title, simulated=simulated, height_in=4.5)
    axes = figure.subplots()
    for series in points:
        _draw_points(axes, series)
    for curve in curves:
        _draw_curve(axes, curve, validity_limit)
    axes.axhline(1.0, color=GREY, linewidth=0.9, zorder=0.5)
    axes.axvspan(
        0.0, validity_limit, facecolor="none", edgecolor=GREY, hatch="////", alpha=0.45, lw=0.0
    )
    axes.text(
        validity_limit / 2.0,
        0.5,
        "outside the validity of the formulae",
        transform=axes.get_xaxis_transform(),
        rotation=90,
        ha="center",
        va="center",
        fontsize=8,
        color=GREY,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5, "alpha": 0.9},
    )
    axes.set_xlabel("distance to the plate  $z/R$ [–]")
    axes.set_ylabel(ratio_label(basis))
    distances = np.concatenate(
        [[1.0], *(series.z_over_R for series in points), *(curve.z_over_R for curve in curves)]
    )
    axes.set_xlim(0.0, 1.03 * float(distances[np.isfinite(distances)].max()))
    axes.set_ylim(*_limits(points, curves, validity_limit))
    _legend(axes, curves)
    return figure


def _draw_curve(axes: Axes, curve: Curve, validity_limit: float) -> None:
    color = LOOKS[curve.role].color
    valid = curve.z_over_R >= validity_limit
    z = curve.z_over_R[valid]
    for band in sorted(curve.bands, key=lambda item: -item.level):
        axes.fill_between(
            z,
            band.lower[valid],
            band.upper[valid],
            color=color,
            alpha=_BAND_ALPHA[band.level],
            linewidth=0.0,
            gid=f"band-{band.level}",
        )
    axes.plot(
        z,
        curve.ratio[valid],
        color=color,
        linestyle=_DASHES[curve.style],
        label=curve.label,
        zorder=2.0 if curve.style == "fit" else 2.2,
    )


def _draw_points(axes: Axes, series: RatioPoints) -> None:
    look = LOOKS[series.role]
    out = np.zeros(series.ratio.shape, bool) if series.left_out is None else series.left_out
    for rows, fill, label in (
        (~out, look.color, series.label),
        (out, "white", f"{series.label}, left out of the fit"),
    ):
        if rows.any():
            axes.errorbar(
                series.z_over_R[rows],
                series.ratio[rows],
                yerr=series.sd[rows],
                fmt=look.marker,
                color=look.color,
                markerfacecolor=fill,
                markeredgecolor=look.color,
                markersize=4.6,
                elinewidth=1.2,
                capsize=3.5,
                label=label,
                zorder=3,
            )


def _limits(
    points: Sequence[RatioPoints], curves: Sequence[Curve], validity_limit: float
) -> tuple[float, float]:
    seen = [1.0]
    for series in points:
        spread = np.nan_to_num(series.sd)
        seen += [*(series.ratio - spread), *(series.ratio + spread)]
    for curve in curves:
        valid = curve.z_over_R >= validity_limit
        for line in (curve.ratio, *(band.upper for band in curve.bands)):
            seen += list(line[valid])
    finite = np.array([value for value in seen if np.isfinite(value)])
    span = max(finite.max() - finite.min(), 0.02)
    return float(finite.min() - 0.05 * span), float(finite.max() + 0.06 * span)


def _legend(axes: Axes, curves: Sequence[Curve]) -> None:
    handles, labels = axes.get_legend_handles_labels()
    bars = [isinstance(handle, ErrorbarContainer) for handle in handles]
    order = sorted(range(len(handles)), key=lambda index: not bars[index])
    handles, labels = [handles[index] for index in order], [labels[index] for index in order]
    levels = sorted({band.level for curve in curves for band in curve.bands})
    for level in levels:
        handles.append(Patch(facecolor=GREY, alpha=2.0 * _BAND_ALPHA[level], linewidth=0.0))
        labels.append(f"{level} % band of the fit")
    if handles:
        axes.legend(handles, labels, loc="upper right")
