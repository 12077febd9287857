"""Cases of a flight, and the built-in ones: the two of the paper, and three-dimensional ones.

The obstacle is at x from 3 to 5 m with its top at height 0 (paper, Fig. 10 and 11); the rotor plane
is commanded to z/R rotor radii above it (paper, section 3.2). Case 1 flies over it to x = 7 m; case
2 hovers at x = 2.8 m, with the front rotor over the edge. The text of the paper swaps the two for
its Fig. 14 and 15; the definition applies here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import cos, isfinite, pi, radians, sin
from typing import Any

import numpy as np

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.units import Array
from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS
from benchtool.simulate.flight.environment import Block, Environment
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import Gains
from benchtool.simulate.inputs import check_range

OBSTACLE_X_M = (3.0, 5.0)  # extent of the paper's obstacle (section 3.1)
GYRO_NOISE_RAD_S = 0.015  # paper, section 3.2: normal, standard deviation 0.015 rad/s
GOAL_OVER_M, GOAL_EDGE_M = 7.0, 2.8  # goals of cases 1 and 2 (paper, section 3.1 and Fig. 11)
GUST_DRAG_N_S_M = 0.35  # of a small quadrotor: 3.5 m/s tilt it by five degrees; assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """Target position (x, y, z in m) from a time on, with a speed."""

    x_m: float
    y_m: float = 0.0
    z_m: float = 0.0
    speed_m_s: float = 0.2
    from_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Gust:
    """Gust of 1 - cos shape: peak velocity (m/s) along x, y, z from a time on."""

    from_s: float
    length_s: float
    wind_m_s: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightCase:
    """Case of one flight.

    Attributes:
        control: one of `FLIGHT_CONTROLLERS`.
        start_m: x, y, z of the initial hover.
        gyro_noise_rad_s: standard deviation of white noise per control sample.
        map_offset_m: displacement of the feedforward's map along x, y, z; -0.05 along x is an
            edge that is 5 cm early in the map.
        map_strength: share of the effect that the model of the map predicts.
        whole_discs: a disc of the map is covered as a whole or not at all, by its centre.
        ramp: move the reference at the speed instead of limiting the speed.
        compensation_from_s: start time of observer and feedforward.
        gusts: wind; without effect for a vehicle without drag.
    """

    name: str
    vehicle: FlightVehicle
    gains: Gains
    below: Environment = field(default_factory=Environment)
    title: str = ""
    control: str = "pid"
    start_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    goals: tuple[Goal, ...] = ()
    duration_s: float = 60.0
    yaw_rad: float = 0.0
    gyro_noise_rad_s: float = 0.0
    seed: int = 1
    map_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    map_strength: float = 1.0
    whole_discs: bool = False
    ramp: bool = False
    compensation_from_s: float = 0.0
    gusts: tuple[Gust, ...] = ()
    step_s: float = 0.001
    log_Hz: float = 50.0

    def __post_init__(self) -> None:
        if self.control not in FLIGHT_CONTROLLERS:
            raise UnknownChoice("flight control", self.control, FLIGHT_CONTROLLERS)
        period_s = 1.0 / self.gains.control_rate_Hz
        numbers = {
            "duration_s": (self.duration_s, period_s, 1e5),
            "step_s": (self.step_s, 1e-6, period_s),
            "gyro_noise_rad_s": (self.gyro_noise_rad_s, 0.0, 10.0),
            "map_strength": (self.map_strength, 0.0, 10.0),
            "log_Hz": (self.log_Hz, 1e-3, self.gains.control_rate_Hz),
            "yaw_rad": (self.yaw_rad, -7.0, 7.0),
        }
        for goal in self.goals:
            numbers["goal speed_m_s"] = (goal.speed_m_s, 1e-3, 50.0)
        for name, (value, low, high) in numbers.items():
            check_range(name, value, low, high)
        coordinates = [*self.start_m, *self.map_offset_m]
        coordinates += [value for goal in self.goals for value in (goal.x_m, goal.y_m, goal.z_m)]
        if not all(map(isfinite, coordinates)):
            raise InputError(f"start, goals and map offset must be finite, but are {coordinates}")
        lag_s = self.vehicle.model.lag_s
        if 0.0 < lag_s < 2.0 * self.step_s:
            raise InputError(
                f"step_s is {self.step_s:g}; allowed for a motor lag of {lag_s:g} s: "
                f"up to {lag_s / 2.0:g}"
            )

    @property
    def feeds_forward(self) -> bool:
        """True if thrusts are divided by the factors from the map."""
        return self.control == "both" or "feedforward" in self.control.split("+")

    def path_m(self) -> Array:
        """Return start and goals in plan (n, 2): m."""
        return np.array([self.start_m[:2], *((goal.x_m, goal.y_m) for goal in self.goals)])


def obstacle() -> Environment:
    """Return the obstacle of the paper, infinitely wide, without other surfaces."""
    return Environment(blocks=(Block(x_m=OBSTACLE_X_M, name="obstacle"),), name="obstacle")


@dataclass(frozen=True, slots=True, kw_only=True)
class BuiltInCase:
    """Built-in flight; build(vehicle, z_m, speed_m_s) returns fields of its `FlightCase`."""

    title: str
    build: Callable[[FlightVehicle, float, float], dict[str, Any]]
    speed_m_s: float = 0.2


def _over(vehicle: FlightVehicle, z_m: float, speed_m_s: float) -> dict[str, Any]:
    return {
        "below": obstacle(),
        "goals": (Goal(x_m=GOAL_OVER_M, z_m=z_m, speed_m_s=speed_m_s),),
        "duration_s": 120.0 if speed_m_s < 0.5 else 60.0,
    }


def _edge(vehicle: FlightVehicle, z_m: float, speed_m_s: float) -> dict[str, Any]:
    goal = Goal(x_m=GOAL_EDGE_M, z_m=z_m, speed_m_s=speed_m_s)
    return {"below": obstacle(), "goals": (goal,), "duration_s": 90.0}


def _oblique(vehicle: FlightVehicle, z_m: float, speed_m_s: float) -> dict[str, Any]:
    """Cross the edge nose first at 35 degrees to its normal: roll and pitch together."""
    slant = radians(35.0)
    goal = Goal(x_m=7.0 * cos(slant), y_m=7.0 * sin(slant), z_m=z_m, speed_m_s=speed_m_s)
    return {"below": obstacle(), "goals": (goal,), "duration_s": 120.0, "yaw_rad": slant}


def _corner(vehicle: FlightVehicle, z_m: float, speed_m_s: float) -> dict[str, Any]:
    """Fly to the corner of a box along its diagonal and hover with a rotor over the tip."""
    box = Block(x_m=(2.0, 4.0), y_m=(2.0, 4.0), name="box")
    return {
        "below": Environment(blocks=(box,), name="corner of a box"),
        "goals": (Goal(x_m=2.0, y_m=2.0, z_m=z_m, speed_m_s=speed_m_s),),
        "duration_s": 90.0,
        "yaw_rad": 0.25 * pi,
    }


def _gust(vehicle: FlightVehicle, z_m: float, speed_m_s: float) -> dict[str, Any]:
    """Hover over the middle of the obstacle in a gust towards its edge."""
    return {
        "vehicle": replace(vehicle, drag_N_s_m=GUST_DRAG_N_S_M),
        "below": obstacle(),
        "start_m": (4.0, 0.0, z_m),
        "goals": (Goal(x_m=4.0, z_m=z_m, speed_m_s=speed_m_s),),
        "gusts": (Gust(from_s=5.0, length_s=4.0, wind_m_s=(-5.0, 0.0, 0.0)),),
        "duration_s": 60.0,
    }


def _ramp(vehicle: FlightVehicle, z_m: float, speed_m_s: float) -> dict[str, Any]:
    """Fly level over a ramp that rises to the obstacle's top."""
    blocks = (
        Block(x_m=(2.0, 3.0), y_m=(-3.0, 3.0), top_m=-0.3, slope_x=0.3, name="ramp"),
        Block(x_m=OBSTACLE_X_M, y_m=(-3.0, 3.0), name="obstacle"),
    )
    below = Environment(blocks=blocks, floor_m=-0.6, name="ramp")
    return _over(vehicle, z_m, speed_m_s) | {"below": below}


