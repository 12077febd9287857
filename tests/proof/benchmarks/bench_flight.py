"""Flights beside rotorpy, in times real time.

Ours: the PQUAD with six degrees of freedom, motor lag, observer or map feedforward, gyro noise,
plant at 1 kHz, control and logging at 250 Hz; over a box with exact areas, and over a height grid.
rotorpy: its Hummingbird under its own SE(3) controller over nothing (it has no map and no ground
effect), vehicle and controller alone, stepped at 100 Hz, its default.
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


def rotorpy_rate() -> float | None:
    """Return the speed of a rotorpy flight in times real time, or None where it is missing."""
    try:
        from rotorpy.controllers.quadrotor_control import SE3Control
        from rotorpy.trajectories.hover_traj import HoverTraj
        from rotorpy.vehicles.hummingbird_params import quad_params
        from rotorpy.vehicles.multirotor import Multirotor
    except ImportError:
        return None
    vehicle: Any = Multirotor(quad_params)
    controller: Any = SE3Control(quad_params)
    target: Any = HoverTraj(x0=np.array([1.0, 0.0, 0.0]))

    def run() -> None:
        state = {key: np.array(value, float) for key, value in vehicle.initial_state.items()}
        log = []
        for tick in range(200):
            time_s = 0.01 * tick
            command = controller.update(time_s, state, target.update(time_s))
            state = vehicle.step(state, command, 0.01)
            log.append(state["x"])
        assert np.isfinite(log[-1]).all()

    return 2.0 / cpu_s(run)


class OwnFlight:
    """A controller as a user would write it."""

    def step(self, seen: FlightMeasurement, want: FlightReference, dt_s: float) -> FlightCommand:
        """Return thrust and torques."""
        speed = min(want.speed_m_s, want.x_m - seen.x_m)
        pitch_rad = 0.15 * (speed - seen.vx_m_s)
        bank_rad = 0.1 * (seen.y_m - want.y_m) + 0.2 * seen.vy_m_s
        climb = 4.0 * (want.z_m - seen.z_m) - 3.2 * seen.vz_m_s
        return FlightCommand(
            want.hover_N * (1.0 + climb / 9.81) / cos(seen.pitch_rad),
            0.13 * (2.9 * (bank_rad - seen.roll_rad) - seen.p_rad_s),
            0.13 * (2.9 * (pitch_rad - seen.pitch_rad) - seen.q_rad_s),
            0.2 * (want.yaw_rad - seen.yaw_rad - seen.r_rad_s),
        )


def rows(quick: bool) -> Iterator[Row]:
    """Yield flights of every controller; and one of 2 s with a new vehicle."""
    duration_s = 2.0 if quick else 60.0
    flights = cases(duration_s)
    peer = rotorpy_rate()
    own = next(iter(flights.values()))
    works: dict[str, Callable[[], object]] = {
        name: lambda flight=flight: fly(flight)  # type: ignore[misc]
        for name, flight in flights.items()
    }
    works["a Python class over a box"] = lambda: fly_user_controller(own, OwnFlight(), "own")
    times_s = in_turns(1 if quick else 3, *works.values())
    for name, used_s in zip(works, times_s, strict=True):
        wanted = 6000.0 if name.endswith("over a box") and "Python" not in name else None
        rate = duration_s / used_s
        yield Row(f"flight, {name}", rate, "times real time", peer, "rotorpy", wanted)
    short = replace(own, duration_s=2.0)
    vehicle = load_rig_by_name("pquad")
    (used_s,) = in_turns(
        2 if quick else 50, lambda: fly(replace(short, vehicle=FlightVehicle.of_rig(vehicle)))
    )
    yield Row("flight of 2 s with a new vehicle", 2.0 / used_s, "times real time")
