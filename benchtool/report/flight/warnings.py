"""Warnings about simulated flights: goals out of reach, ignored effects, invalid numbers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import isfinite

import numpy as np

from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.simulate.flight.environment import Block
from benchtool.simulate.flight.study import FlownCase, check_duration, controller_label

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
    if any(
        flown.flight.ending != "flown" or _max_thrust_change(flown) > MIN_EFFECT
        for flown in flights
    ):
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


def _max_thrust_change(flown: FlownCase) -> float:
    """Return the largest relative change of the thrust of any disc."""
    discs = range(1, flown.case.vehicle.rig.n_discs + 1)
    return max(float(np.abs(flown.flight[f"factor{i}"] - 1.0).max()) for i in discs)


def _distance_m(path_m: Array, block: Block) -> float:
    """Return the least distance of a path (n, 2) from a block in plan: m."""
    share = np.linspace(0.0, 1.0, 401)[:, None]
    segments = [begin + share * (end - begin) for begin, end in pairwise(path_m)]
    x, y = np.concatenate([path_m[:1], *segments]).T
    gap_x = np.maximum(np.maximum(block.x_m[0] - x, x - block.x_m[1]), 0.0)
    gap_y = np.maximum(np.maximum(block.y_m[0] - y, y - block.y_m[1]), 0.0)
    return float(np.hypot(gap_x, gap_y).min())
