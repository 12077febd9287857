"""Simulated flights of one case under several controllers: figure, table, warnings, files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.report.figure import figure, legend_line, legend_patch
from benchtool.report.flight.pitch_study import write_simulation
from benchtool.report.numbers import align_columns
from benchtool.report.page import Page
from benchtool.report.palette import BLUE, DASHED, DOTTED, GREEN, GREY, OVER, VERMILION
from benchtool.report.panels import shade, spans
from benchtool.simulate.controllers.controller import make_controller
from benchtool.simulate.flight.cases import FlightCase
from benchtool.simulate.flight.environment import Block, Environment
from benchtool.simulate.flight.flight import fly_user_controller
from benchtool.simulate.flight.study import (
    FlownCase,
    build_recording,
    check_duration,
    controller_label,
    fly_and_measure,
    measure,
)
from benchtool.simulate.loop import results_in_order

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure


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


def _title(flights: Sequence[FlownCase]) -> str:
    case = flights[1].case
    height = case.start_m[2] / case.vehicle.rig.propulsion.radius_m
    return f"{case.title}, z/R = {height:.3g}, gains {case.gains.name}"


@figure(
    title=_title,
    caption="Position and pitch under each controller; grey: the same flight with PID out of "
    "ground effect; green: a rotor is over the obstacle.",
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
    free_s, free_pitch_deg = free.flight["time_s"], np.degrees(free.flight["pitch_rad"])
    for flown, (upper, lower) in zip(others, axes.T, strict=True):
        time_s, x_m = flown.flight["time_s"], flown.flight["x_m"]
        pitch_deg = np.degrees(flown.flight["pitch_rad"])
        for edge in obstacle_m or ():
            if edge <= float(x_m.max()) + 0.5:
                upper.axhline(edge, color=GREEN, linewidth=0.9, linestyle=DOTTED)
        upper.axhline(flown.case.goals[-1].x_m, color=GREY, linewidth=1.1, linestyle=DASHED)
        upper.plot(free_s, free.flight["x_m"], color=GREY, linewidth=1.3)
        upper.plot(time_s, x_m, color=BLUE)
        lower.axhline(0.0, color=GREY, linewidth=0.7)
        lower.plot(free_s, free_pitch_deg, color=GREY, linewidth=1.1)
        command_deg = np.degrees(flown.flight["pitch_ref_rad"])
        lower.plot(time_s, command_deg, color=VERMILION, linewidth=0.9, alpha=0.85)
        lower.plot(time_s, pitch_deg, color=BLUE, linewidth=1.3)
        discs = range(1, flown.case.vehicle.rig.n_discs + 1)
        covered = np.sum([flown.flight[f"coverage{i}"] for i in discs], axis=0)
        for panel, values in ((upper, x_m), (lower, pitch_deg)):
            shade(panel, spans(time_s, covered > 1e-3))
            if flown.flight.ending != "flown":  # it ended early
                panel.plot(
                    time_s[-1], values[-1], marker="X", markersize=9, color=VERMILION, zorder=5,
                    markeredgecolor="white",
                )  # fmt: skip
        upper.set_title(f"{controller_label(flown)}\n{summarize_flight(flown)}", linespacing=1.35)
        lower.set_xlabel("time [s]")
        lower.set_xlim(0.0, last_s)
    axes[0][0].set_ylabel("position $x$ [m]")
    axes[1][0].set_ylabel("pitch, nose down [deg]")
    handles: list[Artist] = [
        legend_line(color=BLUE, label="flight"),
        legend_line(color=GREY, linewidth=1.3, label="PID out of ground effect"),
        legend_line(color=VERMILION, linewidth=1.0, label="pitch command"),
        legend_line(color=GREY, linestyle=DASHED, linewidth=1.1, label="goal"),
    ]
    if obstacle_m is not None:
        handles.append(legend_line(color=GREEN, linestyle=DOTTED, label="obstacle edges"))
    handles.append(legend_patch(color=OVER, label="a rotor is over the obstacle"))
    one_row = len(handles) <= 5 and figure.get_figwidth() > 7.5
    figure.legend(handles=handles, loc="outside lower center", ncols=5 if one_row else 3)


FLIGHT = Page(
    "flight",
    [("The flight", ["flight"])],
    title="Simulated flight",
    summary=lambda flights: report_lines(flights)[0],
)


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
        arrival = f"{measures.arrives_s:.1f}" if measures.arrives else "never"
        if measures.ending != "flown":
            arrival = "hits the obstacle" if measures.ending == "struck" else "lost"
        low_cm, high_cm = (round(100.0 * z_m, 1) + 0.0 for z_m in measures.range_z_m)
        low, high = measures.range_m
        rows.append(
            (
                name, arrival, f"{measures.max_x_m:.2f}", f"{measures.push_backs}",
                f"{measures.max_pitch_deg:.1f}", f"{measures.rms_pitch_deg:.2f}",
                f"{measures.max_roll_deg:.1f}", f"{low_cm:.1f}..{high_cm:.1f}",
                f"{low:.3f}..{high:.3f}",
            )
        )  # fmt: skip
    return align_columns([heads, units, *rows], left=(0, 1, len(heads) - 1))


BODY_DEPTH_OVER_R = 1.0  # of hub and undercarriage, only for the warning; assumed
MAX_HEIGHT_ERROR_M, MAX_TILT_DEG, MAX_SPEED_M_S = 10.0, 75.0, 30.0  # of such vehicles; assumed
MIN_EFFECT = 0.001  # share of thrust below which ground effect counts as absent; assumed


def collect_warnings(flights: Sequence[FlownCase]) -> list[str]:
    """Return the warnings about flights; the first flight is that out of ground effect."""
    case = flights[-1].case
    lines = []
    if not all(flown.measures.arrives for flown in flights) and (warning := check_duration(case)):
        lines.append(warning)
    for flown in flights:
        name = f"{controller_label(flown)} OGE" if flown is flights[0] else controller_label(flown)
        lines += [f"{name}: {text}" for text in _flight_warnings(flown)]
    if ignored := case.vehicle.idle_effects:
        names = ", ".join(effect.name for effect in ignored)
        lines.append(f"{names}: effects of the model that do not act in flight; ignored")
    if no_effect := _absent_effect_warning(flights[1:]):
        lines.append(no_effect)
    with_map = [flown for flown in flights if flown.case.feeds_forward]
    if any(not flown.flight.user_controller for flown in with_map) and not any(case.map_offset_m):
        lines.append(
            "feedforward: its map is the model of the plant, so it is optimal by construction"
        )
    return lines


def _flight_warnings(flown: FlownCase) -> list[str]:
    flight, measures, vehicle = flown.flight, flown.measures, flown.case.vehicle
    radius_m = vehicle.rig.propulsion.radius_m
    lines = []
    if flight.ending == "struck":
        part = "hub, legs or a rotor" if vehicle.undercarriage_m else "a rotor"
        lines.append(f"{part} touched the obstacle at {flight.end_s:.2f} s")
    if flight.ending == "lost":
        lines.append(f"the state is not finite from {flight.end_s:.2f} s")
    if measures.max_roll_deg > 90.0:
        lines.append(
            f"it turned over (roll {measures.max_roll_deg:.0f} deg); the other measures are invalid"
        )
    elif warning := _envelope_warning(flown):
        lines.append(warning)
    if measures.held_ticks:
        lines.append(
            f"a rotor was below z/R = {vehicle.model.nearest_z_over_R:g}, the validity limit, in "
            f"{pluralize(measures.held_ticks, 'step')}; its height was clamped to the limit"
        )
    is_near = flight.ending == "flown" and measures.nearest_m < BODY_DEPTH_OVER_R * radius_m
    if is_near and not vehicle.undercarriage_m:
        lines.append(
            f"a rotor was {100.0 * measures.nearest_m:.0f} cm above the surface, where hub or legs "
            f"may strike it; to include them, add --set undercarriage_m=0.1"
        )
    return lines


def _absent_effect_warning(flights: Sequence[FlownCase]) -> str:
    """Return a warning if ground effect was absent in all flights, else ""."""
    for flown in flights:
        factors = [flown.flight[f"factor{k + 1}"] for k in range(flown.case.vehicle.rig.n_discs)]
        if flown.flight.ending != "flown" or np.abs(np.array(factors) - 1.0).max() > MIN_EFFECT:
            return ""
    nearest_m = min(flown.measures.nearest_m for flown in flights)
    case = flights[0].case
    if isfinite(nearest_m):
        z_over_R = nearest_m / case.vehicle.rig.propulsion.radius_m
        return (
            f"ground effect is absent: the smallest z/R is {z_over_R:.3g}, where it changes thrust "
            f"by less than {100.0 * MIN_EFFECT:g} %; fly lower or raise the surface"
        )
    distance_text = ""
    if case.below.blocks:
        away_m = min(_distance_m(case.path_m(), block) for block in case.below.blocks)
        distance_text = f" (the nearest box is {away_m:.2g} m from the straight path)"
    return (
        f"ground effect is absent: no rotor was over a surface of "
        f"{case.below.name!r}{distance_text}; move its boxes, or change --goal-m"
    )


def _envelope_warning(flown: FlownCase) -> str:
    """Return a warning if the flight is outside the range of such vehicles, else ""."""
    flight, measures = flown.flight, flown.measures
    height_error_m = max(measures.range_z_m, key=abs)
    tilt_deg = max(measures.max_pitch_deg, measures.max_roll_deg)
    speed_m_s = float(np.sqrt(sum(flight[f"v{axis}_m_s"] ** 2 for axis in "xyz")).max())
    violations = [
        text
        for text, value, limit in (
            (f"height error {height_error_m:+.3g} m", abs(height_error_m), MAX_HEIGHT_ERROR_M),
            (f"tilt {tilt_deg:.3g} deg", tilt_deg, MAX_TILT_DEG),
            (f"speed {speed_m_s:.3g} m/s", speed_m_s, MAX_SPEED_M_S),
        )
        if not value <= limit
    ]
    if not violations:
        return ""
    return (
        f"the flight is unrealistic: {', '.join(violations)} (limits, assumed: "
        f"{MAX_HEIGHT_ERROR_M:g} m, {MAX_TILT_DEG:g} deg, {MAX_SPEED_M_S:g} m/s); its measures are "
        f"invalid, use other gains"
    )


def _distance_m(path_m: Array, block: Block) -> float:
    """Return the least distance of a path (n, 2) from a block in plan: m."""
    share = np.linspace(0.0, 1.0, 401)[:, None]
    segments = [begin + share * (end - begin) for begin, end in pairwise(path_m)]
    x, y = np.concatenate([path_m[:1], *segments]).T
    gap_x = np.maximum(np.maximum(block.x_m[0] - x, x - block.x_m[1]), 0.0)
    gap_y = np.maximum(np.maximum(block.y_m[0] - y, y - block.y_m[1]), 0.0)
    return float(np.hypot(gap_x, gap_y).min())


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
    recordings = [(build_recording(flown.flight), dict[str, Any]()) for flown in flights]
    lines = report_lines(flights)
    return write_simulation(out, FLIGHT, flights, dict(zip(names, recordings, strict=True)), lines)
