"""What is said of a flight: arrival, overshoot, push-backs, pitch, height, the last 20 s."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchtool.core.array_type import Array
from benchtool.simulate.flight.flight import Ending, Flight

NEAR_M = 0.05  # a flight has arrived when it stays this near to its goal (notes, section 3.3)
RETREAT_M = 0.03  # a retreat of more counts as one push-back (notes, section 3.3)
LAST_S = 20.0  # position limits are taken over this long at the end


@dataclass(frozen=True, slots=True, kw_only=True)
class Measures:
    """Hold the numbers of one flight.

    Attributes:
        arrives_s: first time after which it stays within 5 cm of the goal; nan for never.
        push_backs: retreats of more than 3 cm on the way.
        max_pitch_deg, rms_pitch_deg: of the pitch's magnitude, over the whole flight.
        range_m: least and greatest x over the last 20 s.
        range_z_m: least and greatest height above the one asked for, over the whole flight.
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
        """Whether it came and stayed."""
        return bool(np.isfinite(self.arrives_s))

    @property
    def swing_m(self) -> float:
        """Width of the last 20 s."""
        return self.range_m[1] - self.range_m[0]

    def arrival_text(self) -> str:
        """Say when it arrived, or what came instead."""
        if self.ending == "struck":
            return "hits the obstacle"
        if self.ending == "lost":
            return "lost"
        return f"{self.arrives_s:.1f}" if self.arrives else "never"


def measure(flight: Flight) -> Measures:
    """Return the numbers of a flight."""
    time, x, y = flight["time_s"], flight["x_m"], flight["y_m"]
    away = np.hypot(x - flight["x_goal_m"], y - flight["y_goal_m"])
    pitch = np.degrees(flight["pitch_rad"])
    above = flight["z_m"] - flight["z_goal_m"]
    last = time >= time[-1] - LAST_S
    return Measures(
        ending=flight.ending,
        arrives_s=arrival_s(time, away) if flight.ending == "flown" else float("nan"),
        max_x_m=float(x.max()),
        push_backs=count_push_backs(x, float(flight["x_goal_m"][-1])),
        max_pitch_deg=float(np.abs(pitch).max()),
        rms_pitch_deg=float(np.sqrt(np.mean(pitch * pitch))),
        range_m=(float(x[last].min()), float(x[last].max())),
        max_roll_deg=float(np.degrees(np.abs(flight["roll_rad"]).max())),
        range_z_m=(float(above.min()), float(above.max())),
        held_ticks=flight.held_ticks,
        nearest_m=flight.nearest_m,
    )


def arrival_s(time_s: Array, away_m: Array) -> float:
    """Return the first time after which the distance stays below 5 cm; nan for never."""
    outside = np.flatnonzero(away_m >= NEAR_M)
    if outside.size == 0:
        return float(time_s[0])
    first = int(outside[-1]) + 1
    return float(time_s[first]) if first < len(time_s) else float("nan")


def count_push_backs(x_m: Array, goal_m: float) -> int:
    """Return how often x fell by more than 3 cm before it came within 0.5 m of the goal.

    A retreat ends when x has come forward again by as much from its lowest place.
    """
    near = np.flatnonzero(x_m > goal_m - 0.5)
    way = x_m[: int(near[0])] if near.size and goal_m > 5.0 else x_m
    count, retreating, turn = 0, False, float(way[0]) if way.size else 0.0
    for place in way.tolist():
        if retreating:
            turn = min(turn, place)
            if place > turn + RETREAT_M:
                retreating, turn = False, place
        else:
            turn = max(turn, place)
            if place < turn - RETREAT_M:
                retreating, turn = True, place
                count += 1
    return count
