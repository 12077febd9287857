"""Simulated flights of one case under several controllers: figure, table, files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from benchtool import __version__
from benchtool.core.errors import InputError
from benchtool.core.units import Array
from benchtool.data.run.recording_file import metadata_path, write_recording
from benchtool.report.figure import Page, figure, render_figures
from benchtool.report.files import check_not_existing, save_figure
from benchtool.report.flight.warnings import collect_warnings
from benchtool.report.palette import BLUE, GREEN, GREY, VERMILION
from benchtool.report.panels import DASHED, DOTTED, OVER, shade, spans
from benchtool.simulate.controllers.controller import make_controller
from benchtool.simulate.flight.cases import FlightCase
from benchtool.simulate.flight.environment import Environment
from benchtool.simulate.flight.flight import fly_user_controller
from benchtool.simulate.flight.study import (
    FlownCase,
    Measures,
    build_recording,
    controller_label,
    fly_and_measure,
    measure,
)
from benchtool.simulate.loop import results_in_order


def summarize_flight(flown: FlownCase) -> str:
    """Return the result of a flight in one line."""
    measures, goal = flown.measures, flown.case.goals[-1]
    if measures.ending == "struck":
        return f"strikes the obstacle at {flown.flight.end_s:.1f} s"
    if measures.arrives:
        return f"arrives at {measures.arrives_s:.1f} s"
    if measures.swing_m > 0.05:
        return f"never arrives: swings {measures.range_m[0]:.2f} to {measures.range_m[1]:.2f} m"
    return f"stays {abs(goal.x_m - measures.range_m[0]):.2f} m short"


def obstacle_extent(case: FlightCase) -> tuple[float, float] | None:
    """Return the extent of the fixed obstacles along x; None if it is infinite or empty."""
    fixed_blocks = [block for block in case.below.blocks if not any(block.slide_m)]
    ends = [end for block in fixed_blocks for end in block.x_m]
    if not ends or not np.all(np.isfinite(ends)):
        return None
    return min(ends), max(ends)


def _position(
    axes: Axes, flown: FlownCase, free: FlownCase, obstacle_m: tuple[float, float] | None
) -> None:
    shade(axes, over_surface(flown))
    x_m = flown.flight["x_m"]
    for edge in obstacle_m or ():
        if edge <= float(x_m.max()) + 0.5:
            axes.axhline(edge, color=GREEN, linewidth=0.9, linestyle=DOTTED)
    axes.axhline(flown.case.goals[-1].x_m, color=GREY, linewidth=1.1, linestyle=DASHED)
    axes.plot(free.flight["time_s"], free.flight["x_m"], color=GREY, linewidth=1.3)
    axes.plot(flown.flight["time_s"], x_m, color=BLUE)
    _strike(axes, flown, x_m)


def _pitch(axes: Axes, flown: FlownCase, free: FlownCase) -> None:
    shade(axes, over_surface(flown))
    axes.axhline(0.0, color=GREY, linewidth=0.7)
    grey_deg = np.degrees(free.flight["pitch_rad"])
    axes.plot(free.flight["time_s"], grey_deg, color=GREY, linewidth=1.1)
    time_s, pitch_deg = flown.flight["time_s"], np.degrees(flown.flight["pitch_rad"])
    command_deg = np.degrees(flown.flight["pitch_ref_rad"])
    axes.plot(time_s, command_deg, color=VERMILION, linewidth=0.9, alpha=0.85)
    axes.plot(time_s, pitch_deg, color=BLUE, linewidth=1.3)
    _strike(axes, flown, pitch_deg)


def _strike(axes: Axes, flown: FlownCase, values: Array) -> None:
    """Mark the end of a flight that ended early."""
    if flown.flight.ending != "flown":
        axes.plot(
            flown.flight["time_s"][-1], values[-1], marker="X", markersize=9, color=VERMILION,
            zorder=5, markeredgecolor="white",
        )  # fmt: skip


def over_surface(flown: FlownCase) -> list[tuple[float, float]]:
    """Return start and end (s) of the intervals with a rotor over a surface."""
    discs = range(1, flown.case.vehicle.rig.n_discs + 1)
    covered = np.sum([flown.flight[f"coverage{i}"] for i in discs], axis=0)
    return spans(flown.flight["time_s"], covered > 1e-3)


def _legend(figure: Figure, obstacle: bool) -> None:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=BLUE, label="flight"),
        Line2D([], [], color=GREY, linewidth=1.3, label="PID out of ground effect"),
        Line2D([], [], color=VERMILION, linewidth=1.0, label="pitch command"),
        Line2D([], [], color=GREY, linestyle=DASHED, linewidth=1.1, label="goal"),
    ]
    if obstacle:
        handles.append(Line2D([], [], color=GREEN, linestyle=DOTTED, label="obstacle edges"))
    handles.append(Patch(color=OVER, label="a rotor is over the obstacle"))
    one_row = len(handles) <= 5 and figure.get_figwidth() > 7.5
    figure.legend(handles=handles, loc="outside lower center", ncols=5 if one_row else 3)


def _title(flights: Sequence[FlownCase]) -> str:
    case = flights[1].case
    height = case.start_m[2] / case.vehicle.rig.propulsion.radius_m
    return f"{case.title}, z/R = {height:.3g}, gains {case.gains.name}"


@figure(
    title=_title,
    caption="Position and pitch under each controller; grey: the same flight with PID out of "
    "ground effect; green: a rotor is over the obstacle.",
    simulated=True,
    height_in=5.3,
    width_in=lambda flights: 7.0 if len(flights) < 4 else 3.05 * (len(flights) - 1),
)
def flight(figure: Figure, flights: Sequence[FlownCase]) -> None:
    """Draw position and pitch under each controller; grey: first flight."""
    free, *others = flights
    axes = figure.subplots(
        2, len(others), sharex="col", sharey="row", squeeze=False, height_ratios=[1.15, 1.0]
    )
    last_s = float(max(flown.flight["time_s"][-1] for flown in others))
    obstacle_m = obstacle_extent(others[0].case)
    for flown, (upper, lower) in zip(others, axes.T, strict=True):
        _position(upper, flown, free, obstacle_m)
        _pitch(lower, flown, free)
        upper.set_title(f"{controller_label(flown)}\n{summarize_flight(flown)}", linespacing=1.35)
        lower.set_xlabel("time [s]")
        lower.set_xlim(0.0, last_s)
    axes[0][0].set_ylabel("position $x$ [m]")
    axes[1][0].set_ylabel("pitch, nose down [deg]")
    _legend(figure, obstacle_m is not None)


FLIGHT = Page("flight", [("The flight", ["flight"])])


def fly_each(
    case: FlightCase,
    controls: Sequence[str],
    user_controllers: Sequence[tuple[str, type[Any]]] = (),
) -> list[FlownCase]:
    """Simulate a case out of ground effect with PID, then under each controller."""
    free = replace(case, below=Environment(), gyro_noise_rad_s=0.0, control="pid")
    cases = [free, *(replace(case, control=control) for control in controls)]
    flights = list(results_in_order(partial(fly_and_measure, item) for item in cases))
    for name, kind in user_controllers:
        flight = fly_user_controller(case, make_controller(kind, name), name)
        flights.append(FlownCase(flight, measure(flight)))
    return flights


def _arrival_text(measures: Measures) -> str:
    if measures.ending == "flown":
        return f"{measures.arrives_s:.1f}" if measures.arrives else "never"
    return "hits the obstacle" if measures.ending == "struck" else "lost"


def table_lines(flights: Sequence[FlownCase]) -> list[str]:
    """Return the table of measures; the first flight is out of ground effect."""
    names = [controller_label(flown) for flown in flights]
    names[0] += " OGE"
    heads = (
        "controller", "arrives s", "max x m", "push-backs", "max pitch", "RMS pitch", "max roll",
        "z from set", "x in last 20 s",
    )  # fmt: skip
    units = ("", "", "", "", "deg", "deg", "deg", "cm", "m")
    rows = []
    for name, flown in zip(names, flights, strict=True):
        measures = flown.measures
        low_cm, high_cm = (round(100.0 * z_m, 1) + 0.0 for z_m in measures.range_z_m)
        low, high = measures.range_m
        rows.append(
            (
                name, _arrival_text(measures), f"{measures.max_x_m:.2f}", f"{measures.push_backs}",
                f"{measures.max_pitch_deg:.1f}", f"{measures.rms_pitch_deg:.2f}",
                f"{measures.max_roll_deg:.1f}", f"{low_cm:.1f}..{high_cm:.1f}",
                f"{low:.3f}..{high:.3f}",
            )
        )  # fmt: skip
    widths = [max(map(len, column)) for column in zip(heads, units, *rows, strict=True)]
    left = (0, 1, len(heads) - 1)

    def line(cells: Sequence[str]) -> str:
        padded = (
            cell.ljust(width) if at in left else cell.rjust(width)
            for at, (cell, width) in enumerate(zip(cells, widths, strict=True))
        )
        return "  ".join(padded).rstrip()

    return [line(cells) for cells in (heads, units, *rows)]


def report_lines(flights: Sequence[FlownCase]) -> list[str]:
    """Return the text report of flights: case, table, warnings."""
    case = flights[0].case
    z_over_R = case.start_m[2] / case.vehicle.rig.propulsion.radius_m
    head = (
        f"SIMULATED flight {case.name}: {case.title}; rig {case.vehicle.rig.name}, "
        f"z/R {z_over_R:.4g}, {case.goals[-1].speed_m_s:g} m/s, gains {case.gains.name}"
    )
    return [head, *table_lines(flights), *collect_warnings(flights)]


def write_flights(out: Path, flights: Sequence[FlownCase]) -> list[Path]:
    """Write recordings, text report and figure of flights to new files; return their paths."""
    names = [
        flown.flight.user_controller.replace(":", "-") or flown.case.control for flown in flights
    ]
    names[0] = "oge"
    if len(set(names)) < len(names):
        raise InputError(f"duplicate controller: {', '.join(names[1:])}; give each once")
    tables = {out / f"{name}.csv": flown for name, flown in zip(names, flights, strict=True)}
    text = out / "numbers.txt"
    figures = [out / "flight.svg", out / "flight.png"]
    check_not_existing([*tables, *(metadata_path(path) for path in tables), text, *figures])
    out.mkdir(parents=True, exist_ok=True)
    for path, flown in tables.items():
        write_recording(
            path, build_recording(flown.flight), {"software": f"benchtool {__version__}"}
        )
    text.write_text("\n".join(report_lines(flights)) + "\n", encoding="utf-8")
    block = render_figures("flight", flights)["flight"]
    return [*tables, text, *save_figure(block.figure, out / "flight")]
