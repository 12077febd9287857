"""From numbers by name to a flight: each name changes what it says and nothing else."""

from __future__ import annotations

import pytest

from benchtool.core.rig_file import load_rig_by_name
from benchtool.simulate.flight.cases import flight_case
from benchtool.simulate.flight.setup import FlightSetup
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import load_gains

VEHICLE = FlightVehicle.of_rig(load_rig_by_name("pquad"))
SETUP = FlightSetup(case="over", vehicle=VEHICLE, gains=load_gains("s3"))


def test_without_changes_it_is_the_shipped_flight():
    assert SETUP.build_case("observer", 4) == flight_case(
        "over", VEHICLE, load_gains("s3"), control="observer", seed=4
    )


def test_every_name_changes_its_number():
    case = SETUP.with_changes(
        {"z_over_R": 3.0, "speed": 0.5, "gyro_noise": 0.01, "map_strength": 0.5, "K_b": 1.5,
         "lag": 0.02, "map_offset_y_m": 0.1, "gains.attitude": 2.0, "gains.position.k_x_per_s": 0.9,
         "neighbours": 0.5, "drag": 0.1},
    ).build_case("pid")  # fmt: skip
    radius_m = VEHICLE.rig.propulsion.radius_m
    assert case.start_m[2] == case.goals[0].z_m == pytest.approx(3.0 * radius_m)
    assert case.goals[0].speed_m_s == 0.5
    assert case.duration_s == 60.0
    assert (case.gyro_noise_rad_s, case.map_strength) == (0.01, 0.5)
    assert case.map_offset_m == (0.0, 0.1, 0.0)
    numbers = {"K_b": 1.5, "lag_s": 0.02, "neighbours": 0.5, "drag_N_s_m": 0.1}
    assert {name: case.vehicle.number(name) for name in numbers} == numbers
    assert (case.vehicle.turned_deg, case.vehicle.inertia_scale) == (0.0, 1.0)
    assert case.gains.attitude.k_q_per_s == pytest.approx(14.8)
    assert case.gains.position.k_x_per_s == 0.9
