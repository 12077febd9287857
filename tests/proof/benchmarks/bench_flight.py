"""Flights beside rotorpy, in times real time.

Ours: the PQUAD with six degrees of freedom, motor lag, observer or map feedforward, gyro noise,
plant at 1 kHz, control and logging at 250 Hz; over a box with exact areas, and over a height grid.
rotorpy: its Hummingbird under its own SE(3) controller over nothing (it has no map and no ground
effect): vehicle and controller alone, stepped at 100 Hz, its own default, and at our 250 Hz; and
its `Environment` as its users run it, at 250 Hz, with sensors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import cos
from typing import Any

import numpy as np

from benchtool.core.rig_file import load_rig_by_name
from benchtool.simulate.controllers.controller import (
    FlightCommand,
    FlightMeasurement,
    FlightReference,
)
from benchtool.simulate.flight.cases import FlightCase, flight_case
from benchtool.simulate.flight.environment import Environment, HeightGrid
from benchtool.simulate.flight.flight import fly, fly_user_controller
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import load_gains
from tests.proof.benchmarks.rows import Row, cpu_s, in_turns

FLIGHT_S, PEER_FLIGHT_S = 60.0, 2.0


def grid() -> Environment:
    """Return the paper's obstacle as a height grid of 2 cm cells."""
    x, y = np.arange(-1.0, 9.0, 0.02), np.arange(-1.0, 1.01, 0.02)
    rise = np.where((x[:, None] >= 3.0) & (x[:, None] <= 5.0), 0.0, np.nan) + 0.0 * y
    return Environment(grid=HeightGrid(x, y, rise))


def cases(duration_s: float) -> dict[str, FlightCase]:
    """Return the flights by name."""
    vehicle = FlightVehicle.of_rig(load_rig_by_name("pquad"), lag_s=0.02)
    base = flight_case(
        "over",
        vehicle,
        load_gains("s3"),
        duration_s=duration_s,
        gyro_noise_rad_s=0.015,
        log_Hz=250.0,
    )
    out = {
        f"{control} over a box": replace(base, control=control)
        for control in ("pid", "observer", "feedforward")
    }
    return out | {"observer over a grid": replace(base, control="observer", below=grid())}


def rotorpy_at(rate_Hz: float, whole: bool = False) -> Callable[[], None] | None:
    """Return one rotorpy flight of `PEER_FLIGHT_S`, or None where it is not installed."""
    try:
        from rotorpy.controllers.quadrotor_control import SE3Control
        from rotorpy.trajectories.hover_traj import HoverTraj
        from rotorpy.vehicles.hummingbird_params import quad_params
        from rotorpy.vehicles.multirotor import Multirotor
    except ImportError:
        return None
    if whole:
        from rotorpy.environments import Environment as Sandbox

        sandbox: Any = Sandbox(
            vehicle=Multirotor(quad_params),
            controller=SE3Control(quad_params),
            trajectory=HoverTraj(x0=np.array([1.0, 0.0, 0.0])),
            sim_rate=rate_Hz,
        )
        return lambda: sandbox.run(t_final=PEER_FLIGHT_S, plot=False)
    vehicle: Any = Multirotor(quad_params)
    controller: Any = SE3Control(quad_params)
    target: Any = HoverTraj(x0=np.array([1.0, 0.0, 0.0]))

    def run() -> None:
        state = {key: np.array(value, float) for key, value in vehicle.initial_state.items()}
        log = []
        for k in range(round(PEER_FLIGHT_S * rate_Hz)):
            at = k / rate_Hz
            command = controller.update(at, state, target.update(at))
            state = vehicle.step(state, command, 1.0 / rate_Hz)
            log.append(state["x"])
        assert np.isfinite(log[-1]).all()

    return run


class OwnCascade:
    """A cascade over position, velocity and attitude, as a user would write it."""

    def __init__(self) -> None:
        self.speed, self.climb = [0.0, 0.0], 0.0

    def step(self, seen: FlightMeasurement, want: FlightReference, dt_s: float) -> FlightCommand:
        """Return thrust and torques."""
        tilts = []
        for axis, (error, velocity) in enumerate(
            ((want.x_m - seen.x_m, seen.vx_m_s), (want.y_m - seen.y_m, seen.vy_m_s))
        ):
            ask = max(-want.speed_m_s, min(want.speed_m_s, 1.1 * error))
            slew = 0.65 * dt_s
            self.speed[axis] += max(-slew, min(slew, ask - self.speed[axis]))
            tilts.append(1.5 * (self.speed[axis] - velocity) / 9.81)
        self.climb += (want.z_m - seen.z_m) * dt_s
        up = 4.0 * (want.z_m - seen.z_m) + self.climb - 3.2 * seen.vz_m_s
        return FlightCommand(
            want.hover_N * (1.0 + up / 9.81) / (cos(seen.pitch_rad) * cos(seen.roll_rad)),
            0.13 * (2.9 * (-tilts[1] - seen.roll_rad) - seen.p_rad_s),
            0.13 * (2.9 * (tilts[0] - seen.pitch_rad) - seen.q_rad_s),
            0.06 * (1.5 * (want.yaw_rad - seen.yaw_rad) - seen.r_rad_s),
        )


def rows(quick: bool) -> Iterator[Row]:
    """Yield flights of every controller; the peer of each is bare rotorpy at 100 Hz."""
    duration_s = 2.0 if quick else FLIGHT_S
    flights = cases(duration_s)
    peers = {
        name: PEER_FLIGHT_S / cpu_s(run)
        for name, run in (
            ("rotorpy at 100 Hz", rotorpy_at(100.0)),
            ("rotorpy at 250 Hz", rotorpy_at(250.0)),
            ("rotorpy whole, 250 Hz", rotorpy_at(250.0, whole=True)),
        )
        if run is not None
    }
    peer_name, peer = next(iter(peers.items()), ("", None))
    own = next(iter(flights.values()))
    works: dict[str, Callable[[], object]] = {
        name: lambda flight=flight: fly(flight)  # type: ignore[misc]
        for name, flight in flights.items()
    }
    works["a Python class over a box"] = lambda: fly_user_controller(own, OwnCascade(), "own")
    times_s = in_turns(1 if quick else 3, *works.values())
    for name, used_s in zip(works, times_s, strict=True):
        wanted = 6000.0 if name.endswith("over a box") and "Python" not in name else None
        rate = duration_s / used_s
        yield Row(f"flight, {name}", rate, "times real time", peer, peer_name, wanted)
    for name, rate in list(peers.items())[1:]:
        yield Row(name, rate, "times real time")
    short = replace(own, duration_s=2.0)
    vehicle = load_rig_by_name("pquad")
    (used_s,) = in_turns(
        2 if quick else 50, lambda: fly(replace(short, vehicle=FlightVehicle.of_rig(vehicle)))
    )
    yield Row("flight of 2 s with a new vehicle", 2.0 / used_s, "times real time")