PLATE_S = (10.0, 10.5, 30.0, 30.5)  # insertion and withdrawal of the plate, as on the bench


def _plate(vehicle: FlightVehicle, z_m: float, speed_m_s: float) -> dict[str, Any]:
    """Hover while a plate is inserted under the front rotor from ahead, and withdrawn.

    It is as wide as a disc, and its near edge is 0.3 R behind the front disc: it never covers the
    side discs, and the front disc remains covered under a drift of a few centimetres.
    """
    radius_m = vehicle.rig.propulsion.radius_m
    near_m = float(vehicle.rig.disc_positions_m[:, 0].max()) - 1.3 * radius_m
    plate = Block(
        x_m=(near_m, near_m + 1.2),
        y_m=(-radius_m, radius_m),
        times_s=PLATE_S,
        slide_m=(1.0, 0.0),
        name="plate",
    )
    return {
        "below": Environment(blocks=(plate,), name="plate under the front rotor"),
        "goals": (Goal(x_m=0.0, z_m=z_m, speed_m_s=speed_m_s),),
        "duration_s": 60.0,
    }


FLIGHTS: Mapping[str, BuiltInCase] = {
    "over": BuiltInCase(title="Flying over an obstacle (case 1)", build=_over),
    "edge": BuiltInCase(title="Hovering in partial ground effect (case 2)", build=_edge),
    "oblique": BuiltInCase(title="Crossing an edge at 35 degrees", build=_oblique),
    "corner": BuiltInCase(title="Hovering over the corner of a box", build=_corner),
    "gust": BuiltInCase(title="A gust while hovering over the obstacle", build=_gust),
    "ramp": BuiltInCase(title="Flying over a ramp and the obstacle", build=_ramp),
    "plate": BuiltInCase(title="A plate moved under the front rotor in free hover", build=_plate),
}


def flight_case(
    name: str,
    vehicle: FlightVehicle,
    gains: Gains,
    *,
    z_over_R: float | None = 2.0,
    speed_m_s: float | None = None,
    **changes: Any,
) -> FlightCase:
    """Return the case of a built-in flight; z_over_R None means no surface."""
    if name not in FLIGHTS:
        raise UnknownChoice("flight", name, FLIGHTS)
    built_in = FLIGHTS[name]
    height = 2.0 if z_over_R is None else z_over_R
    if not 0.0 < height < 1e3:
        raise InputError(f"z/R is {height:g}; allowed: above 0, below 1000")
    z_m = height * vehicle.rig.propulsion.radius_m
    values: dict[str, Any] = {"vehicle": vehicle, "title": built_in.title}
    values["start_m"] = (0.0, 0.0, z_m)
    values |= built_in.build(vehicle, z_m, built_in.speed_m_s if speed_m_s is None else speed_m_s)
    if z_over_R is None:
        values["below"] = Environment()
    return FlightCase(name=name, gains=gains, **{**values, **changes})
