"""Flight set-up from names and numbers, and named changes of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Self

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.schedule import MAX_DURATION_S
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.physics.model_file import load_model
from benchtool.simulate.flight.cases import FLIGHTS, GYRO_NOISE_RAD_S, FlightCase, Goal, flight_case
from benchtool.simulate.flight.environment import Environment, read_map
from benchtool.simulate.flight.flight import fly
from benchtool.simulate.flight.study import check_duration, measure
from benchtool.simulate.flight.vehicle import RANGES, FlightVehicle
from benchtool.simulate.gain_file import Gains, load_gains
from benchtool.simulate.inputs import CONTROL_HZ, FlightInputs, Point, Row, Setup, check_range
from benchtool.simulate.loop import results_in_order

FLIGHT_NUMBERS = (
    "z_over_R", "speed_m_s", "gyro_noise_rad_s", "map_strength", "drag_N_s_m", "step_s",
)  # fmt: skip
VEHICLE_NUMBERS = tuple(name for name in RANGES if name not in FLIGHT_NUMBERS)
MAP_OFFSETS = ("map_offset_x_m", "map_offset_y_m", "map_offset_z_m")
GAIN_TABLES = ("gains.position", "gains.attitude", "gains.altitude", "gains.yaw", "gains.observer")
MAX_DISTANCE_M = 1000.0  # of a goal, and of a map offset; assumed
DEFAULT_STEP_S, MIN_STEP_S = 0.001, 1e-6  # plant step

# Names that can be set or varied; also every single gain, such as gains.attitude.k_q_per_s.
CHANGEABLE = (*FLIGHT_NUMBERS, *VEHICLE_NUMBERS, *MAP_OFFSETS, *GAIN_TABLES)
OGE = "oge"  # PID without ground effect, the reference of a gain set

MEASURES = {  # of every flight, as in its table; arrives_s is nan without arrival
    "arrives": "share of flights that arrive",
    "struck": "share of flights that strike the obstacle",
    "arrives_s": "time of arrival [s]",
    "max_x_m": "furthest x [m]",
    "push_backs": "push-backs of more than 3 cm",
    "max_pitch_deg": "largest pitch [deg]",
    "rms_pitch_deg": "RMS of pitch [deg]",
    "max_roll_deg": "largest roll [deg]",
    "swing_m": "swing of x over the last 20 s [m]",
}


@dataclass(frozen=True, kw_only=True)
class FlightSetup(Setup):
    """Built-in flight with its settings.

    Attributes:
        goal_m: x and y of the goal; None means that of the case.
        below: environment; None means that of the case.
        step_s: largest plant step, at most a control period; None means 1 ms.
        drag_N_s_m: drag coefficient of the vehicle; None means that of the case.
        ramp, gyro_noise_rad_s, map_offset_m, map_strength: as in `FlightCase`.
    """

    measures = MEASURES

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
        """Return the case of one controller and noise seed; `OGE` is PID without surfaces."""
        if control == OGE:
            return replace(self.build_case("pid", seed), below=Environment())
        if self.case not in FLIGHTS:
            raise UnknownChoice("flight", self.case, FLIGHTS)
        built_in = FLIGHTS[self.case]
        changes: dict[str, Any] = {
            "title": built_in.title,
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
        if self.below is not None:
            changes |= {"below": self.below, "title": f"Flying over {self.below.name}"}
        if self.goal_m is not None:
            x_m, y_m = self.goal_m
            z_m = self.z_over_R * self.vehicle.rig.propulsion.radius_m
            speed_m_s = built_in.speed_m_s if self.speed_m_s is None else self.speed_m_s
            changes["title"] += f", to x {x_m:g} m, y {y_m:g} m"
            changes["goals"] = (Goal(x_m=x_m, y_m=y_m, z_m=z_m, speed_m_s=speed_m_s),)
        case = flight_case(
            self.case, self.vehicle, self.gains,
            z_over_R=self.z_over_R, speed_m_s=self.speed_m_s, **changes,
        )  # fmt: skip
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
        vehicle = {name: self.vehicle.number(name) for name in VEHICLE_NUMBERS}
        flight = {name: getattr(self, name) for name in FLIGHT_NUMBERS}
        offsets = dict(zip(MAP_OFFSETS, self.map_offset_m, strict=True))
        numbers = {**flight, **vehicle, **offsets, "duration_s": self.duration_s}
        texts = {
            name: "the flight's own" if value is None else f"{value:g}"
            for name, value in numbers.items()
        }
        environment = "the flight's own" if self.below is None else self.below.name
        head = {"flight": self.case, "rig": self.vehicle.rig.name, "environment": environment}
        return {**head, **texts}

    @property
    def campaign_title(self) -> str:
        return f"{self.build_case('pid').title}, {self.vehicle.rig.name}"

    def with_number(self, name: str, value: float) -> Self:
        """Return the setup with one number changed, by name.

        A name is one of `CHANGEABLE` (the value of a table of gains is a factor on its gains), or a
        single gain ("gains.attitude.k_q_per_s").
        """
        name = full_name(name)
        numbers: dict[str, Any] = {name: value}
        if name.startswith("gains."):
            gains = self.gains.with_values(**{name.removeprefix("gains."): value})
            return replace(self, gains=gains)
        if name in VEHICLE_NUMBERS:
            return replace(self, vehicle=self.vehicle.with_numbers(**numbers))
        if name in MAP_OFFSETS:
            offsets_m = list(self.map_offset_m)
            offsets_m[MAP_OFFSETS.index(name)] = value
            numbers = {"map_offset_m": tuple(offsets_m)}
        return replace(self, **numbers)

    def check_point(self, point: Point, varied: Sequence[str], seeds: int, controller: str) -> None:
        """Fly the first two control periods of a point; raise InputError if it cannot start."""
        has_noise = self.gyro_noise_rad_s > 0.0 or "gyro_noise_rad_s" in varied
        if seeds > 1 and not has_noise:
            raise InputError(
                f"{seeds} seeds give identical flights without gyro noise; "
                f"set --gyro-noise-rad-s (paper: 0.015) or remove --seeds"
            )
        try:
            case = self.with_changes(point).build_case(controller)
            if warning := check_duration(case):
                raise InputError(warning)
            fly(replace(case, duration_s=2.0 / case.gains.control_rate_Hz))
        except UnknownChoice:
            raise
        except InputError as error:
            raise _at_point(error, point) from error

    def build_run(self, controller: str, point: Point) -> FlightRun:
        return self.with_changes(point), controller, point

    @staticmethod
    def measure_runs(
        runs: Iterator[tuple[FlightRun, int]], seed: int, threads: int | None
    ) -> Iterator[Row]:
        flights = (partial(_measure_flight, *run, seed + number) for run, number in runs)
        return results_in_order(flights, threads)


FlightRun = tuple[FlightSetup, str, Point]  # set-up at a point, controller, and the point


def _measure_flight(setup: FlightSetup, controller: str, point: Point, seed: int) -> Row:
    try:
        measures = measure(fly(setup.build_case(controller, seed)))
    except InputError as error:
        raise _at_point(error, point) from error
    # "struck" is an ending, not an attribute.
    numbers = {name: float(getattr(measures, name, measures.ending == name)) for name in MEASURES}
    return {"ending": measures.ending, **numbers, "held_ticks": float(measures.held_ticks)}


def _at_point(error: InputError, point: Point) -> InputError:
    """Return an error with the point of the design in its message."""
    values = ", ".join(f"{name} = {value:g}" for name, value in point.items())
    return InputError(f"{error} (at {values})")


def flight_setup(
    inputs: FlightInputs, gains: str = "s3", permit: CodePermit = check_code_allowed
) -> FlightSetup:
    """Return the setup of one gain set; `permit` is called before user code of a model is run."""
    noise_rad_s = inputs.gyro_noise_rad_s
    if noise_rad_s is None:
        noise_rad_s = GYRO_NOISE_RAD_S if inputs.study.campaign.seeds > 1 else 0.0
    rig = load_rig_by_name(inputs.rig)
    vehicle = FlightVehicle.of_rig(rig)
    if inputs.model:
        vehicle = FlightVehicle(model=load_model(inputs.model, rig, permit).model)
    if inputs.lag_s or not inputs.model:
        vehicle = vehicle.with_numbers(lag_s=inputs.lag_s)
    setup = FlightSetup(
        case=inputs.case,
        vehicle=replace(vehicle, turned_deg=45.0 if inputs.layout == "cross" else 0.0),
        gains=load_gains(gains),
        z_over_R=inputs.z_over_R,
        speed_m_s=inputs.speed_m_s,
        duration_s=inputs.study.duration_s,
        goal_m=inputs.goal_m,
        below=None if inputs.map is None else read_map(inputs.map),
        ramp=inputs.ramp,
        gyro_noise_rad_s=noise_rad_s,
        map_offset_m=inputs.map_offset_m,
    )
    return setup.with_changes(inputs.study.settings)


def full_name(name: str) -> str:
    """Return the full name of a number from its name with or without unit."""
    if name in CHANGEABLE or (name.startswith("gains.") and len(name) > len("gains.")):
        return name
    matches = [number_name for number_name in CHANGEABLE if number_name.startswith(f"{name}_")]
    if len(matches) == 1:
        return matches[0]
    raise UnknownChoice("number of a flight", name, matches or CHANGEABLE)
