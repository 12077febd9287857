"""What the flight tests share: the notes' vehicle, its obstacle, and a planar model by hand."""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, cos, exp, pi, radians, sin, sqrt

import numpy as np

from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.expression import read_record
from benchtool.simulate.flight.cases import FlightCase, flight_case
from benchtool.simulate.flight.environment import Environment
from benchtool.simulate.flight.flight import Flight, FlightLoop, fly
from benchtool.simulate.flight.ground import Below
from benchtool.simulate.flight.vehicle import FlightVehicle, at_rest
from benchtool.simulate.gain_file import load_gains
from tests.unit.simulate.euler_lagrange import from_euler

PQUAD = FlightVehicle.of_rig(load_rig_by_name("pquad"))


def case(name: str = "over", gains: str = "s3", **numbers: object) -> FlightCase:
    return flight_case(name, PQUAD, load_gains(gains), **numbers)  # type: ignore[arg-type]


def flown(name: str = "over", gains: str = "s3", **numbers: object) -> Flight:
    return fly(case(name, gains, **numbers))


def look_below(
    vehicle: FlightVehicle, environment: Environment, place: tuple[float, float, float],
    time_s: float = 0.0, attitude: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Below:  # fmt: skip
    """Return what a flight finds below a vehicle at a place (m) in an attitude (rad)."""
    stands = FlightCase(
        name="", vehicle=vehicle, gains=load_gains("s3"), below=environment, start_m=place
    )
    loop = FlightLoop(stands)
    turned = dict(zip(("qw", "qx", "qy", "qz"), from_euler(*attitude), strict=True))
    body = at_rest(place)._replace(**turned)
    places, w, model = loop.layout.slots, loop.arrays.w, vehicle.model
    found: Below = loop.loops.look_below(
        time_s, attitude[1], body, read_record(w, places.craft, 0, 1), vehicle.geometry(0.001),
        (550.0,) * model.rig.n_discs, read_record(w, places.effects, 0, 1), loop.arrays.below, 0.0,
        loop.arrays.scratch,
    )[0]  # fmt: skip
    return found


def static_moments_Nm(vehicle: FlightVehicle, below: Environment, places: np.ndarray) -> np.ndarray:
    """Return roll and pitch moment (m, 2) of the ground effect on a level vehicle at hover thrust.

    Args:
        vehicle: what flies.
        below: what it is over.
        places: x, y, z of its centre (m, 3): m.
    """
    craft, disc_of = vehicle.craft(), vehicle.rig.disc_of_rotor
    moments = []
    for place in places:
        factor = np.array(look_below(vehicle, below, tuple(place)).factor)[disc_of]
        more = vehicle.hover_thrust_N * (factor - 1.0)
        moments.append((np.array(craft.y_m) @ more, -np.array(craft.x_m) @ more))
    return np.array(moments)


@dataclass
class Slice:
    """The notes' planar prototype: x, z and pitch of a plus quadrotor, written apart."""

    goal_m: float
    speed_m_s: float
    height_m: float = 0.24
    mass: float = 1.4
    inertia: float = 0.018
    arm: float = 0.225
    radius: float = 0.12

    def area(self, x: float) -> float:
        total = -1.0
        for inside in (x - 3.0, 5.0 - x):
            u = min(max(inside / self.radius, -1.0), 1.0)
            total += 1.0 + (u * sqrt((1.0 - u) * (1.0 + u)) - acos(u)) / pi
        return total

    def factors(self, x: float, z: float, theta: float) -> list[float]:
        arm, least = self.arm, 0.5 * self.radius
        places = [(arm, 0.0), (0.0, arm), (-arm, 0.0), (0.0, -arm)]
        at = [(x + a * cos(theta), b, max(z - a * sin(theta), least)) for a, b in places]
        areas = [self.area(place[0]) for place in at]
        weight = max(0.0, (sum(areas) - 1.0) / 3.0)

        def image(here: tuple[float, ...], there: tuple[float, ...]) -> float:
            ahead, aside, up = here[0] - there[0], here[1] - there[1], here[2] + there[2]
            along = ahead * sin(theta) + up * cos(theta)
            return 0.25 * self.radius**2 * along / (ahead**2 + aside**2 + up**2) ** 1.5

        centre = (x, 0.0, max(z, least))
        body = 2.0 * weight * sum(image(centre, each) for each in at)
        out = []
        for i in range(4):
            shares = [1.0 if j == i else areas[j] for j in range(4)]
            total = body + sum(a * image(at[i], p) for a, p in zip(shares, at, strict=True))
            out.append(1.0 + areas[i] * (1.0 / (1.0 - total) - 1.0))
        return out

    def fly(self, duration_s: float, lag_s: float = 0.0) -> np.ndarray:
        """Return rows of time, x, z, pitch at every control instant (250 Hz), steps of 1 ms."""
        x, z, theta, vx, vz, q = 0.0, self.height_m, 0.0, 0.0, 0.0, 0.0
        wanted = integral = climb = 0.0
        dt, rows = 0.001, []
        thrust = None
        k = 1.035e-5
        for period in range(round(duration_s * 250.0)):
            rows.append((period * 0.004, x, z, theta))
            ask = min(max(1.1 * (self.goal_m - x), -self.speed_m_s), self.speed_m_s)
            wanted += min(max(ask - wanted, -0.65 * 0.004), 0.65 * 0.004)
            integral = min(max(integral + 0.6 * (wanted - vx) * 0.004, -0.58), 0.58)
            tilt = (1.5 * (wanted - vx) + integral) / 9.81
            tilt = min(max(tilt, -radians(16.5)), radians(16.5))
            rate = min(max(2.9 * (tilt - theta), -3.5), 3.5)
            torque = self.inertia * 7.4 * (rate - q)
            climb += (self.height_m - z) * 0.004
            up = min(max(4.0 * (self.height_m - z) + climb - 3.2 * vz, -4.0), 4.0)
            total = self.mass * (9.81 + up) / cos(theta)
            asked = [total / 4.0 - torque / (2.0 * self.arm), total / 4.0]
            asked += [total / 4.0 + torque / (2.0 * self.arm), total / 4.0]
            command = [sqrt(max(t, 0.0) / k) for t in asked]
            if thrust is None:
                thrust = command
            keep = exp(-0.0005 / lag_s) if lag_s else 0.0
            for _ in range(4):
                x, z, theta = x + 0.0005 * vx, z + 0.0005 * vz, theta + 0.0005 * q
                thrust = [c + (t - c) * keep for t, c in zip(thrust, command, strict=True)]
                f = self.factors(x, z, theta)
                lifts = [k * w * w * g for w, g in zip(thrust, f, strict=True)]
                vx += dt * sum(lifts) * sin(theta) / self.mass
                vz += dt * (sum(lifts) * cos(theta) / self.mass - 9.81)
                q += dt * self.arm * (lifts[2] - lifts[0]) / self.inertia
                x, z, theta = x + 0.0005 * vx, z + 0.0005 * vz, theta + 0.0005 * q
                thrust = [c + (t - c) * keep for t, c in zip(thrust, command, strict=True)]
        return np.array(rows)
