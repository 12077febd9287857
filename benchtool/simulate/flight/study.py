"""Flight with its measures and warnings, and as a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, dist, isfinite

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.channel import Channel, unit_from_name
from benchtool.core.plural import pluralize
from benchtool.core.recording import Recording
from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS
from benchtool.simulate.flight.cases import FlightCase
from benchtool.simulate.flight.environment import Block
from benchtool.simulate.flight.flight import Ending, Flight, fly

ARRIVAL_RADIUS_M = 0.05  # arrived: stays within this distance of the goal (notes, section 3.3)
MIN_RETREAT_M = 0.03  # of a push-back (notes, section 3.3)
FINAL_S = 20.0  # duration at the end for the range of x
MAX_TRAVEL_SHARE = 0.8  # of the duration, at the requested speed; the rest is for the stop; assumed
BODY_DEPTH_OVER_R = 1.0  # of hub and undercarriage, only for the warning; assumed
MAX_HEIGHT_ERROR_M, MAX_TILT_DEG, MAX_SPEED_M_S = 10.0, 75.0, 30.0  # of such vehicles; assumed
MIN_EFFECT = 0.001  # share of thrust below which ground effect counts as absent; assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class Measures:
    """Measures of one flight.

    Attributes:
        arrives_s: first time after which it stays within 5 cm of the goal; nan for never.
        push_backs: retreats of more than 3 cm before the goal.
        max_pitch_deg, rms_pitch_deg: of the magnitude of pitch, over the whole flight.
        range_m: minimum and maximum of x over the last 20 s.
        range_z_m: minimum and maximum of the height error, over the whole flight.
    """

    ending: Ending
    arrives_s: float
    max_x_m: float
    push_backs: int
    max_pitch_deg: float
    rms_pitch_deg: float
    range_m: tuple[float, float]
    max_roll_deg: float
    range_z_m: tuple[float, float]
    held_ticks: int
    nearest_m: float

    @property
    def arrives(self) -> bool:
        """True if the vehicle arrived and stayed."""
        return bool(np.isfinite(self.arrives_s))

    @property
    def swing_m(self) -> float:
        """Range of x over the last 20 s."""
        return self.range_m[1] - self.range_m[0]

    def arrival_text(self) -> str:
        """Return the time of arrival or the ending as text."""
        if self.ending == "struck":
            return "hits the obstacle"
        if self.ending == "lost":
            return "lost"
        return f"{self.arrives_s:.1f}" if self.arrives else "never"


def measure(flight: Flight) -> Measures:
    """Return the measures of a flight."""
    time, x, y = flight["time_s"], flight["x_m"], flight["y_m"]
    distance_m = np.hypot(x - flight["x_goal_m"], y - flight["y_goal_m"])
    pitch = np.degrees(flight["pitch_rad"])
    height_error_m = flight["z_m"] - flight["z_goal_m"]
    is_final = time >= time[-1] - FINAL_S
    return Measures(
        ending=flight.ending,
        arrives_s=arrival_s(time, distance_m) if flight.ending == "flown" else float("nan"),
        max_x_m=float(x.max()),
        push_backs=count_push_backs(x, float(flight["x_goal_m"][-1])),
        max_pitch_deg=float(np.abs(pitch).max()),
        rms_pitch_deg=float(np.sqrt(np.mean(pitch * pitch))),
        range_m=(float(x[is_final].min()), float(x[is_final].max())),
        max_roll_deg=float(np.degrees(np.abs(flight["roll_rad"]).max())),
        range_z_m=(float(height_error_m.min()), float(height_error_m.max())),
        held_ticks=flight.held_ticks,
        nearest_m=flight.nearest_m,
    )


def arrival_s(time_s: Array, distance_m: Array) -> float:
    """Return the first time after which the distance stays below 5 cm; nan for never."""
    outside = np.flatnonzero(distance_m >= ARRIVAL_RADIUS_M)
    if outside.size == 0:
        return float(time_s[0])
    index = int(outside[-1]) + 1
    return float(time_s[index]) if index < len(time_s) else float("nan")


def count_push_backs(x_m: Array, goal_m: float) -> int:
    """Return how often x fell by more than 3 cm before it came within 0.5 m of the goal.

    A retreat ends when x has increased again by the same distance.
    """
    near_goal = np.flatnonzero(x_m > goal_m - 0.5)
    path_m = x_m[: int(near_goal[0])] if near_goal.size and goal_m > 5.0 else x_m
    count, retreating, turning_point_m = 0, False, float(path_m[0]) if path_m.size else 0.0
    for position_m in path_m.tolist():
        if retreating:
            turning_point_m = min(turning_point_m, position_m)
            if position_m > turning_point_m + MIN_RETREAT_M:
                retreating, turning_point_m = False, position_m
        else:
            turning_point_m = max(turning_point_m, position_m)
            if position_m < turning_point_m - MIN_RETREAT_M:
                retreating, turning_point_m = True, position_m
                count += 1
    return count


@dataclass(frozen=True, slots=True, eq=False)
class FlownCase:
    """Flight with its measures."""

    flight: Flight
    measures: Measures

    @property
    def case(self) -> FlightCase:
        """Case of the flight."""
        return self.flight.case


def fly_and_measure(case: FlightCase) -> FlownCase:
    """Fly a case and return the flight with its measures."""
    flight = fly(case)
    return FlownCase(flight, measure(flight))


def controller_label(flown: FlownCase) -> str:
    """Return the label of the controller in tables and figures."""
    return flown.flight.user_controller or FLIGHT_CONTROLLERS[flown.case.control]


def build_recording(flight: Flight) -> Recording:
    """Return a flight as a recording, marked as simulated."""
    case = flight.case
    return Recording(
        tuple(Channel(name, unit_from_name(name)) for name in flight.names),
        np.where(np.isinf(flight.log), np.nan, flight.log),
        {
            "flight": case.name,
            "rig": case.vehicle.rig.name,
            "gains": case.gains.name,
            "control": flight.user_controller or case.control,
            "environment": case.below.name,
            "z_over_R": f"{case.start_m[2] / case.vehicle.rig.propulsion.radius_m:g}",
            "speed_m_s": f"{case.goals[-1].speed_m_s:g}",
            "gyro_noise_rad_s": f"{case.gyro_noise_rad_s:g}",
            "map_offset_m": ", ".join(f"{value:g}" for value in case.map_offset_m),
            "seed": str(case.seed),
            "ending": flight.ending,
        },
        simulated=True,
    )


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


def check_duration(case: FlightCase) -> str:
    """Return a warning if the goal cannot be reached in the duration, else ""."""
    positions_m = [case.start_m, *((goal.x_m, goal.y_m, goal.z_m) for goal in case.goals)]
    lengths_m = [dist(*pair) for pair in pairwise(positions_m)]
    travel_s = sum(
        length_m / goal.speed_m_s for length_m, goal in zip(lengths_m, case.goals, strict=True)
    )
    if travel_s <= MAX_TRAVEL_SHARE * case.duration_s or max(lengths_m) <= ARRIVAL_RADIUS_M:
        return ""
    return (
        f"{sum(lengths_m):.3g} m at {case.goals[-1].speed_m_s:.3g} m/s take {travel_s:.0f} s, too "
        f"long for a flight of {case.duration_s:g} s; use a higher speed or --duration-s "
        f"{ceil(1.5 * travel_s / 10.0) * 10}"
    )


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
