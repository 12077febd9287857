"""Simulation of one flight over an environment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import repeat
from math import inf, isfinite
from typing import Any, Literal, get_args

import numpy as np

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.units import Array
from benchtool.physics.expression import flat_values
from benchtool.simulate.controllers.controller import (
    ControlLaw,
    FlightCommand,
    FlightController,
    FlightMeasurement,
    FlightReference,
)
from benchtool.simulate.controllers.laws import find_law
from benchtool.simulate.flight.cases import FlightCase, Goal
from benchtool.simulate.flight.ground import Below, DiscBelow
from benchtool.simulate.flight.loops import (
    STRUCK,
    TICK,
    FlightArrays,
    FlightLoops,
    FlightOutcome,
    FlightTick,
    GroundTorque,
    MapUse,
    flight_loops,
)
from benchtool.simulate.flight.vehicle import FlightVehicle, FreeBody, at_rest
from benchtool.simulate.hooks import Rotors, Targets, build_motion, loop_effects, loop_numbers
from benchtool.simulate.layout import Layout, record_layout, rows_in, zero_record
from benchtool.simulate.loop import BUILT_IN, CALLER, Loop, LoopPlan, command_ring
from benchtool.simulate.noise import lane_states

Ending = Literal["flown", "struck", "lost"]  # by GOING, STRUCK and LOST

_new = tuple.__new__  # faster than the constructors of named tuples
COMMAND_REMEDY = "a FlightCommand(thrust_N, roll_Nm, pitch_Nm, yaw_Nm) of finite numbers"

# First columns of a log with their record fields; then coverage, height and factor per disc and
# speed per rotor.
LOGGED = {
    "time_s": "measured.time_s", "x_m": "body.x_m", "y_m": "body.y_m", "z_m": "body.z_m",
    "vx_m_s": "body.vx_m_s", "vy_m_s": "body.vy_m_s", "vz_m_s": "body.vz_m_s",
    "roll_rad": "measured.roll_rad", "pitch_rad": "measured.pitch_rad",
    "yaw_rad": "measured.yaw_rad",
    "p_rad_s": "body.p_rad_s", "q_rad_s": "body.q_rad_s", "r_rad_s": "body.r_rad_s",
    "roll_ref_rad": "law_state.attitude.roll_rad", "pitch_ref_rad": "law_state.attitude.pitch_rad",
    "yaw_ref_rad": "law_state.attitude.yaw_rad",
    "roll_estimate_Nm": "law_state.estimate.roll_Nm",
    "pitch_estimate_Nm": "law_state.estimate.pitch_Nm",
    "yaw_estimate_Nm": "law_state.estimate.yaw_Nm",
    "force_z_estimate_N": "law_state.estimate.force_z_N",
    "roll_ground_Nm": "ground.roll_Nm", "pitch_ground_Nm": "ground.pitch_Nm",
    "x_goal_m": "scheduled.goal_x_m", "y_goal_m": "scheduled.goal_y_m",
    "z_goal_m": "scheduled.goal_z_m",
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """Simulated flight.

    Attributes:
        ending: "flown" to the end, "struck" an obstacle, or "lost" (numbers not finite).
        held_ticks: plant steps with a height clamped to the validity limit of the formulae.
        nearest_m: least height of a rotor over a surface; infinite without any.
        user_controller: name of a user-defined controller; "" for that of the case.
    """

    case: FlightCase
    names: tuple[str, ...]
    log: Array
    ending: Ending
    end_s: float
    held_ticks: int
    nearest_m: float
    user_controller: str = ""

    def __getitem__(self, name: str) -> Array:
        """Return a column (rows,)."""
        if name not in self.names:
            raise UnknownChoice("column of a flight", name, self.names)
        return self.log[:, self.names.index(name)]


def fly(case: FlightCase) -> Flight:
    """Fly a case; its map must cover the path, and its start must not touch a surface."""
    loop = FlightLoop(case)
    loop.ended = loop.advance(-1, loop.n_ticks)
    return loop.flight()


def fly_user_controller(case: FlightCase, controller: FlightController, name: str) -> Flight:
    """Fly a case with a user-defined controller.

    It gets the map of the case, with its errors. Of gains and control of the case, only the control
    rate of the gains has an effect.

    Raises:
        InputError: as `fly`; or the controller raised, or returned an invalid command.
    """
    loop = FlightLoop(case, external=True)
    loop.advance(-1, 0)
    loop.ended = loop.run_controller(controller, 0, loop.n_ticks)
    return loop.flight(name)


class FlightLoop(Loop):
    """Loop of one flight; with `external` the caller is the controller and gets the map."""

    loops: FlightLoops
    arrays: FlightArrays

    def __init__(self, case: FlightCase, external: bool = False) -> None:
        vehicle, rate_Hz = case.vehicle, case.gains.control_rate_Hz
        rig, radius_m = vehicle.rig, vehicle.rig.propulsion.radius_m
        self.case, self.rate_Hz = case, rate_Hz
        if case.below.grid is not None:
            case.below.grid.check_coverage(case.path_m(), vehicle.reach_m, "the path")
        self.n_ticks = round(case.duration_s * rate_Hz)
        substeps = max(1, int(np.ceil(1.0 / rate_Hz / case.step_s - 1e-9)))
        self.log_every = max(1, round(rate_Hz / case.log_Hz))
        law, feeds_forward = find_law(case.control, "free"), case.feeds_forward
        numbers = law.numbers(case, rig.body)
        map_use = MapUse(
            case.map_strength if feeds_forward and not external else 0.0,
            -inf if external else case.compensation_from_s,
            float(case.whole_discs),
            float(external or (feeds_forward and case.map_strength > 0.0)),
        )
        self.layout, self.loops, geometry, shared = prepare_loop(
            vehicle, law, zero_record(numbers), 1.0 / rate_Hz / substeps
        )
        w, body = shared.copy(), at_rest(case.start_m, case.yaw_rad)
        for name, record in (("body", body), ("law", numbers), ("map_use", map_use)):
            w[self.layout.rows(name)] = flat_values(record)
        ring, is_delayed = command_ring(self.layout, w, substeps)
        rows = (self.n_ticks + self.log_every - 1) // self.log_every
        fields = [*LOGGED.values(), "below.coverage", "below.height_m", "below.factor"]
        fields.append("rotors.speed_rad_s")
        if external:  # fields of a built-in law are not logged
            fields = ["nothing" if "law_state" in field else field for field in fields]
        logged = self.layout.row_numbers(fields)
        gusts = np.array([[g.from_s, g.length_s, *g.wind_m_s] for g in case.gusts], float)
        noise = np.zeros((3, 1))
        if case.gyro_noise_rad_s:
            rng = np.random.default_rng(case.seed)
            noise = rng.normal(0.0, case.gyro_noise_rad_s, (self.n_ticks, 3)).T.copy()
        below = map_tables = case.below.tables(radius_m)
        if map_use.is_used and any(case.map_offset_m):
            map_tables = case.below.moved(*case.map_offset_m).tables(radius_m)
        driver = CALLER if external else BUILT_IN
        plan = LoopPlan(substeps, driver, is_delayed, self.log_every)
        arrays = FlightArrays(
            w=w,
            states=lane_states(case.seed, [0]),
            sent=np.zeros((rig.n_rotors, ring, 1)),
            log=np.empty((rows, len(logged), 1)),
            logged=logged,
            schedule=build_schedule(
                (Goal(x_m=case.start_m[0], y_m=case.start_m[1], z_m=case.start_m[2]), *case.goals),
                self.n_ticks, rate_Hz, case.ramp, float(case.yaw_rad),
                vehicle.hover_thrust_N * rig.n_rotors,
            ),
            noise=noise,
            gusts=gusts.reshape(-1, 5).T.copy(),
            scratch=np.zeros((len(DiscBelow._fields), rig.n_discs)),
            geometry=geometry,
            plan=np.array(plan, np.int64),
            below=below,
            map=map_tables,
        )  # fmt: skip
        self.use(arrays)
        self.ended = self.n_ticks
        self._wrench, self._factors = self.numbers("command"), self.view("command")[4:, 0]
        self._n_discs = rig.n_discs
        self._has_factors = False

    def measurements(self, times_s: Sequence[float]) -> Iterator[FlightMeasurement]:
        read, n = self.view("measured")[:, 0].tolist, -self._n_discs
        for time_s in times_s:
            numbers = read()
            heights_m, coverages = tuple(numbers[n + n : n]), tuple(numbers[n:])
            yield _new(FlightMeasurement, (time_s, *numbers[1 : n + n], heights_m, coverages))

    def references(self, first: int, last: int) -> Iterator[FlightReference]:
        rows = self.arrays.schedule[rows_in(TICK, "reference"), first:last].T.tolist()
        return map(_new, repeat(FlightReference), rows)

    def write_command(self, command: FlightCommand) -> None:
        wrench, factors = self._wrench, self._factors
        thrust, roll, pitch, yaw, *extra = command
        wrench[0], wrench[1], wrench[2], wrench[3] = thrust, roll, pitch, yaw
        if not isfinite(thrust + roll + pitch + yaw):
            raise ValueError
        if self._has_factors:  # else all are 1
            factors[:], self._has_factors = 1.0, False
        if extra and extra != [()]:
            (divide_by,) = extra
            factors[:], self._has_factors = divide_by, True
            if len(divide_by) != len(factors) or not all(0.0 < x < inf for x in divide_by):
                raise ValueError

    def invalid_field(self, command: Any) -> tuple[str, Any, str]:
        if not isinstance(command, tuple | list) or not 4 <= len(command) <= 5:
            return "a command", command, COMMAND_REMEDY
        for name, value in zip(FlightCommand._fields, command[:4], strict=False):
            if not isinstance(value, int | float | np.number) or not isfinite(value):
                return name, value, COMMAND_REMEDY
        remedy = f"{self._n_discs} finite factors above 0, one per disc, or ()"
        return "divide_by", command[4], remedy

    def flight(self, user_controller: str = "") -> Flight:
        """Return the flight so far; raise InputError if the start touches a surface."""
        case, rig = self.case, self.case.vehicle.rig
        rows = min(self.ended // self.log_every + 1, len(self.arrays.log))
        outcome, clamped_steps, nearest_m = self.view("outcome")[:, 0].tolist()
        if rows <= 1 and outcome == STRUCK:
            raise InputError(
                f"the vehicle touches a surface at its start {case.start_m} m; change the start"
            )
        ending: Ending = get_args(Ending)[int(outcome)]
        log, discs = self.arrays.log[:rows, :, 0], range(1, rig.n_discs + 1)
        names = (
            *LOGGED,
            *(f"coverage{i}" for i in discs),
            *(f"height{i}_m" for i in discs),
            *(f"factor{i}" for i in discs),
            *(f"speed{i}_rad_s" for i in range(1, rig.n_rotors + 1)),
        )
        return Flight(
            case, names, log, ending, case.duration_s if ending == "flown" else float(log[-1, 0]),
            int(clamped_steps), nearest_m, user_controller,
        )  # fmt: skip


@lru_cache(maxsize=64)
def prepare_loop(
    vehicle: FlightVehicle, law: ControlLaw, numbers: Any, dt_s: float
) -> tuple[Layout, FlightLoops, Array, Array]:
    """Return layout, loops, geometry, and the records that flights of a vehicle share (cached).

    Args:
        numbers: those of the law, with zeros.
        dt_s: length of a plant step.
    """
    rig, craft, geometry = vehicle.rig, vehicle.craft(), vehicle.geometry(dt_s)
    effects = loop_effects(vehicle.model, in_flight=True)
    discs, rotors = (0.0,) * rig.n_discs, (0.0,) * rig.n_rotors
    hover_rad_s = (vehicle.hover_thrust_N / craft.k_N_s2) ** 0.5
    records = {
        "body": FreeBody(),
        "rotors": Rotors((hover_rad_s,) * rig.n_rotors),
        "targets": Targets(rotors, rotors, rotors),
        "measured": FlightMeasurement._make([*[0.0] * 13, discs, discs]),
        "scheduled": FlightTick(),
        "command": FlightCommand(0.0, 0.0, 0.0, 0.0, (1.0,) * rig.n_discs),
        "law_state": law.state,
        "below": Below(discs, discs, discs, discs),
        "expected": Below(discs, discs, discs, discs),
        "ground": GroundTorque(),
        "outcome": FlightOutcome(),
        "craft": craft,
        "motion": build_motion(vehicle.model, dt_s),
        "law": numbers,
        "effects": loop_numbers(vehicle.model, effects),
        "nothing": float("nan"),
        "map_use": MapUse(),
    }
    layout, rotor_disc = record_layout(**records), tuple(rig.disc_of_rotor.tolist())
    loops = flight_loops(
        effects, layout, rotor_disc, zero_record(geometry), vehicle.model.image_rules, law.step
    )
    values = np.array(flat_values(tuple(records.values())), float)
    return layout, loops, np.array(flat_values(geometry), float), values


@lru_cache(maxsize=4)
def build_schedule(
    goals: tuple[Goal, ...], ticks: int, rate_Hz: float, ramp: bool, yaw_rad: float, hover_N: float
) -> Array:
    """Return the schedule of a flight, a `FlightTick` per control period (n_numbers, ticks).

    The first goal is the start. With a ramp the reference moves from goal to goal at the speed of
    the goal. `hover_N` is the total thrust in hover.
    """
    x, y, z, speed, start_s = (
        np.array([getattr(goal, name) for goal in goals], float)
        for name in ("x_m", "y_m", "z_m", "speed_m_s", "from_s")
    )
    start_s[0] = -1.0
    time_s = np.arange(ticks) * (1.0 / rate_Hz)
    current = np.zeros(ticks, int)
    for index in range(1, len(goals)):  # in order: a goal with a late start delays the next
        current[(current == index - 1) & (time_s >= start_s[index])] = index
    reference_x, reference_y = x[current], y[current]
    if ramp:
        previous = np.maximum(current - 1, 0)
        dx, dy = x[current] - x[previous], y[current] - y[previous]
        length = np.sqrt(dx * dx + dy * dy)
        progress = (
            speed[current] * (time_s - start_s[current]) / np.where(length > 0.0, length, 1.0)
        )
        share = np.where(length > 0.0, np.minimum(progress, 1.0), 1.0)
        reference_x, reference_y = x[previous] + share * dx, y[previous] + share * dy
    yaw, hover = np.full(ticks, yaw_rad), np.full(ticks, hover_N)
    values = (reference_x, reference_y, z[current], yaw, speed[current], hover)
    reference = FlightReference._make(values)
    tick = FlightTick(reference, x[current], y[current], z[current])
    return np.array(flat_values(tick), float)
