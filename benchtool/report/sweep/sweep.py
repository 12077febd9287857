"""A run at a glance: thrust, rotor speed, pwm and plate distance over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.units import from_si
from benchtool.report.flight.envelope import envelope
from benchtool.report.palette import BLUE, CYCLE, GREEN, GREY, ORANGE, PURPLE, VERMILION
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]

KIND_COLORS = {"measure": BLUE, "reference": GREEN, "anchor": ORANGE, "tare": GREY}
"""Shading of the windows in which points were taken; any other kind is shaded purple."""

MINUTES_FROM_S = 600.0
"""Runs longer than this have their time axis in minutes."""


@dataclass(frozen=True, slots=True)
class PointWindow:
    """Name one stretch of time whose samples became a point; kind as in points.csv."""

    start_s: float
    end_s: float
    kind: str = "measure"


@dataclass(frozen=True, slots=True, eq=False)
class SweepTraces:
    """Hold the signals of a run; nan where a channel had no new value.

    Attributes:
        time_s: (n,).
        thrust_N: (n,).
        speed_rad_s: (n_rotors, n).
        pwm_us: (n_rotors, n).
        plate_z_m: (n,).
    """

    time_s: Array
    thrust_N: Array
    speed_rad_s: Array
    pwm_us: Array
    plate_z_m: Array

    def __post_init__(self) -> None:
        n = self.time_s.shape
        for name, array in (("speed_rad_s", self.speed_rad_s), ("pwm_us", self.pwm_us)):
            if array.ndim != 2 or array.shape[1:] != n:
                raise InputError(
                    f"{name} needs shape (rotors, {n[0]}) like time_s, got {array.shape}"
                )
        for name, array in (("thrust_N", self.thrust_N), ("plate_z_m", self.plate_z_m)):
            if array.shape != n:
                raise InputError(f"{name} needs shape {n} like time_s, got {array.shape}")

    @classmethod
    def from_recording(cls, recording: Recording) -> SweepTraces:
        """Take the signals out of the samples of a run; channels it does not have stay empty."""
        nothing = np.full(len(recording), np.nan)

        def rows(stem: str, suffix: str) -> Array:
            names = (f"{stem}{number}{suffix}" for number in count(1))
            found = []
            for name in names:
                if name not in recording:
                    break
                found.append(recording.si(name))
            return np.array(found).reshape(len(found), len(recording))

        def one(name: str) -> Array:
            return recording.si(name) if name in recording else nothing

        return cls(
            recording.si("time_s"),
            one("thrust_N"),
            rows("rpm", ""),
            rows("pwm", "_us"),
            one("plate_z_m"),
        )


@styled
def sweep_figure(
    traces: SweepTraces,
    windows: Sequence[PointWindow] = (),
    *,
    title: str,
    simulated: bool,
    radius_m: float | None = None,
) -> Figure:
    """Draw the signals of a run one above the other, the windows of its points shaded.

    A signal that was never read has no panel.

    Args:
        traces: the signals.
        windows: stretches of time whose samples became points.
        title: one line.
        simulated: whether the run is simulated.
        radius_m: rotor radius; when given, the plate distance has a second axis in z/R.
    """
    last_s = float(np.nanmax(traces.time_s, initial=0.0))
    unit, per_unit_s = ("min", 60.0) if last_s > MINUTES_FROM_S else ("s", 1.0)
    time = traces.time_s / per_unit_s
    panels = _panels(traces)
    height_in = 1.1 + 1.22 * sum(panels.values())
    figure = new_figure(title, simulated=simulated, height_in=height_in)
    every = figure.subplots(
        len(panels), 1, sharex=True, squeeze=False,
        gridspec_kw={"height_ratios": list(panels.values())},
    )[:, 0]  # fmt: skip
    shown: dict[str, Axes] = dict(zip(panels, every, strict=True))
    _trace(shown["thrust"], time, traces.thrust_N, BLUE)
    shown["thrust"].set_ylabel("thrust [N]")
    if "speed" in shown:
        for index, row in enumerate(from_si(traces.speed_rad_s, "rpm")):
            _trace(shown["speed"], time, row, CYCLE[index % len(CYCLE)])
        shown["speed"].set_ylabel("rotor speed\n[rpm]")
    if "pwm" in shown:
        for index, row in enumerate(traces.pwm_us):
            _trace(shown["pwm"], time, row, CYCLE[index % len(CYCLE)])
        shown["pwm"].set_ylabel("pwm [µs]")
    if "plate" in shown:
        _trace(shown["plate"], time, from_si(traces.plate_z_m, "mm"), VERMILION)
        shown["plate"].set_ylabel("plate [mm]")
        if radius_m:
            _in_radii(shown["plate"], radius_m)
    kinds = dict.fromkeys(window.kind for window in windows)
    for axes in every:
        for kind in kinds:
            axes.broken_barh(
                [
                    (window.start_s / per_unit_s, (window.end_s - window.start_s) / per_unit_s)
                    for window in windows
                    if window.kind == kind
                ],
                (0.0, 1.0),
                transform=axes.get_xaxis_transform(),
                color=KIND_COLORS.get(kind, PURPLE),
                alpha=0.16,
                linewidth=0.0,
                zorder=0,
            )
    every[-1].set_xlim(0.0, last_s / per_unit_s or 1.0)
    every[-1].set_xlabel(f"time [{unit}]")
    figure.align_ylabels(list(every))
    _legend_over(
        shown["thrust"],
        [
            Patch(color=KIND_COLORS.get(kind, PURPLE), alpha=0.3, linewidth=0.0, label=kind)
            for kind in kinds
        ],
    )
    rotors = max(len(traces.speed_rad_s), len(traces.pwm_us))
    rotor_legend(shown.get("speed", shown.get("pwm", shown["thrust"])), rotors)
    return figure


def _panels(traces: SweepTraces) -> dict[str, float]:
    """Return the panels that have something to show, with their heights; thrust is always there."""
    known = {
        "thrust": (1.5, True),
        "speed": (1.2, np.isfinite(traces.speed_rad_s).any()),
        "pwm": (0.9, np.isfinite(traces.pwm_us).any()),
        "plate": (0.9, np.isfinite(traces.plate_z_m).any()),
    }
    return {name: height for name, (height, there) in known.items() if there}


def _in_radii(plate: Axes, radius_m: float) -> None:
    in_mm = from_si(radius_m, "mm")

    def to_radii(z_mm: Any) -> Any:
        return z_mm / in_mm

    def to_mm(ratio: Any) -> Any:
        return ratio * in_mm

    plate.secondary_yaxis("right", functions=(to_radii, to_mm)).set_ylabel("$z/R$ [–]")


def rotor_legend(axes: Axes, rotors: int) -> None:
    """Name the colours of numbered rotors over a panel; one rotor needs no name."""
    _legend_over(
        axes,
        [
            Line2D(
                [],
                [],
                color=CYCLE[index % len(CYCLE)],
                label=str(index + 1) if index else "rotor 1",
            )
            for index in range(rotors if rotors > 1 else 0)
        ],
    )


def _trace(axes: Axes, time: Array, values: Array, color: str) -> None:
    axes.plot(*envelope(time, values), color=color, linewidth=0.8)


def _legend_over(axes: Axes, handles: Sequence[Artist]) -> None:
    """Put a legend in one row over a panel, where it hides no signal."""
    if handles:
        axes.legend(
            handles=handles,
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            ncols=len(handles),
            frameon=False,
            fontsize=8.2,
            handlelength=1.2,
            columnspacing=1.4,
            borderaxespad=0.1,
        )
