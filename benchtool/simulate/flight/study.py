"""Flight with its measures, and as a recording."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import ceil, dist
from typing import ClassVar

import numpy as np

from benchtool.core.channel import Channel, unit_from_name
from benchtool.core.recording import Recording
from benchtool.core.units import Array
from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS
from benchtool.simulate.flight.cases import FlightCase
from benchtool.simulate.flight.flight import Ending, Flight, fly

ARRIVAL_RADIUS_M = 0.05  # arrived: stays within this distance of the goal (notes, section 3.3)
MIN_RETREAT_M = 0.03  # of a push-back (notes, section 3.3)
FINAL_S = 20.0  # duration at the end for the range of x
MAX_TRAVEL_SHARE = 0.8  # of the duration, at the requested speed; the rest is for the stop; assumed


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
    simulated: ClassVar = True

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
