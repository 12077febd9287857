"""Flights as a page shows them: the vehicle over its surface in the plane of its way, and charts.

The picture is a cut along the vehicle's heading: what a slanting obstacle or a corner looks like
on its way. A drift to the side is not in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import cos, inf, sin

import numpy as np

from benchtool.core.array import Array
from benchtool.report.flight.flight import fly_each, over_surface, table_lines
from benchtool.report.pitch_preview import PITCH_LABEL
from benchtool.report.preview import (
    ChartLine,
    ControllerRun,
    DrawnMotion,
    Role,
    SimulationPreview,
    frames,
)
from benchtool.report.side_view import Scene, Surface
from benchtool.simulate.campaign import results_in_order
from benchtool.simulate.flight.environment import Block
from benchtool.simulate.flight.flight import FlightCase
from benchtool.simulate.flight.setup import FlightSetup
from benchtool.simulate.flight.study import Flown, fly_and_measure, name_of, verdict
from benchtool.simulate.flight.warnings import warnings_of

MARGIN_M = 2.5
"""How much of the surroundings is drawn beyond both ends of the way."""

QUICK_STEP_S = 0.004
"""Longest step of the plant in a quick preview. It takes half the time of 1 ms; the shipped flights
move by less than 1 mm and 0.03 deg, which no screen shows (measured)."""


def flight_preview(
    setup: FlightSetup, controls: Sequence[str], seed: int, *, quick: bool = False
) -> SimulationPreview:
    """Fly under every controller and return what a page shows.

    A quick preview has no flight out of ground effect, no table, few frames, and longer steps.
    """
    case = setup.flown("pid", seed)
    beside: Flown | None = None
    if quick:
        rough = _with_long_steps(case)
        cases = (replace(rough, control=control) for control in controls)
        flights = list(results_in_order(partial(fly_and_measure, each) for each in cases))
    else:
        beside, *flights = fly_each(case, controls)
    every = [] if beside is None else [beside, *flights]
    return SimulationPreview(
        runs=tuple(_controller_run(flown, beside) for flown in flights),
        lines=tuple(table_lines(every)) if every else (),
        warnings=tuple(warnings_of(every)) if every else (),
    )


def _with_long_steps(case: FlightCase) -> FlightCase:
    """Return a case in as long steps as controller and motors allow, where it has not longer."""
    lag_s = case.vehicle.model.lag_s or inf
    longest_s = min(QUICK_STEP_S, 1.0 / case.gains.control_rate_Hz, 0.5 * lag_s)
    return replace(case, step_s=max(case.step_s, longest_s))


def _controller_run(flown: Flown, beside: Flown | None) -> ControllerRun:
    return ControllerRun(
        label=name_of(flown),
        outcome=verdict(flown),
        scene=_scene(flown.case),
        motion=_motion(flown, quick=beside is None),
        charts=_charts(flown, beside),
        over=tuple(over_surface(flown)),
    )


def _charts(flown: Flown, beside: Flown | None) -> dict[str, tuple[ChartLine, ...]]:
    """Return position along the way and pitch, beside them those out of ground effect."""

    def curve(role: Role, each: Flown, values: Array) -> ChartLine:
        shown = frames(len(values), quick=beside is None)
        return ChartLine(role=role, time_s=each.flight["time_s"][shown], values=values[shown])

    def place(role: Role, each: Flown) -> ChartLine:
        return curve(role, each, along_m(each.case, each.flight["x_m"], each.flight["y_m"]))

    def pitch(role: Role, each: Flown, name: str = "pitch_rad") -> ChartLine:
        return curve(role, each, np.degrees(each.flight[name]))

    goal, away = flown.case.goals[-1], [] if beside is None else [beside]
    there_m = along_m(flown.case, np.array([goal.x_m]), np.array([goal.y_m]))
    ends_s = flown.flight["time_s"][[0, -1]]
    return {
        "position along the way [m]": (
            ChartLine(role="goal", time_s=ends_s, values=np.repeat(there_m, 2)),
            *(place("away", each) for each in away),
            place("shown", flown),
        ),
        PITCH_LABEL: (
            *(pitch("away", each) for each in away),
            pitch("wanted", flown, "pitch_ref_rad"),
            pitch("shown", flown),
        ),
    }


def along_m(case: FlightCase, x_m: Array, y_m: Array) -> Array:
    """Return how far places lie along the heading, from the world's origin (m,): m."""
    return x_m * cos(case.yaw_rad) + y_m * sin(case.yaw_rad)


