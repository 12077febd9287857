"""What a controller of one's own sees and says in flight, period by period.

The seam is `Controller`: a class with `step`, made anew for every flight. Axes: x, y horizontal and
z up; body x forward, y left, z up. Positive pitch is nose down, positive roll lifts the left side.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

from benchtool.simulate.controllers.controller import Controller


class FlightMeasurement(NamedTuple):
    """What a flight controller sees; names and units as in a flight's log.

    Attributes:
        time_s: since the flight began.
        x_m, y_m, z_m: place, without error.
        vx_m_s, vy_m_s, vz_m_s: velocity, without error.
        roll_rad, pitch_rad, yaw_rad: attitude, without error.
        p_rad_s, q_rad_s, r_rad_s: gyro, with its noise.
        height_m: of each disc over what the map has below most of it (n_discs,); infinite over
            nothing, not below half a radius, where the formulae end.
        coverage: fraction of each disc over something, by the map (n_discs,).
    """

    time_s: float
    x_m: float
    y_m: float
    z_m: float
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    p_rad_s: float
    q_rad_s: float
    r_rad_s: float
    height_m: tuple[float, ...]
    coverage: tuple[float, ...]


class FlightReference(NamedTuple):
    """What is wanted in flight.

    Attributes:
        x_m, y_m, z_m: where to go; on the way there, where the case leads along a ramp.
        yaw_rad: heading to hold.
        speed_m_s: speed limit.
        hover_N: thrust of all rotors together that carries the weight.
    """

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    speed_m_s: float
    hover_N: float


class FlightCommand(NamedTuple):
    """What a flight controller asks for until its next period; the mixer shares it out.

    Attributes:
        thrust_N: of all rotors together.
        roll_Nm, pitch_Nm, yaw_Nm: torques about the body's axes.
        divide_by: factor that each disc's thrust is divided by (n_discs,), where the controller
            expects ground effect; () for none.
    """

    thrust_N: float
    roll_Nm: float
    pitch_Nm: float
    yaw_Nm: float
    divide_by: tuple[float, ...] = ()


FlightController: TypeAlias = Controller[FlightMeasurement, FlightReference, FlightCommand]
"""A flight controller is a `Controller` of these; a plain tuple of four numbers is taken too."""
