"""Flight setup from names and numbers, and named changes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.schedule import MAX_DURATION_S
from benchtool.simulate.flight.cases import FLIGHTS, flight_case
from benchtool.simulate.flight.environment import Environment
from benchtool.simulate.flight.flight import FlightCase, Goal
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import Gains
from benchtool.simulate.ranges import check_range

FLIGHT_NUMBERS = (
    "z_over_R", "speed_m_s", "gyro_noise_rad_s", "map_strength", "drag_N_s_m", "step_s",
)  # fmt: skip
VEHICLE_NUMBERS = (
    "K_b", "neighbours", "lag_s", "turned_deg", "inertia_scale", "undercarriage_m",
)  # fmt: skip
MAP_OFFSETS = ("map_offset_x_m", "map_offset_y_m", "map_offset_z_m")
GAIN_TABLES = ("gains.position", "gains.attitude", "gains.altitude", "gains.yaw", "gains.observer")
CONTROL_HZ = (1.0, 1e5)  # range of control rates: up to 1000 times that of an autopilot; assumed
MAX_DISTANCE_M = 1000.0  # of a goal, and of a map offset; assumed
DEFAULT_STEP_S, MIN_STEP_S = 0.001, 1e-6  # plant step

# Names that can be set or varied; also every single gain, such as gains.attitude.k_q_per_s.
CHANGEABLE = (*FLIGHT_NUMBERS, *VEHICLE_NUMBERS, *MAP_OFFSETS, *GAIN_TABLES)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightSetup:
    """Built-in flight with its settings.

    Attributes:
        goal_m: x and y of the goal; None means that of the case.
        below: environment; None means that of the case.
        step_s: largest plant step, at most a control period; None means 1 ms.
        drag_N_s_m: drag coefficient of the vehicle; None means that of the case.
        ramp, gyro_noise_rad_s, map_offset_m, map_strength: as in `FlightCase`.
    """

    case: str
    vehicle: FlightVehicle
    gains: Gains
    z_over_R: float = 2.0
    speed_m_s: float | None = None
    duration_s: float | None = None
    goal_m: tuple[float, float] | None = None
    below: Environment | None = None
    drag_N_s_m: float | None = None
    step_s: float | None = None
    ramp: bool = False
    gyro_noise_rad_s: float = 0.0
    map_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    map_strength: float = 1.0

    def __post_init__(self) -> None:
        for name, values in (("goal_m", self.goal_m or ()), ("map_offset_m", self.map_offset_m)):
            for value in values:
                check_range(name, value, -MAX_DISTANCE_M, MAX_DISTANCE_M)
        if self.duration_s is not None:
            check_range("duration_s", self.duration_s, 0.0, MAX_DURATION_S)

    def build_case(self, control: str, seed: int = 1) -> FlightCase:
        """Return the case of one controller and noise seed."""
        changes: dict[str, Any] = {
            "step_s": self._step_s(),
            "control": control,
            "seed": seed,
            "ramp": self.ramp,
            "gyro_noise_rad_s": self.gyro_noise_rad_s,
            "map_offset_m": self.map_offset_m,
            "map_strength": self.map_strength,
        }
        if self.duration_s is not None:
            changes["duration_s"] = self.duration_s
        title = FLIGHTS[self.case].title if self.case in FLIGHTS else ""
        if self.below is not None:
            changes["below"] = self.below
            title = f"Flying over {self.below.name}"
        if self.goal_m is not None and self.case in FLIGHTS:
            x_m, y_m = self.goal_m
            z_m = self.z_over_R * self.vehicle.rig.propulsion.radius_m
            speed_m_s = FLIGHTS[self.case].speed_m_s if self.speed_m_s is None else self.speed_m_s
            title += f", to x {x_m:g} m, y {y_m:g} m"
            changes["goals"] = (Goal(x_m=x_m, y_m=y_m, z_m=z_m, speed_m_s=speed_m_s),)
        case = flight_case(
            self.case, self.vehicle, self.gains,
            z_over_R=self.z_over_R, speed_m_s=self.speed_m_s, **changes,
        )  # fmt: skip
        case = replace(case, title=title)
        if self.drag_N_s_m is None:
            return case
        return replace(case, vehicle=replace(case.vehicle, drag_N_s_m=self.drag_N_s_m))

    def _step_s(self) -> float:
        """Return the plant step; raise if control rate or motor lag are out of range."""
        rate_Hz, lag_s = self.gains.control_rate_Hz, self.vehicle.model.lag_s
        check_range("control_rate_Hz", rate_Hz, *CONTROL_HZ)
        if 0.0 < lag_s < 2.0 * MIN_STEP_S:
            raise InputError(
                f"lag_s is {lag_s:g}; allowed: from {2.0 * MIN_STEP_S:g} s, or 0 for motors "
                f"without lag"
            )
        step_s = DEFAULT_STEP_S if self.step_s is None else self.step_s
        if 0.0 < lag_s < 2.0 * min(step_s, 1.0 / rate_Hz):
            raise InputError(
                f"lag_s is {lag_s:g}, too short for a step_s of {step_s:g}; add --set "
                f"step_s={0.4 * lag_s:g}, or use a longer lag, or 0 for motors without lag"
            )
        return min(step_s, 1.0 / rate_Hz)

    def to_metadata(self) -> dict[str, str]:
        """Return the settings as text by name."""
        vehicle = {name: self.vehicle.number(name) for name in VEHICLE_NUMBERS}
        flight = {name: getattr(self, name) for name in FLIGHT_NUMBERS}
        offsets = dict(zip(MAP_OFFSETS, self.map_offset_m, strict=True))
        numbers = {**flight, **vehicle, **offsets, "duration_s": self.duration_s}
        texts = {
            name: "the flight's own" if value is None else f"{value:g}"
            for name, value in numbers.items()
        }
        environment = "the flight's own" if self.below is None else self.below.name
        return {"rig": self.vehicle.rig.name, "environment": environment, **texts}


def full_name(name: str) -> str:
    """Return the full name of a number from its name with or without unit.

    Raises:
        UnknownChoice: the name is unknown or ambiguous.
    """
    if name in CHANGEABLE or (name.startswith("gains.") and len(name) > len("gains.")):
        return name
    matches = [number_name for number_name in CHANGEABLE if number_name.startswith(f"{name}_")]
    if len(matches) == 1:
        return matches[0]
    raise UnknownChoice("number of a flight", name, matches or CHANGEABLE)


def with_changes(setup: FlightSetup, values: Mapping[str, float]) -> FlightSetup:
    """Return the setup with some numbers changed, by name.

    A name is one of `CHANGEABLE` (the value of a table of gains is a factor on its gains), or a
    single gain ("gains.attitude.k_q_per_s").
    """
    for name, value in values.items():
        setup = _with_number(setup, full_name(name), float(value))
    return setup


def _with_number(setup: FlightSetup, name: str, value: float) -> FlightSetup:
    numbers: dict[str, Any] = {name: value}
    if name.startswith("gains."):
        gains = setup.gains.with_values(**{name.removeprefix("gains."): value})
        return replace(setup, gains=gains)
    if name in VEHICLE_NUMBERS:
        return replace(setup, vehicle=setup.vehicle.with_numbers(**numbers))
    if name in MAP_OFFSETS:
        x_m, y_m, z_m = (
            value if offset_name == name else offset_m
            for offset_name, offset_m in zip(MAP_OFFSETS, setup.map_offset_m, strict=True)
        )
        return replace(setup, map_offset_m=(x_m, y_m, z_m))
    return replace(setup, **numbers)
