"""Fly a vehicle over an environment: one case in, one flight out."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Literal, get_args

import numpy as np

from benchtool.core.array import Array
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.simulate.controllers.cascade import PositionLoop
from benchtool.simulate.controllers.pid import AttitudePid
from benchtool.simulate.environment import Environment
from benchtool.simulate.flight.ground import FACTOR, NEAREST, look_down, new_ground
from benchtool.simulate.flight.kernel import (
    ENDING,
    HELD_TICKS,
    LAST,
    LOG_EVERY,
    LOGGED,
    LOST,
    N_PLAN,
    ROWS,
    STRUCK,
    TICKS,
    fly_loop,
)
from benchtool.simulate.flight.law import AT_X, AT_Y, DISC, N_MEMORY, N_SEEN, Law
from benchtool.simulate.flight.rigid_body import at_rest
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import Gains

FlightControl = Literal["pid", "observer", "feedforward", "both"]
Ending = Literal["flown", "struck", "lost"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """Ask for a place (x, y, z in m) from a time on, at a speed."""

    x_m: float
    y_m: float = 0.0
    z_m: float = 0.0
    speed_m_s: float = 0.2
    from_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Gust:
    """Blow with a 1 - cos shape: peak velocity (m/s) along x, y, z from a time on."""

    from_s: float
    length_s: float
    wind_m_s: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightCase:
    """Describe one flight.

    Attributes:
        name, title: for files and people.
        vehicle: what flies.
        below: what it flies over.
        gains: of every loop.
        control: PID alone, with observer, with feedforward, or with both.
        start_m: x, y, z where it hovers at first.
        goals: where to go.
        duration_s: how long.
        yaw_rad: heading.
        gyro_noise_rad_s: standard deviation, white, per control sample.
        seed: of the noise.
        map_offset_m: the feedforward's map is displaced by this along x, y, z; an edge that the
            map has 5 cm early is -0.05 along x.
        map_strength: share of the effect that the map's model knows.
        whole_discs: the map knows only whether a rotor's centre is over something.
        ramp: lead the reference along in place of limiting the speed.
        compensation_from_s: when observer and feedforward are switched on.
        gusts: wind; without drag of the vehicle they do nothing.
        step_s: longest step of the plant.
        log_Hz: rows of the log per second.
    """

    name: str
    vehicle: FlightVehicle
    gains: Gains
    below: Environment = field(default_factory=Environment)
    title: str = ""
    control: FlightControl = "pid"
    start_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    goals: tuple[Goal, ...] = ()
    duration_s: float = 60.0
    yaw_rad: float = 0.0
    gyro_noise_rad_s: float = 0.0
    seed: int = 1
    map_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    map_strength: float = 1.0
    whole_discs: bool = False
    ramp: bool = False
    compensation_from_s: float = 0.0
    gusts: tuple[Gust, ...] = ()
    step_s: float = 0.001
    log_Hz: float = 50.0

    def __post_init__(self) -> None:
        if self.control not in get_args(FlightControl):
            raise UnknownChoice("flight control", self.control, get_args(FlightControl))
        period = 1.0 / self.gains.control_rate_Hz
        numbers = {
            "duration_s": (self.duration_s, period, 1e5),
            "step_s": (self.step_s, 1e-6, period),
            "gyro_noise_rad_s": (self.gyro_noise_rad_s, 0.0, 10.0),
            "map_strength": (self.map_strength, 0.0, 10.0),
            "log_Hz": (self.log_Hz, 1e-3, self.gains.control_rate_Hz),
            "yaw_rad": (self.yaw_rad, -7.0, 7.0),
        }
        for goal in self.goals:
            numbers["goal speed_m_s"] = (goal.speed_m_s, 1e-3, 50.0)
        for name, (value, low, high) in numbers.items():
            if not low <= value <= high:
                raise InputError(f"{name} is {value:g}; give {low:g} to {high:g}")
        places = [*self.start_m, *self.map_offset_m]
        places += [value for goal in self.goals for value in (goal.x_m, goal.y_m, goal.z_m)]
        if not all(map(isfinite, places)):
            raise InputError(f"start, goals and map offset must be finite, got {places}")
        if 0.0 < self.vehicle.lag_s < 2.0 * self.step_s:
            raise InputError(
                f"step_s is {self.step_s:g}, too large for a motor lag of "
                f"{self.vehicle.lag_s:g} s; "
                f"give at most {self.vehicle.lag_s / 2.0:g}"
            )

    def path_m(self) -> Array:
        """Return start and goals in plan (m, 2): m."""
        return np.array([self.start_m[:2], *((goal.x_m, goal.y_m) for goal in self.goals)])

    def chart(self) -> Environment:
        """Return the map that the feedforward has."""
        if not any(self.map_offset_m):
            return self.below
        return self.below.moved(*self.map_offset_m)


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """Hold what a flight gave.

    Attributes:
        case: what was flown.
        names: of the columns.
        log: (rows, columns).
        ending: "flown" to the end, "struck" something, or "lost" (numbers no longer finite).
        end_s: when it ended.
        held_ticks: plant ticks at which a height was held at the formulae's limit of validity.
        nearest_m: least height of a rotor over what it covered; infinite over nothing.
        own: name of the user's own controller; "" for that of the case.
    """

    case: FlightCase
    names: tuple[str, ...]
    log: Array
    ending: Ending
    end_s: float
    held_ticks: int
    nearest_m: float
    own: str = ""

    def __getitem__(self, name: str) -> Array:
        """Return one column (rows,)."""
        if name not in self.names:
            raise UnknownChoice("column of a flight", name, self.names)
        return self.log[:, self.names.index(name)]


def fly(case: FlightCase) -> Flight:
    """Fly a case.

    Raises:
        InputError: the map does not cover the path, or the start touches something.
    """
    loop = FlightLoop(case)
    loop.run()
    return loop.flight()


class FlightLoop:
    """Hold everything the compiled loop needs for one flight.

    Args:
        case: what is flown.
        charted: the map of the case is read whether or not its own controller does.
    """

    def __init__(self, case: FlightCase, charted: bool = False) -> None:
        vehicle, gains = case.vehicle, case.gains
        self.case, self.discs = case, vehicle.discs()
        self.frame, self.known = vehicle.airframe(), vehicle.airframe(as_known=True)
        radius = self.discs.radius_m
        case.below.refuse_uncovered(case.path_m(), vehicle.reach_m, "the path")
        self.below = case.below.tables(radius)
        self.law = law_of(case)
        read = charted or self.law.feedforward > 0.0
        self.chart = case.chart().tables(radius) if read else self.below
        self.n_periods = round(case.duration_s * gains.control_rate_Hz)
        every = max(1, round(gains.control_rate_Hz / case.log_Hz))
        self.plan = np.zeros(N_PLAN, np.int64)
        self.plan[LAST] = self.n_periods
        self.plan[TICKS] = max(1, int(np.ceil(self.law.period_s / case.step_s - 1e-9)))
        self.plan[LOG_EVERY] = every
        n, n_discs = vehicle.rig.n_rotors, vehicle.rig.n_discs
        self.state = np.concatenate([at_rest(case.start_m, case.yaw_rad), np.zeros(n)])
        self.ground, self.guess = new_ground(n_discs), new_ground(n_discs)
        self.memory, self.seen, self.speeds = np.zeros(N_MEMORY), np.zeros(N_SEEN), np.zeros(n)
        rows = (self.n_periods + every - 1) // every
        self.log = np.zeros((rows, len(LOGGED) + 3 * n_discs + n))
        first = Goal(x_m=case.start_m[0], y_m=case.start_m[1], z_m=case.start_m[2])
        self.goals = np.array(
            [[g.from_s, g.x_m, g.y_m, g.z_m, g.speed_m_s] for g in (first, *case.goals)], float
        )
        self.goals[0, 0] = -1.0
        gusts = np.array([[g.from_s, g.length_s, *g.wind_m_s] for g in case.gusts], float)
        self.gusts = gusts.reshape(-1, 5)
        self.noise = np.zeros((1, 3))
        if case.gyro_noise_rad_s:
            rng = np.random.default_rng(case.seed)
            self.noise = rng.normal(0.0, case.gyro_noise_rad_s, (self.n_periods, 3))

    def run(self) -> None:
        """Fly with the controller of the case."""
        fly_loop(
            self.state, self.law, self.frame, self.known, self.discs, self.below, self.chart,
            self.goals, float(self.case.yaw_rad), self.gusts, self.noise, self.plan, self.log,
            self.ground, self.guess, self.memory, self.speeds, self.seen,
        )  # fmt: skip

    def flight(self, own: str = "") -> Flight:
        """Return what has been flown; `own` names the user's controller.

        Raises:
            InputError: the start touches something.
        """
        case, rows, ending = self.case, int(self.plan[ROWS]), self.plan[ENDING]
        if rows <= 1 and ending == STRUCK:
            raise InputError(
                f"the vehicle touches something where it starts, at {case.start_m} m; "
                f"start elsewhere"
            )
        word: Ending = "struck" if ending == STRUCK else "lost" if ending == LOST else "flown"
        kept = self.log[:rows]
        end_s = case.duration_s if word == "flown" else float(kept[-1, 0])
        rig = case.vehicle.rig
        names = column_names(rig.n_discs, rig.n_rotors)
        held, nearest_m = int(self.plan[HELD_TICKS]), float(self.ground[NEAREST].min())
        return Flight(case, names, kept, word, end_s, held, nearest_m, own)


def column_names(n_discs: int, n_rotors: int) -> tuple[str, ...]:
    """Return the columns of a flight's log."""
    return (
        *LOGGED,
        *(f"coverage{i + 1}" for i in range(n_discs)),
        *(f"height{i + 1}_m" for i in range(n_discs)),
        *(f"factor{i + 1}" for i in range(n_discs)),
        *(f"speed{i + 1}_rad_s" for i in range(n_rotors)),
    )


