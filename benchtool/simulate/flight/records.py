"""Records and arrays of the flight loop."""

from __future__ import annotations

from collections import namedtuple
from typing import Any, NamedTuple

from benchtool.physics.body_lift import BodyImages
from benchtool.physics.expression import Slot
from benchtool.simulate.controllers.controller import FlightReference
from benchtool.simulate.flight.environment import Tables
from benchtool.simulate.layout import COUNTS, LINE, PLANE, SOLID

GOING, STRUCK, LOST = 0.0, 1.0, 2.0  # flying; touched a surface; state not finite

Craft = namedtuple(
    "Craft",
    "mass_kg inertia_kgm2 k_N_s2 c_Nm_s2 top_speed_rad_s drag_N_s_m gravity_m_s2 radius_m "
    "effective_radius_m depth_m x_m y_m spin per_thrust per_roll per_pitch per_yaw",
)
"""Numbers of a vehicle.

Attributes:
    inertia_kgm2: principal moments (3,).
    radius_m, effective_radius_m: of a disc, for areas and for the strength of the images.
    depth_m: depth of hub and legs below the discs.
    x_m, y_m, spin: of the rotors (n,).
    per_thrust, per_roll, per_pitch, per_yaw: mixer weights of each rotor (n,).
"""


class FlightGeometry(NamedTuple):
    """Plant step, disc positions (n,) and distances (n, n), body sources (n_body,)."""

    dt_s: Any
    x_m: Any
    y_m: Any
    distances_m: Any
    body: BodyImages


# Use of the map: strength and start time of the feedforward, 1 if a disc is covered as a whole or
# not at all, 1 if the map is used.
MapUse = namedtuple("MapUse", "strength from_s whole_discs is_used", defaults=(0.0, 0.0, 0.0, 0.0))

FlightTick = namedtuple(  # one column of the schedule: setpoint and current goal (m)
    "FlightTick",
    "reference goal_x_m goal_y_m goal_z_m",
    defaults=(FlightReference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0),
)

GustRow = namedtuple(  # gust of 1 - cos shape: start (s), duration (s), peak velocity (m/s)
    "GustRow",
    "from_s length_s wind_x_m_s wind_y_m_s wind_z_m_s",
    defaults=(0.0, 0.0, 0.0, 0.0, 0.0),
)

# Noise of the gyro reading in a control period.
GyroNoise = namedtuple("GyroNoise", "p_rad_s q_rad_s r_rad_s", defaults=(0.0, 0.0, 0.0))

FlightOutcome = namedtuple(  # ending, plant steps with a clamped height, least height of a disc (m)
    "FlightOutcome", "ending clamped_steps nearest_m", defaults=(GOING, 0.0, float("inf"))
)

# Torques by ground effect, for the log.
GroundTorque = namedtuple("GroundTorque", "roll_Nm pitch_Nm", defaults=(0.0, 0.0))

TICK, GUST, NOISE = Slot(0, FlightTick()), Slot(0, GustRow()), Slot(0, GyroNoise())


class FlightArrays(NamedTuple):
    """Arrays of a flight.

    Attributes:
        w: the records.
        sent: ring buffer of commanded speeds (n_rotors, n_ring, 1).
        log: (n_rows, n_logged, 1), the rows `logged` of `w`.
        schedule: (n_numbers, n_ticks), a `FlightTick` per column.
        noise: (3, n_ticks), a `GyroNoise` per column; or one column for all ticks.
        gusts: (n_numbers, n_gusts), a `GustRow` per column.
        scratch: a column of `ground.DISC` per disc.
        geometry: a `FlightGeometry` (n_numbers,).
        below, map: tables of the environment, and of its map.
    """

    w: Any = LINE
    states: Any = COUNTS
    sent: Any = SOLID
    log: Any = SOLID
    logged: Any = COUNTS
    schedule: Any = PLANE
    noise: Any = PLANE
    gusts: Any = PLANE
    scratch: Any = PLANE
    geometry: Any = LINE
    below: Tables = Tables()
    map: Tables = Tables()
