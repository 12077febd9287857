"""What the loop of a flight computes with: named records in one flat block, and its arrays."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

from benchtool.physics.body_lift import BodyImages
from benchtool.physics.expression import Slot
from benchtool.simulate.controllers.controller import (
    FlightCommand,
    FlightMeasurement,
    FlightReference,
)
from benchtool.simulate.flight.environment import Tables
from benchtool.simulate.flight.ground import Below
from benchtool.simulate.flight.rigid_body import FreeBody
from benchtool.simulate.layout import COUNTS, LINE, PLANE, SOLID, Layout, rows_in
from benchtool.simulate.motors import Motion, Rotors, Targets

GOING, STRUCK, LOST = 0.0, 1.0, 2.0
"""How a flight stands: nothing in its way, touched something, numbers no longer finite."""


class Craft(NamedTuple):
    """Numbers of a vehicle.

    Attributes:
        mass_kg, inertia_kgm2: mass, and the three principal moments.
        k_N_s2, c_Nm_s2: of eq. (8).
        top_speed_rad_s: what a motor can reach.
        drag_N_s_m: force per velocity against the air.
        gravity_m_s2: gravity.
        radius_m, effective_radius_m: of a disc, for areas and for the images' strength.
        depth_m: how far hub and legs reach below the discs, everywhere under them.
        x_m, y_m, spin: places and sense of turning of the rotors (n,).
        per_thrust, per_roll, per_pitch, per_yaw: what the mixer gives a rotor (n,) of the thrust
            (N/N) and of the three torques (N/(N m)).
    """

    mass_kg: Any
    inertia_kgm2: Any
    k_N_s2: Any
    c_Nm_s2: Any
    top_speed_rad_s: Any
    drag_N_s_m: Any
    gravity_m_s2: Any
    radius_m: Any
    effective_radius_m: Any
    depth_m: Any
    x_m: Any
    y_m: Any
    spin: Any
    per_thrust: Any
    per_roll: Any
    per_pitch: Any
    per_yaw: Any


class FlightGeometry(NamedTuple):
    """Plant step: s. Places of the discs (n,), distances between their axes (n, n): m; sources of
    the body term (n_body,).
    """

    dt_s: Any
    x_m: Any
    y_m: Any
    distances_m: Any
    body: BodyImages


class MapUse(NamedTuple):
    """How the map is used: strength of the feedforward, since when (s), 1 where it knows only
    whether a rotor's centre is over something, and 1 where it is read at all.
    """

    strength: Any = 0.0
    from_s: Any = 0.0
    whole: Any = 0.0
    read: Any = 0.0


class FlightTick(NamedTuple):
    """One column of the schedule: what is wanted, and the goal that holds (m)."""

    reference: Any = FlightReference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    goal_x_m: Any = 0.0
    goal_y_m: Any = 0.0
    goal_z_m: Any = 0.0


class GustRow(NamedTuple):
    """A gust of 1 - cos shape: from when (s), how long (s), and its peak velocity (m/s)."""

    from_s: Any = 0.0
    length_s: Any = 0.0
    wind_x_m_s: Any = 0.0
    wind_y_m_s: Any = 0.0
    wind_z_m_s: Any = 0.0


class GyroNoise(NamedTuple):
    """What is added to the gyro's reading in a control period: rad/s."""

    p_rad_s: Any = 0.0
    q_rad_s: Any = 0.0
    r_rad_s: Any = 0.0


class FlightOutcome(NamedTuple):
    """How a flight stands, plant steps with a height held, least height over anything (m)."""

    ending: Any = GOING
    held_steps: Any = 0.0
    nearest_m: Any = float("inf")


class GroundTorque(NamedTuple):
    """Torques of the thrust that surfaces below add, for the log: N m."""

    roll_Nm: Any = 0.0
    pitch_Nm: Any = 0.0


TICK, GUST, NOISE = Slot(0, FlightTick()), Slot(0, GustRow()), Slot(0, GyroNoise())


class FlightPlaces(NamedTuple):
    """Where every record stands in the block."""

    body: Slot
    rotors: Slot
    targets: Slot
    measured: Slot
    wanted: Slot
    command: Slot
    law_state: Slot
    below: Slot
    expected: Slot
    ground: Slot
    outcome: Slot
    craft: Slot
    chart: Slot
    motion: Slot
    law: Slot
    effects: Slot
    nothing: Slot


class FlightArrays(NamedTuple):
    """Hold the arrays of a flight.

    Attributes:
        w: the records (`FlightPlaces`).
        states: state of the random numbers (1,).
        sent: speeds commanded lately (n_rotors, n_ring, 1).
        log: (n_rows, n_logged, 1), filled with the rows `logged` of `w`.
        logged: rows to log (n_logged,).
        schedule: (n_numbers, n_ticks), a `FlightTick` per column.
        noise: (3, n_ticks), a `GyroNoise` per column; or one column that holds for all.
        gusts: (n_numbers, n_gusts), a `GustRow` per column.
        scratch: a column of `ground.DISC` per disc.
        geometry: a `FlightGeometry` (n_numbers,).
        below, chart: tables of what is there, and of the map of it.
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
    chart: Tables = Tables()


def geometry_slot(n_discs: int, n_body: int) -> Slot:
    """Return the slot of a geometry."""
    discs = (0.0,) * n_discs
    return Slot(
        0,
        FlightGeometry(0.0, discs, discs, (discs,) * n_discs, BodyImages(*((0.0,) * n_body,) * 3)),
    )


@lru_cache(maxsize=64)
def flight_layout(n_discs: int, n_rotors: int, n_numbers: int, law: Any, law_state: Any) -> Layout:
    """Return the layout for so many discs, rotors and effects' numbers, and for a law."""
    discs, rotors = (0.0,) * n_discs, (0.0,) * n_rotors
    below = Below(discs, discs, discs, discs)
    scalars = len(Craft._fields) - 8
    return Layout(
        FlightPlaces,
        body=FreeBody(),
        rotors=Rotors(rotors),
        targets=Targets(rotors, rotors, rotors),
        measured=FlightMeasurement._make([*[0.0] * 13, discs, discs]),
        wanted=FlightTick(),
        command=FlightCommand(0.0, 0.0, 0.0, 0.0, (1.0,) * n_discs),
        law_state=law_state,
        below=below,
        expected=below,
        ground=GroundTorque(),
        outcome=FlightOutcome(),
        craft=Craft(0.0, (0.0, 0.0, 0.0), *[0.0] * (scalars - 1), *[rotors] * 7),
        chart=MapUse(),
        motion=Motion(),
        law=law,
        effects=(0.0,) * max(n_numbers, 1),
        nothing=float("nan"),
    )


def tick_rows(field: str) -> slice:
    """Return the rows of a field of `FlightTick` in a schedule."""
    return rows_in(TICK, field)