def law_of(case: FlightCase) -> Law:
    """Return the controller of a case as the loop's numbers."""
    gains, body = case.gains, case.vehicle.rig.body
    a, y, p = gains.attitude, gains.yaw, gains.position

    def tilt(inertia_kgm2: float) -> AttitudePid:
        return AttitudePid(
            a.k_theta_per_s,
            a.k_i_theta_per_s2,
            a.theta_integral_limit_rad_s,
            a.rate_limit_rad_s,
            a.k_q_per_s,
            a.k_i_q_per_s2,
            a.q_integral_limit_rad_s2,
            inertia_kgm2,
            inf,
        )

    heading = AttitudePid(
        y.k_psi_per_s, 0.0, 1.0, a.rate_limit_rad_s, y.k_r_per_s, 0.0, 1.0,
        body.inertia_zz_kgm2, inf,
    )  # fmt: skip
    return Law(
        PositionLoop(
            p.k_x_per_s,
            p.k_v_per_s,
            p.k_iv_per_s2,
            p.integral_limit_m_s2,
            p.slew_limit_m_s2,
            p.pitch_limit_rad,
        ),
        tilt(body.inertia_xx_kgm2),
        tilt(body.inertia_yy_kgm2),
        heading,
        gains.altitude.k_z_per_s2,
        gains.altitude.k_vz_per_s,
        gains.altitude.k_iz_per_s3,
        gains.altitude.limit_m_s2,
        gains.observer.rate_per_s,
        1.0 if case.control in ("observer", "both") else 0.0,
        case.map_strength if case.control in ("feedforward", "both") else 0.0,
        case.whole_discs,
        case.compensation_from_s,
        1.0 if case.ramp else 0.0,
        1.0 / gains.control_rate_Hz,
    )


def static_moment_Nm(vehicle: FlightVehicle, below: Environment, places_m: Array) -> Array:
    """Return roll and pitch moment (m, 2) of the ground effect on a level vehicle at hover thrust.

    Args:
        vehicle: what flies.
        below: what it is over.
        places_m: x, y, z of its centre (m, 3).
    """
    discs, tables = vehicle.discs(), below.tables(vehicle.rig.propulsion.radius_m)
    frame = vehicle.airframe()
    ground = new_ground(vehicle.rig.n_discs)
    moments = np.empty((len(places_m), 2))
    for row, place in enumerate(places_m):
        look_down(0.0, at_rest(tuple(place)), discs, tables, ground, False)
        factor = ground[FACTOR, frame.rotors[:, DISC].astype(int)]
        more = vehicle.hover_thrust_N * (factor - 1.0)
        moments[row] = frame.rotors[:, AT_Y] @ more, -frame.rotors[:, AT_X] @ more
    return moments
