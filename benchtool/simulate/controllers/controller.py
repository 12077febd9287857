"""The seam for controllers: one method, called once per control period.

A user's controller is any class with `step`; it may keep state, and a simulation makes a new one
for every run. A built-in law is a function of numbers and states (`ControlLaw`), so that it runs
inside the compiled loop too; `LawController` makes a controller of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias, TypeVar

MeasurementT = TypeVar("MeasurementT", contravariant=True)
ReferenceT = TypeVar("ReferenceT", contravariant=True)
CommandT = TypeVar("CommandT", covariant=True)


class Controller(Protocol[MeasurementT, ReferenceT, CommandT]):
    """Turn what was measured into what is commanded."""

    def step(self, measurement: MeasurementT, reference: ReferenceT, dt_s: float) -> CommandT:
        """Return the command for the control period that begins now."""
        ...


class PitchMeasurement(NamedTuple):
    """What a pitch bench's controller sees.

    Attributes:
        theta_rad: encoder, positive nose down.
        plate_z_m: reading of the plate's distance with the beam level: m.
    """

    time_s: float
    theta_rad: float
    rate_rad_s: float
    plate_z_m: float
    speed_rad_s: tuple[float, ...]


class PitchReference(NamedTuple):
    """What is wanted of a pitch bench: attitude (rad) and collective thrust per rotor (N).

    `observer` is 1 while the schedule lets a disturbance observer act, else 0.
    """

    theta_rad: float
    collective_N: float
    observer: float = 1.0


class PitchCommand(NamedTuple):
    """What a pitch bench is commanded to do.

    Attributes:
        torque_Nm: wanted torque about the pitch axis, positive nose down; the mixer shares it out.
        difference_us: added to the pulse of the rotors that push nose down, subtracted from the
            opposite ones; for laws that are written in pulse widths.
    """

    torque_Nm: float
    difference_us: float = 0.0


class PitchPlant(NamedTuple):
    """What a law may know of the bench: inertia about the hinge, and what the mixer can give."""

    inertia_kgm2: float
    torque_limit_Nm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlLaw:
    """Describe a built-in law.

    Attributes:
        name, title: as on the command line, and one line for people.
        body: what it controls: "hinged" is a pitch bench, "free" a vehicle in flight.
        step: step(p, state, measurement, reference, dt_s) -> state, command: a `PitchCommand` or a
            `FlightCommand`. Marked `@expression`, so that the same source runs in Python and in the
            compiled loop; in flight `@loop_part` does too, because a flight has one lane.
        state: at the beginning, a named tuple of floats and tuples of them. A field `estimate_Nm`
            is logged as the disturbance that the law sees; in flight, what `flight.LOGGED` names.
        numbers: numbers(control, plant) -> p, a named tuple of floats and tuples of them; of a
            `PitchControl` and a `PitchPlant`, or of a `FlightCase` and the rig's `Body`.
    """

    name: str
    title: str
    body: Literal["hinged", "free"] = "hinged"
    step: Callable[..., Any]
    state: Any
    numbers: Callable[[Any, Any], Any]


class LawController:
    """Run a built-in law as a `Controller`, outside of a compiled loop."""

    def __init__(self, law: ControlLaw, numbers: Any) -> None:
        self.law, self.numbers, self.state = law, numbers, law.state

    def step(self, measurement: Any, reference: Any, dt_s: float) -> Any:
        self.state, command = self.law.step(self.numbers, self.state, measurement, reference, dt_s)
        return command


class FlightMeasurement(NamedTuple):
    """What a flight controller sees; names and units as in a flight's log.

    Attributes:
        x_m, y_m, z_m: place, without error.
        vx_m_s, vy_m_s, vz_m_s: velocity, without error.
        roll_rad, pitch_rad, yaw_rad: attitude, without error.
        p_rad_s, q_rad_s, r_rad_s: gyro, with its noise.
        height_m: of each disc over what the map has below most of it (n_discs,); infinite over
            nothing, not below half a radius, where the formulae end.
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
