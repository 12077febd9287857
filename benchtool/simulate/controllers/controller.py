"""Controller interface: one method, called once per control period.

A user-defined controller is any class with `step`; it may have state, and a simulation makes a new
instance for every run. A built-in law is a function of numbers and states (`ControlLaw`), so that
it also runs inside the compiled loop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias, TypeVar

MeasurementT = TypeVar("MeasurementT", contravariant=True)
ReferenceT = TypeVar("ReferenceT", contravariant=True)
CommandT = TypeVar("CommandT", covariant=True)


class Controller(Protocol[MeasurementT, ReferenceT, CommandT]):
    """Controller: computes commands from measurements and references."""

    def step(self, measurement: MeasurementT, reference: ReferenceT, dt_s: float) -> CommandT:
        """Return the command for the control period that begins now."""
        ...


class PitchMeasurement(NamedTuple):
    """Readings for the controller of a pitch bench.

    Attributes:
        theta_rad: encoder reading, positive nose down.
        plate_z_m: reading of the plate distance with the beam level.
    """

    time_s: float
    theta_rad: float
    rate_rad_s: float
    plate_z_m: float
    speed_rad_s: tuple[float, ...]


class PitchReference(NamedTuple):
    """Reference of a pitch bench: attitude (rad) and collective thrust per rotor (N).

    `observer` is 1 while the schedule enables a disturbance observer, else 0.
    """

    theta_rad: float
    collective_N: float
    observer: float = 1.0


class PitchCommand(NamedTuple):
    """Command of a pitch bench.

    Attributes:
        torque_Nm: torque about the pitch axis, positive nose down; the mixer allocates it.
        difference_us: added to the pulse width of the rotors that push nose down, subtracted from
            the opposite ones; for laws in pulse widths.
    """

    torque_Nm: float
    difference_us: float = 0.0


class PitchPlant(NamedTuple):
    """Plant data for a law: inertia about the hinge, torque limit of the mixer."""

    inertia_kgm2: float
    torque_limit_Nm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlLaw:
    """Built-in control law.

    Attributes:
        name, title: name on the command line, and label.
        body: controlled body: "hinged" is a pitch bench, "free" a vehicle in flight.
        step: step(p, state, measurement, reference, dt_s) -> state, command: a `PitchCommand` or a
            `FlightCommand`. Marked `@expression`, so that the same source runs in Python and in the
            compiled loop; in flight `@inlined_expression` does too, because a flight has one lane.
        state: initial state, a named tuple of floats and tuples of them. A field `estimate_Nm` is
            logged as the disturbance estimate; in flight, the fields in `flight.LOGGED`.
        numbers: numbers(control, plant) -> p, a named tuple of floats and tuples of them; arguments
            are a `PitchControl` and a `PitchPlant`, or a `FlightCase` and the rig's `Body`.
    """

    name: str
    title: str
    body: Literal["hinged", "free"] = "hinged"
    step: Callable[..., Any]
    state: Any
    numbers: Callable[[Any, Any], Any]


class FlightMeasurement(NamedTuple):
    """Readings for a flight controller; names and units as in a flight log.

    Attributes:
        x_m, y_m, z_m: position, without error.
        vx_m_s, vy_m_s, vz_m_s: velocity, without error.
        roll_rad, pitch_rad, yaw_rad: attitude, without error.
        p_rad_s, q_rad_s, r_rad_s: gyro, with noise.
        height_m: of each disc over the mapped surface below most of it (n_discs,); infinite where
            there is none, at least half a radius (validity limit of the formulae).
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
    """Reference of a flight.

    Attributes:
        x_m, y_m, z_m: target position; moves towards the goal where the case uses a ramp.
        yaw_rad: heading.
        speed_m_s: speed limit.
        hover_N: total thrust that equals the weight.
    """

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    speed_m_s: float
    hover_N: float


class FlightCommand(NamedTuple):
    """Command of a flight controller for one period; the mixer allocates it to the rotors.

    Attributes:
        thrust_N: total thrust.
        roll_Nm, pitch_Nm, yaw_Nm: torques about the body axes.
        divide_by: expected ground-effect factor of each disc, its thrust is divided by it
            (n_discs,); () for none.
    """

    thrust_N: float
    roll_Nm: float
    pitch_Nm: float
    yaw_Nm: float
    divide_by: tuple[float, ...] = ()


# A plain tuple of four numbers is accepted as a command, too.
FlightController: TypeAlias = Controller[FlightMeasurement, FlightReference, FlightCommand]