def _motion(flown: Flown, quick: bool) -> DrawnMotion:
    flight, case = flown.flight, flown.case
    shown = frames(len(flight.log), quick)
    rig = case.vehicle.rig
    speeds = np.array([flight[f"speed{j + 1}_rad_s"][shown] for j in range(rig.n_rotors)])
    factors = np.array([flight[f"factor{disc + 1}"][shown] for disc in rig.disc_of_rotor])
    own = rig.propulsion.thrust_coefficient_N_s2 * speeds**2 / case.vehicle.hover_thrust_N
    time_s = flight["time_s"][shown]
    moving = [block for block in _cut_blocks(case) if any(block.slide_m)]
    shift_m = [_shift_m(case, block, time_s) for block in moving]
    return DrawnMotion(
        time_s=time_s,
        along_m=along_m(case, flight["x_m"], flight["y_m"])[shown],
        up_m=flight["z_m"][shown],
        pitch_deg=np.degrees(flight["pitch_rad"][shown]),
        own=own,
        added=own * (factors - 1.0),
        shift_m=np.array(shift_m).reshape(len(moving), len(time_s)),
    )


def _shift_m(case: FlightCase, block: Block, time_s: Array) -> Array:
    away = np.interp(time_s, block.times_s, [1.0, 0.0, 0.0, 1.0])
    slide = np.array(block.slide_m)
    shift: Array = away * along_m(case, slide[:1], slide[1:])
    return shift


def _scene(case: FlightCase) -> Scene:
    vehicle = case.vehicle
    craft = vehicle.craft()
    radius_m, reach_m = vehicle.rig.propulsion.radius_m, vehicle.reach_m
    begin_m, end_m = _way_m(case)
    bottom_m = min([0.0, *(block.top_m for block in case.below.blocks)]) - 2.5 * radius_m
    surfaces = [
        surface for block in _cut_blocks(case) for surface in _section(case, block, bottom_m)
    ]
    if np.isfinite(case.below.floor_m):
        floor_m = case.below.floor_m
        bottom_m = min(bottom_m, floor_m - 0.5 * radius_m)
        ends = ((begin_m, floor_m), (end_m, floor_m), (end_m, bottom_m), (begin_m, bottom_m))
        surfaces.append(Surface(outline_m=ends))
    return Scene(
        title=f"{vehicle.rig.name} seen from its right side: {case.title}",
        rotors_m=tuple(zip(craft.x_m, craft.y_m, strict=True)),
        radius_m=radius_m,
        surfaces=tuple(surfaces),
        width_m=5.0 * reach_m,
        top_m=case.start_m[2] + 5.5 * radius_m,
        bottom_m=bottom_m,
        ruler_m=(begin_m, end_m),
    )


def _way_m(case: FlightCase) -> tuple[float, float]:
    """Return what is drawn of the way: from behind the start to beyond the last goal."""
    places = case.path_m()
    along = along_m(case, places[:, 0], places[:, 1])
    return float(along.min()) - MARGIN_M, float(along.max()) + MARGIN_M


def _cut_blocks(case: FlightCase) -> list[Block]:
    """Return the blocks that the way passes over."""
    return [block for block in case.below.blocks if _cut_m(case, block) is not None]


def _cut_m(case: FlightCase, block: Block) -> tuple[float, float] | None:
    """Return where the way enters and leaves a block's rectangle, along it; None if never."""
    low, high = _way_m(case)
    steps = (cos(case.yaw_rad), sin(case.yaw_rad))
    for step, ends, start in zip(steps, (block.x_m, block.y_m), _foot_m(case), strict=True):
        if abs(step) < 1e-9:
            if not ends[0] <= start <= ends[1]:
                return None
            continue
        near, far = sorted((end - start) / step if abs(end) < inf else end / step for end in ends)
        low, high = max(low, near), min(high, far)
    return (low, high) if low < high else None


def _foot_m(case: FlightCase) -> tuple[float, float]:
    """Return the point of the way that is nearest to the world's origin."""
    x_m, y_m, _ = case.start_m
    s = x_m * cos(case.yaw_rad) + y_m * sin(case.yaw_rad)
    return x_m - s * cos(case.yaw_rad), y_m - s * sin(case.yaw_rad)


def _section(case: FlightCase, block: Block, bottom_m: float) -> list[Surface]:
    cut = _cut_m(case, block)
    if cut is None:
        return []
    x0, y0 = _foot_m(case)

    def top_m(s: float) -> float:
        x, y = x0 + s * cos(case.yaw_rad), y0 + s * sin(case.yaw_rad)
        rise_x = block.slope_x * (x - block.x_m[0]) if block.slope_x else 0.0
        rise_y = block.slope_y * (y - block.y_m[0]) if block.slope_y else 0.0
        return block.top_m + rise_x + rise_y

    near, far = cut
    moves = any(block.slide_m)
    foot = block.top_m - 0.05 if moves else bottom_m
    outline = ((near, top_m(near)), (far, top_m(far)), (far, foot), (near, foot))
    return [Surface(outline_m=outline, name=block.name, moves=moves)]
