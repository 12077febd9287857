"""Flights: the notes' table, the planar model, other layouts, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchtool.physics.model_file import load_model
from benchtool.report.flight.flight import collect_warnings
from benchtool.simulate.flight.cases import FLIGHTS, flight_case
from benchtool.simulate.flight.flight import fly
from benchtool.simulate.flight.study import arrival_s, count_push_backs, fly_and_measure, measure
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import load_gains
from tests.unit.simulate.flight_table import TABLE, Row
from tests.unit.simulate.flying import PQUAD, Slice, case, flown


@pytest.mark.parametrize("row", TABLE, ids=Row.label)
def test_the_notes_table(row):
    found = measure(fly(row.case(PQUAD, load_gains("s3"))))
    assert row.departures(found) == []


@pytest.mark.parametrize(("lag_s", "rounding"), [(0.0, 1e-11), (0.05, 1e-5)])
def test_in_the_plane_it_is_the_planar_model(lag_s, rounding):
    """To rounding; lagging motors turn the body a little, which the planar model has not.

    The lag acts on speeds and the drag on their squares: while the speeds of the front and rear
    pair change, the squares do not add up, and the body yaws by microradians.
    """
    vehicle = PQUAD.with_numbers(lag_s=lag_s)
    flight = fly(
        flight_case("edge", vehicle, load_gains("s3"), speed_m_s=1.0, duration_s=12.0, log_Hz=250.0)
    )
    planar = Slice(goal_m=2.8, speed_m_s=1.0).fly(12.0, lag_s)
    ours = np.column_stack([flight[n] for n in ("time_s", "x_m", "z_m", "pitch_rad")])
    np.testing.assert_allclose(ours, planar, rtol=0.0, atol=rounding)
    assert np.abs(planar[:, 3]).max() > np.radians(8.0)  # it has been pushed back hard
    for name in ("y_m", "roll_rad", "yaw_rad"):
        np.testing.assert_allclose(flight[name], 0.0, atol=rounding)


def test_the_observer_finds_the_torque_that_is_there():
    flight = flown("plate", control="observer")
    late = (flight["time_s"] > 15.0) & (flight["time_s"] < 29.0)
    np.testing.assert_allclose(
        flight["pitch_estimate_Nm"][late], flight["pitch_ground_Nm"][late], atol=1e-3
    )
    assert flight["pitch_ground_Nm"][late].mean() < -0.008


@pytest.mark.parametrize("name", FLIGHTS)
def test_every_shipped_flight_flies(name):
    flight = flown(name, control="observer")
    assert flight.ending == "flown"
    assert np.isfinite(flight.log[:, :25]).all()
    touched = max(flight[f"coverage{i}"].max() for i in range(1, 5))
    assert touched > 0.2


def test_the_step_is_fine_enough():
    ends = [
        fly(case("edge", speed_m_s=1.0, duration_s=6.0, step_s=step))["x_m"][-1]
        for step in (0.002, 0.001, 0.0005)
    ]
    assert abs(ends[1] - ends[2]) < 0.3 * abs(ends[0] - ends[1])
    assert abs(ends[1] - ends[2]) < 1e-4


def test_a_vehicle_comes_from_a_model():
    """With what it states; what belongs to a bench does not act, and the warnings say so."""
    vehicle = FlightVehicle(model=load_model("quad_body_lift").model)
    assert (vehicle.number("K_b"), vehicle.number("neighbours")) == (2.0, 1.0)
    quad = load_model("quad").model
    assert FlightVehicle(model=quad).number("K_b") == 0.0
    hinged = FlightVehicle(model=quad.with_effect("coulomb_friction", torque_Nm=0.1))
    short = replace(case(duration_s=4.0), vehicle=FlightVehicle(model=quad))
    beside = replace(short, vehicle=hinged)
    np.testing.assert_array_equal(fly(beside).log, fly(short).log)
    said = collect_warnings([fly_and_measure(beside)] * 2)
    assert "coulomb_friction: effects of the model that do not act in flight; ignored" in said


def test_measures_of_simple_traces():
    time = np.arange(6.0)
    assert arrival_s(time, np.array([1.0, 0.01, 1.0, 0.01, 0.0, 0.0])) == 3.0
    assert np.isnan(arrival_s(time, np.ones(6)))
    x = np.array([0.0, 1.0, 0.9, 1.2, 1.18, 1.3, 1.0, 0.5])
    assert count_push_backs(x, 7.0) == 2
