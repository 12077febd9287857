"""Built-in flights: the two of the paper, and three-dimensional ones.

The obstacle is at x from 3 to 5 m with its top at height 0 (paper, Fig. 10 and 11); the rotor plane
is commanded to z/R rotor radii above it (paper, section 3.2). Case 1 flies over it to x = 7 m; case
2 hovers at x = 2.8 m, with the front rotor over the edge. The text of the paper swaps the two for
its Fig. 14 and 15; the definition applies here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import cos, pi, radians, sin
from typing import Any

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.simulate.flight.environment import Block, Environment
from benchtool.simulate.flight.flight import FlightCase, Goal, Gust
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import Gains

OBSTACLE_X_M = (3.0, 5.0)  # extent of the paper's obstacle (section 3.1)
GYRO_NOISE_RAD_S = 0.015  # paper, section 3.2: normal, standard deviation 0.015 rad/s
GOAL_OVER_M, GOAL_EDGE_M = 7.0, 2.8  # goals of cases 1 and 2 (paper, section 3.1 and Fig. 11)
GUST_DRAG_N_S_M = 0.35  # of a small quadrotor: 3.5 m/s tilt it by five degrees; assumed


def obstacle() -> Environment:
    """Return the obstacle of the paper, infinitely wide, without other surfaces."""
    return Environment(blocks=(Block(x_m=OBSTACLE_X_M, name="obstacle"),), name="obstacle")


@dataclass(frozen=True, slots=True, kw_only=True)
class BuiltInCase:
    """Built-in flight: title, defaults, and function that builds its case."""

    name: str
    title: str
    build: Callable[[FlightCase, float, float], FlightCase]
    speed_m_s: float = 0.2
    z_over_R: float = 2.0


def _over(case: FlightCase, z_m: float, speed_m_s: float) -> FlightCase:
    return replace(
        case,
        below=obstacle(),
        goals=(Goal(x_m=GOAL_OVER_M, z_m=z_m, speed_m_s=speed_m_s),),
        duration_s=120.0 if speed_m_s < 0.5 else 60.0,
    )


def _edge(case: FlightCase, z_m: float, speed_m_s: float) -> FlightCase:
    return replace(
        case,
        below=obstacle(),
        goals=(Goal(x_m=GOAL_EDGE_M, z_m=z_m, speed_m_s=speed_m_s),),
        duration_s=90.0,
    )


def _oblique(case: FlightCase, z_m: float, speed_m_s: float) -> FlightCase:
    """Cross the edge nose first at 35 degrees to its normal: roll and pitch together."""
    slant = radians(35.0)
    return replace(
        case,
        yaw_rad=slant,
        below=obstacle(),
        start_m=(0.0, 0.0, z_m),
        goals=(Goal(x_m=7.0 * cos(slant), y_m=7.0 * sin(slant), z_m=z_m, speed_m_s=speed_m_s),),
        duration_s=120.0,
    )


def _corner(case: FlightCase, z_m: float, speed_m_s: float) -> FlightCase:
    """Fly to the corner of a box along its diagonal and hover with a rotor over the tip."""
    box = Environment(
        blocks=(Block(x_m=(2.0, 4.0), y_m=(2.0, 4.0), name="box"),), name="corner of a box"
    )
    return replace(
        case,
        below=box,
        yaw_rad=0.25 * pi,
        goals=(Goal(x_m=2.0, y_m=2.0, z_m=z_m, speed_m_s=speed_m_s),),
        duration_s=90.0,
    )


def _gust(case: FlightCase, z_m: float, speed_m_s: float) -> FlightCase:
    """Hover over the middle of the obstacle in a gust towards its edge."""
    return replace(
        case,
        vehicle=replace(case.vehicle, drag_N_s_m=GUST_DRAG_N_S_M),
        below=obstacle(),
        start_m=(4.0, 0.0, z_m),
        goals=(Goal(x_m=4.0, z_m=z_m, speed_m_s=speed_m_s),),
        gusts=(Gust(from_s=5.0, length_s=4.0, wind_m_s=(-5.0, 0.0, 0.0)),),
        duration_s=60.0,
    )


def _ramp(case: FlightCase, z_m: float, speed_m_s: float) -> FlightCase:
    """Fly level over a ramp that rises to the obstacle's top."""
    blocks = (
        Block(x_m=(2.0, 3.0), y_m=(-3.0, 3.0), top_m=-0.3, slope_x=0.3, name="ramp"),
        Block(x_m=OBSTACLE_X_M, y_m=(-3.0, 3.0), name="obstacle"),
    )
    return replace(
        _over(case, z_m, speed_m_s), below=Environment(blocks=blocks, floor_m=-0.6, name="ramp")
    )


PLATE_S = (10.0, 10.5, 30.0, 30.5)  # insertion and withdrawal of the plate, as on the bench


def plate_under_front(radius_m: float, arm_m: float) -> Environment:
    """Return a plate that is inserted under the front rotor from ahead, and withdrawn.

    It is as wide as a disc, and its near edge is 0.3 R behind the front disc: it never covers the
    side discs, and the front disc remains covered under a drift of a few centimetres.
    """
    near = arm_m - 1.3 * radius_m
    plate = Block(
        x_m=(near, near + 1.2),
        y_m=(-radius_m, radius_m),
        times_s=PLATE_S,
        slide_m=(1.0, 0.0),
        name="plate",
    )
    return Environment(blocks=(plate,), name="plate under the front rotor")


def _plate(case: FlightCase, z_m: float, speed_m_s: float) -> FlightCase:
    positions_m = case.vehicle.rig.disc_positions_m
    below = plate_under_front(case.vehicle.rig.propulsion.radius_m, float(positions_m[:, 0].max()))
    return replace(
        case, below=below, goals=(Goal(x_m=0.0, z_m=z_m, speed_m_s=speed_m_s),), duration_s=60.0
    )


_BUILT_IN = (
    BuiltInCase(name="over", title="Flying over an obstacle (case 1)", build=_over),
    BuiltInCase(name="edge", title="Hovering in partial ground effect (case 2)", build=_edge),
    BuiltInCase(name="oblique", title="Crossing an edge at 35 degrees", build=_oblique),
    BuiltInCase(name="corner", title="Hovering over the corner of a box", build=_corner),
    BuiltInCase(name="gust", title="A gust while hovering over the obstacle", build=_gust),
    BuiltInCase(name="ramp", title="Flying over a ramp and the obstacle", build=_ramp),
    BuiltInCase(
        name="plate", title="A plate moved under the front rotor in free hover", build=_plate
    ),
)

FLIGHTS: Mapping[str, BuiltInCase] = {item.name: item for item in _BUILT_IN}


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
    arguments: dict[str, Any] = {"title": built_in.title, "start_m": (0.0, 0.0, z_m), **changes}
    base = FlightCase(name=name, vehicle=vehicle, gains=gains, **arguments)
    case = built_in.build(base, z_m, built_in.speed_m_s if speed_m_s is None else speed_m_s)
    if z_over_R is None:
        case = replace(case, below=Environment())
    return replace(case, **changes)
