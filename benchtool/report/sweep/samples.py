"""Figures of samples over time, of samples with point means, and of the measurement order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import FileFormatError
from benchtool.core.recording import Recording
from benchtool.core.toml_text import parse_toml
from benchtool.core.units import Array, from_si
from benchtool.data.columns import speed_columns, word_to_code
from benchtool.report.figure import figure, legend_line, legend_patch
from benchtool.report.palette import BLACK, BLUE, GREEN, GREY, ORANGE, PALE, PURPLE, VERMILION
from benchtool.report.panels import (
    envelope,
    in_radii,
    legend_below,
    legend_over,
    points,
    rotor_color,
    rotor_legend,
    spread,
    stack_panels,
)
from benchtool.report.sweep.run import SweepRun

if TYPE_CHECKING:
    from matplotlib.figure import Figure


KIND_COLORS = {"measure": BLUE, "reference": GREEN, "anchor": ORANGE, "tare": GREY}
MINUTES_FROM_S = 600.0  # runs longer than this have their time axis in minutes
Window = tuple[float, float, str]  # start and end (s) of the samples of a point, and its kind
_PANELS = {  # relative height, label, columns (by rotor) and their unit
    "thrust": (1.5, "thrust [N]", "thrust_N", "N"),
    "speed": (1.2, "rotor speed\n[rpm]", "rpm{}", "rpm"),
    "pwm": (0.9, "pwm [µs]", "pwm{}_us", "pwm_us"),
    "plate": (0.9, "plate [mm]", "plate_z_m", "mm"),
}


def _signals(recording: Recording) -> dict[str, Array]:
    """Return the available signals (rows, n) by panel; thrust is always included."""
    signals = {"thrust": np.full((1, len(recording)), np.nan)}
    for panel, (_, _, pattern, unit) in _PANELS.items():
        names = dict.fromkeys(pattern.format(k + 1) for k in range(len(recording.names)))
        rows = [from_si(recording.to_si(name), unit) for name in names if name in recording]
        if np.isfinite(rows).any():
            signals[panel] = np.array(rows)
    return signals


def samples_height(recording: Recording) -> float:
    """Return the height of `draw_samples` in inches."""
    return 1.1 + 1.22 * sum(_PANELS[name][0] for name in _signals(recording))


def draw_samples(
    figure: Figure,
    recording: Recording,
    windows: Sequence[Window] = (),  # sampling windows of points
    radius_m: float | None = None,  # adds an axis in z/R
) -> None:
    """Draw the signals of a run as stacked panels; windows of points are shaded."""
    time_s, signals = recording.to_si("time_s"), _signals(recording)
    last_s = float(np.nanmax(time_s, initial=0.0))
    unit, per_unit_s = ("min", 60.0) if last_s > MINUTES_FROM_S else ("s", 1.0)
    heights = [_PANELS[name][0] for name in signals]
    labels = [_PANELS[name][1] for name in signals]
    panels = stack_panels(figure, heights, labels, f"time [{unit}]")
    panel_by_signal = dict(zip(signals, panels, strict=True))
    single = {"thrust": BLUE, "plate": VERMILION}
    for name, axes in panel_by_signal.items():
        for index, row in enumerate(signals[name]):
            color = single.get(name, rotor_color(index))
            axes.plot(*envelope(time_s / per_unit_s, row), color=color, linewidth=0.8)
    if "plate" in panel_by_signal and radius_m:
        in_radii(panel_by_signal["plate"], radius_m)
    kinds = {kind: KIND_COLORS.get(kind, PURPLE) for *_, kind in windows}
    for kind, color in kinds.items():
        bars = [
            (start_s / per_unit_s, (end_s - start_s) / per_unit_s)
            for start_s, end_s, window_kind in windows
            if window_kind == kind
        ]
        for axes in panels:
            axes.broken_barh(
                bars, (0.0, 1.0), transform=axes.get_xaxis_transform(), color=color, alpha=0.16,
                linewidth=0.0, zorder=0,
            )  # fmt: skip
    panels[-1].set_xlim(0.0, last_s / per_unit_s or 1.0)
    legend_over(
        panel_by_signal["thrust"],
        [
            legend_patch(color=color, alpha=0.3, linewidth=0.0, label=kind)
            for kind, color in kinds.items()
        ],
    )
    rotors = max(len(signals.get("speed", ())), len(signals.get("pwm", ())))
    name = next((name for name in ("speed", "pwm") if name in signals), "thrust")
    rotor_legend(panel_by_signal[name], rotors)


@figure(
    title="Samples: {0.name}",
    caption=lambda run: (
        "Samples as received from the device"
        + (", before calibration" if run.metadata.get("calibration") else "")
        + "; shaded: sampling windows of the points."
    ),
    when=lambda run: run.samples is not None,
    height_in=lambda run: samples_height(run.samples),
)
def samples(figure: Figure, run: SweepRun) -> None:
    """Draw all samples with the sampling windows of the points."""
    assert run.samples is not None
    number, time_s = run.samples.column("point"), run.samples.column("time_s")
    sampled = run.samples.column("phase") == word_to_code("phase", "sample")
    windows = []
    for point, kind in dict(zip(run.points.column("point"), run.kinds, strict=True)).items():
        rows = np.flatnonzero(sampled & (number == point))
        if rows.size:
            windows.append((float(time_s[rows[0]]), float(time_s[rows[-1]]), kind))
    draw_samples(figure, run.samples, windows, run.rig.propulsion.radius_m)


def _raw_thrust(run: SweepRun) -> tuple[Array, Array] | None:
    """Return point number and thrust (n,) of raw samples, shifted to point means; None without."""
    if run.samples is None:
        return None
    slope = float((run.metadata.get("calibration") or {}).get("slope_N_per_count", np.nan))
    name = "thrust_raw" if np.isfinite(slope) and "thrust_raw" in run.samples else "thrust_N"
    if name not in run.samples:
        return None
    rows = run.samples.column("phase") == word_to_code("phase", "sample")
    rows &= np.isfinite(run.samples.column(name))
    number, values = run.samples.column("point")[rows], run.samples.column(name)[rows]
    if name == "thrust_N":
        return number, values
    thrust = np.full(values.shape, np.nan)
    for point, mean in zip(run.points.column("point"), run.points.column("thrust_N"), strict=True):
        in_point = number == point
        if in_point.any():
            thrust[in_point] = mean + slope * (values[in_point] - values[in_point].mean())
    return number, thrust


@figure(
    title="Raw samples and point means: {0.name}",
    caption=lambda run: (
        "Raw samples of each point and their mean over the shaded windows above, without "
        "filters. Standard errors include the autocorrelation of the samples (initial positive "
        "sequence, Geyer 1992) and exclude vibrations."
        + (
            " Raw counts are converted with the slope of the calibration."
            if run.metadata.get("calibration")
            else ""
        )
    ),
    when=lambda run: _raw_thrust(run) is not None,
    height_in=5.0,
)
def visits(figure: Figure, run: SweepRun) -> None:
    """Draw point means and raw samples in order of measurement; below: deviations."""
    raw = _raw_thrust(run)
    assert raw is not None
    sample_points, sample_N = raw
    labels = ("thrust [N]", "sample − mean\nof its point [mN]")
    top, bottom = stack_panels(figure, (1.0, 1.0), labels, "point, in order of measurement")
    number, mean_N = run.points.column("point"), run.points.column("thrust_N")
    position, deviation_N = np.full((2, len(sample_N)), np.nan)
    for point, mean in zip(number, mean_N, strict=True):
        rows = np.flatnonzero(sample_points == point)
        position[rows] = point + WIDTH * (np.linspace(0.0, 1.0, len(rows)) - 0.5)
        deviation_N[rows] = sample_N[rows] - mean
    for axes, values in ((top, sample_N), (bottom, from_si(deviation_N, "mN"))):
        axes.plot(
            position, values, ".", color=GREY, ms=1.6, alpha=0.45, rasterized=True, zorder=1.5,
            label="raw samples",
        )  # fmt: skip
    for kind, kind_rows in _rows_of_kinds(run).items():
        color = KIND_COLORS.get(kind, BLACK)
        top.plot(
            number[kind_rows], mean_N[kind_rows], "_", color=color, ms=9.0, mew=2.2, label=kind
        )
    for name, label, color, width, cap in (
        ("sd", "± standard deviation", BLACK, 0.9, 2.5),
        ("se", "± standard error of the mean", BLUE, 4.0, 0.0),
    ):
        half = from_si(run.points.column(f"thrust_{name}_N"), "mN")
        bottom.errorbar(
            number, np.zeros(len(number)), yerr=half, fmt="none", color=color, elinewidth=width,
            capsize=cap, label=label,
        )  # fmt: skip
    dot = legend_line(color=GREY, marker=".", ls="none", ms=6.0)
    legend_below(figure, [top, bottom], 3, raw_samples=dot)


WIDTH = 0.7  # width of the samples of a point, in points
MAX_TICKS = 6  # labelled plate distances, limited so that labels do not overlap
MARKERS = {"measure": "o", "reference": "s", "anchor": "D"}


def _rows_of_kinds(run: SweepRun) -> Mapping[str, NDArray[np.bool_]]:
    kinds = np.array(run.kinds)
    return {kind: kinds == kind for kind in dict.fromkeys(run.kinds)}


@figure(
    title="Order, anchors and tares: {0.name}",
    caption="Above: plate distances in order of measurement. Below: change of thrust at the "
    "anchors, scaled to the rotor speed of the first anchor, and load cell reading after each "
    "tare.",
    when=lambda run: run.uses_plate,
    height_in=4.8,
)
def order(figure: Figure, run: SweepRun) -> None:
    """Draw plate distances in order of measurement; below: anchors and tares."""
    labels = ("plate $z/R$ [–]", "change of the\nload cell [mN]")
    xlabel = "time [min]    (grey band: allowed offset after a tare)"
    distances, drift = stack_panels(figure, (1.3, 1.0), labels, xlabel)
    minutes, z = run.points.column("time_s") / 60.0, run.z_over_R(run.points)
    for kind, rows in _rows_of_kinds(run).items():
        distances.plot(
            minutes[rows], z[rows], MARKERS.get(kind, "o"), ms=4.8,
            color=KIND_COLORS.get(kind, GREY), label=kind,
        )  # fmt: skip
    distances.plot(minutes, z, color=PALE, lw=0.9, zorder=1.0)
    distances.set_yscale("log")
    levels = np.unique(z[np.isfinite(z)].round(2))
    ticks = levels[np.unique(np.linspace(0, len(levels) - 1, MAX_TICKS).astype(int))]
    distances.set_yticks(ticks, [f"{value:g}" for value in ticks])
    distances.minorticks_off()
    spread(drift, from_si(_residual_N(run.plan_text), "mN"), "tare-limit", alpha=0.5)
    tares = [np.empty(0)] * 3
    if run.tares is not None:
        tares = [run.tares.column(name) for name in ("time_s", "thrust_N", "thrust_se_N")]
    anchor_look = {"ms": 4.8, "label": "anchor since the first", "lw": 0.9}
    for (times, value, error), color, marker, style in (
        (anchor_changes(run), KIND_COLORS["anchor"], "D-", anchor_look),
        (tares, VERMILION, "v", {"ms": 5.5, "label": "offset after a tare"}),
    ):
        mN, error_mN = from_si(value, "mN"), from_si(error, "mN")
        points(drift, times / 60.0, mN, error_mN, color, marker, **style)
    legend_below(figure, [distances, drift], 5)


def _residual_N(plan_text: str) -> float:
    """Return the allowed offset after a tare of a plan: N; nan if missing."""
    try:
        return float(parse_toml(plan_text, "plan.toml")["tare"]["residual_N"])
    except (FileFormatError, KeyError, TypeError, ValueError):
        return float("nan")


def anchor_changes(run: SweepRun) -> tuple[Array, Array, Array]:
    """Return time, thrust change since the first and its error of anchors (a,) at equal speeds."""
    part = run.points.select(np.flatnonzero(np.array(run.kinds) == "anchor"))
    if not len(part):
        return np.empty(0), np.empty(0), np.empty(0)
    squares = np.zeros(len(part))
    for name in speed_columns(part.names, "rpm"):
        squares += np.nan_to_num(part.column(name)) ** 2
    scale = np.divide(squares[0], squares, out=np.ones(len(part)), where=squares > 0.0)
    thrust, se = part.column("thrust_N") * scale, part.column("thrust_se_N")
    error = np.hypot(se, se[0])
    error[0] = 0.0
    return part.column("time_s"), thrust - thrust[0], error
