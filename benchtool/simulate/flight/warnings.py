"""What a reader of a flight's numbers must know: why it came to nothing, what is left out."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import ceil, dist, isfinite

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.plural import pluralize
from benchtool.simulate.flight.environment import Block
from benchtool.simulate.flight.flight import FlightCase
from benchtool.simulate.flight.measures import NEAR_M
from benchtool.simulate.flight.study import FlownCase, name_of

OF_THE_TIME = 0.8  # share of a flight for the way at the requested speed; the rest: stop; assumed
BODY_REACH = 1.0  # depth of hub and undercarriage in rotor radii, for the warning alone; assumed
FARTHEST_OFF_M, LARGEST_TILT_DEG, FASTEST_M_S = 10.0, 75.0, 30.0  # no such vehicle flies; assumed
NO_EFFECT = 0.001  # a share of thrust too small to see: below it, what is below acts on nothing


def too_short(case: FlightCase) -> str:
    """Say why a flight could not come to its goal in its time at its speed; "" if it could."""
    places = [case.start_m, *((goal.x_m, goal.y_m, goal.z_m) for goal in case.goals)]
    ways = [dist(*pair) for pair in pairwise(places)]
    needs_s = sum(way / goal.speed_m_s for way, goal in zip(ways, case.goals, strict=True))
    if needs_s <= OF_THE_TIME * case.duration_s or max(ways) <= NEAR_M:
        return ""
    return (
        f"a way of {sum(ways):.3g} m at {case.goals[-1].speed_m_s:.3g} m/s takes {needs_s:.0f} s "
        f"of a flight of {case.duration_s:g} s, so that hardly any could arrive; give --duration-s "
        f"{ceil(1.5 * needs_s / 10.0) * 10} or a higher speed"
    )


def warnings_of(flights: Sequence[FlownCase]) -> list[str]:
    """Return a line for everything of this kind; the first flight is the one over nothing."""
    case = flights[-1].case
    out = []
    if not all(flown.measures.arrives for flown in flights) and (why := too_short(case)):
        out.append(why)
    for flown in flights:
        name = f"{name_of(flown)} OGE" if flown is flights[0] else name_of(flown)
        out += [f"{name}: {text}" for text in _warnings_of_one(flown)]
    if idle := case.vehicle.idle_effects:
        names = ", ".join(effect.name for effect in idle)
        out.append(f"{names}: of the model, but not of a vehicle in flight; left out")
    if nothing := _nothing_acts(flights[1:]):
        out.append(nothing)
    mapped = [flown for flown in flights if flown.case.feeds_forward]
    if any(not flown.flight.own for flown in mapped) and not any(case.map_offset_m):
        out.append(
            "feedforward: its map is the plant's own model, so that it is best by construction"
        )
    return out


def _warnings_of_one(flown: FlownCase) -> list[str]:
    flight, found, vehicle = flown.flight, flown.measures, flown.case.vehicle
    radius_m = vehicle.rig.propulsion.radius_m
    out = []
    if flight.ending == "struck":
        what = "hub, legs or a rotor" if vehicle.undercarriage_m else "a rotor"
        out.append(f"{what} touched the obstacle at {flight.end_s:.2f} s")
    if flight.ending == "lost":
        out.append(f"the numbers left the finite range at {flight.end_s:.2f} s")
    if found.max_roll_deg > 90.0:
        out.append(
            f"it turned over (roll {found.max_roll_deg:.0f} deg); its other numbers are those of a "
            f"fall"
        )
    elif left := _left_envelope(flown):
        out.append(left)
    if found.held_ticks:
        out.append(
            f"a rotor came nearer than z/R = {vehicle.model.nearest_z_over_R:g} in "
            f"{pluralize(found.held_ticks, 'step')}; its height was held there, where the formulae "
            f"end"
        )
    near = flight.ending == "flown" and found.nearest_m < BODY_REACH * radius_m
    if near and not vehicle.undercarriage_m:
        out.append(
            f"a rotor came within {100.0 * found.nearest_m:.0f} cm of the surface, where hub or "
            f"legs may strike it; --set undercarriage_m=0.1 lets them"
        )
    return out


def _nothing_acts(flights: Sequence[FlownCase]) -> str:
    """Say that nothing below ever acted, and how far away it is; "" where something did."""
    if any(flown.flight.ending != "flown" or _strongest(flown) > NO_EFFECT for flown in flights):
        return ""
    nearest_m = min(flown.measures.nearest_m for flown in flights)
    case = flights[0].case
    if isfinite(nearest_m):
        z_over_R = nearest_m / case.vehicle.rig.propulsion.radius_m
        return (
            f"nothing below acts: its surface is never nearer than z/R = {z_over_R:.3g}, where it "
            f"changes no thrust by {100.0 * NO_EFFECT:g} %; fly lower or raise it"
        )
    beside = ""
    if case.below.blocks:
        away_m = min(_distance_m(case.path_m(), block) for block in case.below.blocks)
        beside = f" (the nearest box is {away_m:.2g} m from the straight path)"
    return (
        f"nothing below acts: no rotor was ever over anything of {case.below.name!r}{beside}; move "
        f"its boxes, or fly elsewhere with --goal-m"
    )


def _left_envelope(flown: FlownCase) -> str:
    """Say by what a flight left what any such vehicle flies; "" if it did not."""
    flight, found = flown.flight, flown.measures
    off_m = max(found.range_z_m, key=abs)
    tilt_deg = max(found.max_pitch_deg, found.max_roll_deg)
    speed_m_s = float(np.sqrt(sum(flight[f"v{axis}_m_s"] ** 2 for axis in "xyz")).max())
    beyond = [
        text
        for text, value, limit in (
            (f"{off_m:+.3g} m off its height", abs(off_m), FARTHEST_OFF_M),
            (f"tilted by {tilt_deg:.3g} deg", tilt_deg, LARGEST_TILT_DEG),
            (f"{speed_m_s:.3g} m/s fast", speed_m_s, FASTEST_M_S),
        )
        if not value <= limit
    ]
    if not beyond:
        return ""
    return (
        f"it flew as no such vehicle does ({', '.join(beyond)}; limits guessed as "
        f"{FARTHEST_OFF_M:g} m, {LARGEST_TILT_DEG:g} deg, {FASTEST_M_S:g} m/s), so that its "
        f"numbers mean nothing; take other gains"
    )


def _strongest(flown: FlownCase) -> float:
    """Return the largest share by which any disc's thrust was changed."""
    discs = range(1, flown.case.vehicle.rig.n_discs + 1)
    return max(float(np.abs(flown.flight[f"factor{i}"] - 1.0).max()) for i in discs)


def _distance_m(path_m: Array, block: Block) -> float:
    """Return how far a straight path (m, 2) over its places stays from a block in plan: m."""
    share = np.linspace(0.0, 1.0, 401)[:, None]
    ways = [begin + share * (end - begin) for begin, end in pairwise(path_m)]
    x, y = np.concatenate([path_m[:1], *ways]).T
    beside_x = np.maximum(np.maximum(block.x_m[0] - x, x - block.x_m[1]), 0.0)
    beside_y = np.maximum(np.maximum(block.y_m[0] - y, y - block.y_m[1]), 0.0)
    return float(np.hypot(beside_x, beside_y).min())
