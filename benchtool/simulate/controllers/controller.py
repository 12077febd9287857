"""Controller interface: one method, called once per control period; user-defined controllers.

A user-defined controller is any class with `step`; it may have state, and a simulation makes a new
instance for every run. A built-in law is a function of numbers and states (`ControlLaw`), so that
it also runs inside the compiled loop.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias, TypeVar

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.user_code import CodePermit, check_code_allowed, load_user_module
from benchtool.physics.expression import expression

GRAVITY_M_S2 = 9.81  # standard gravity, rounded as in the paper

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
            `FlightCommand`. An expression, or in flight an `@inlined_expression`, because a flight
            has one lane: the same source runs in Python and in the compiled loop.
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

    def __post_init__(self) -> None:
        expression(self.step)


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

Controllers = Iterable[str | type[Any]]  # built-in names, ``module:Class``, or classes


def split_controllers(
    controllers: Controllers,
    builtin_names: Collection[Any],
    permit: CodePermit = check_code_allowed,
) -> tuple[tuple[str, ...], list[tuple[str, type[Any]]]]:
    """Return the names of built-in controllers, and name and class of each user-defined one."""
    is_one = isinstance(controllers, str | type) or not isinstance(controllers, Iterable)
    entries: tuple[Any, ...] = (controllers,) if is_one else tuple(controllers)
    for entry in entries:
        if not isinstance(entry, str) and not hasattr(entry, "__name__"):
            raise InputError(f"controller {entry!r:.60} is an instance; give its class")
    names = [entry if isinstance(entry, str) else entry.__name__ for entry in entries]
    if len(set(names)) < len(names) or not names:
        raise InputError(f"controllers {', '.join(names) or 'none'} are invalid; name each once")
    user_defined = [
        (
            name,
            load_controller_class(entry, builtin_names, permit)
            if isinstance(entry, str)
            else entry,
        )
        for name, entry in zip(names, entries, strict=True)
        if entry not in builtin_names
    ]
    return tuple(name for name in names if name in builtin_names), user_defined


def make_controller(controller: type[Any], name: str) -> Any:
    """Return a new controller, constructed without arguments, for one run."""
    try:
        return controller()
    except (Exception, SystemExit) as error:
        raise InputError(
            f"controller {name!r} cannot be constructed without arguments: {type(error).__name__}: "
            f"{_message(error)}{_location(controller, '__init__')}; give its arguments "
            f"defaults"
        ) from error


def controller_error(controller: Any, error: BaseException, time_s: float) -> InputError:
    """Return an error with the line of the user's file that raised."""
    frames = traceback.extract_tb(error.__traceback__)
    code = _code(type(controller), "step")
    user_frames = [frame for frame in frames if code and frame.filename == code.co_filename]
    if not user_frames and isinstance(error, TypeError):  # the call itself failed
        return InputError(
            f"controller {type(controller).__name__} cannot be called: "
            f"{_message(error)}{_location(type(controller), 'step')}; write it as step(self, "
            f"measurement, reference, dt_s)"
        )
    frame = user_frames[-1] if user_frames else frames[-1]
    return InputError(
        f"controller {type(controller).__name__} raised {type(error).__name__}: {_message(error)} "
        f"at {time_s:g} s, in {frame.filename} line {frame.lineno}: {frame.line}; correct that line"
    )


def invalid_command_error(
    controller: Any, field: str, value: Any, time_s: float, remedy: str
) -> InputError:
    """Return an error about an invalid return value of a controller."""
    text = " ".join(repr(value).split())
    return InputError(
        f"controller {type(controller).__name__} returned {field} = {text[:80]} at {time_s:g} s"
        f"{_location(type(controller), 'step')}; return {remedy}"
    )


def _message(error: BaseException) -> str:
    return " ".join(str(error).split()) or "no message"


def _location(controller: type[Any], method: str) -> str:
    """Return file and line of a method as text; "" if it is not Python code."""
    code = _code(controller, method)
    return f", in {code.co_filename} line {code.co_firstlineno}" if code is not None else ""


def _code(controller: type[Any], method: str) -> Any:
    return getattr(getattr(controller, method, None), "__code__", None)


def load_controller_class(
    name: str, builtin_names: Iterable[str], permit: CodePermit = check_code_allowed
) -> type[Any]:
    """Return the class `module:Class`; modules are also looked up in the current folder."""
    module_name, _, class_name = name.partition(":")
    if not module_name or not class_name:
        raise UnknownChoice("controller (and not of the form module:Class)", name, builtin_names)
    if module_name.endswith(".py"):
        raise InputError(
            f"controller {name!r} is a file; use the module: "
            f"{Path(module_name).stem}:{class_name}, from the folder of the file"
        )
    module = load_user_module(
        module_name,
        f"controller {name!r}",
        f"run in the folder of {module_name}.py, or install it",
        permit,
    )
    controller = getattr(module, class_name, None)
    if not isinstance(controller, type) or not callable(getattr(controller, "step", None)):
        raise InputError(
            f"controller {name!r}: {module_name} has no class {class_name} with a method step"
        )
    return controller
