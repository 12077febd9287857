"""Campaigns of flights: each run is the flight as flown alone, and memory does not grow."""

from __future__ import annotations

from dataclasses import replace

import pandas as pd
import pytest

from benchtool.core.errors import InputError
from benchtool.core.rig_file import load_rig_by_name
from benchtool.simulate.campaign import Campaign, Design, VariedParameter
from benchtool.simulate.flight.environment import Environment
from benchtool.simulate.flight.flight import fly
from benchtool.simulate.flight.setup import OGE, FlightSetup
from benchtool.simulate.flight.study import measure
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import load_gains

SETUP = FlightSetup(
    case="over",
    vehicle=FlightVehicle.of_rig(load_rig_by_name("pquad")),
    gains=load_gains("s3"),
    gyro_noise_rad_s=0.015,
)


def campaign(*controllers: str, setup: FlightSetup = SETUP) -> Campaign:
    return Campaign({"s3": setup}, controllers or ("pid",))


def test_every_row_is_the_flight_as_flown_alone():
    design = Design.read(["speed_m_s=0.2:0.5:2"], seeds=2, seed=5)
    rows = list(campaign(OGE, "pid").rows(design, threads=2))
    assert [(row["controller"], row["speed_m_s"], row["seed"]) for row in rows] == [
        (controller, speed, seed)
        for controller in (OGE, "pid")
        for speed in (0.2, 0.5)
        for seed in (5.0, 6.0)
    ]
    again = list(campaign(OGE, "pid").rows(design, threads=1))
    pd.testing.assert_frame_equal(pd.DataFrame(again), pd.DataFrame(rows))
    slow = SETUP.with_changes({"speed_m_s": 0.2}).build_case("pid", 6)
    for row, case in ((rows[5], slow), (rows[1], replace(slow, below=Environment()))):
        found = measure(fly(case))
        assert row["rms_pitch_deg"] == found.rms_pitch_deg
        assert row["max_x_m"] == found.max_x_m
        assert row["ending"] == found.ending
        assert row["arrives"] == float(found.arrives)
    assert [row["arrives"] for row in rows] == [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0]
    assert rows[4]["rms_pitch_deg"] != rows[5]["rms_pitch_deg"]


K_B, ATTITUDE = "K_b=1.5:2.5:3", "gains.attitude=0.8:1.2:2"


def test_a_grid_and_random_points():
    grid = Design.read([K_B, ATTITUDE])
    points = list(grid.points())
    assert len(points) == grid.n_points == 6
    assert points[1] == {"K_b": 1.5, "gains.attitude": 1.2}
    chance = Design.read([K_B, ATTITUDE], samples=50, seed=1)
    random = list(chance.points())
    assert len(random) == chance.n_points == 50
    assert random == list(chance.points())
    assert random != list(Design.read([K_B, ATTITUDE], samples=50, seed=2).points())
    assert all(1.5 <= point["K_b"] <= 2.5 for point in random)


@pytest.mark.parametrize(
    "text", ["K_b", "K_b=1:2", "K_b=1:2:0", "K_b=1:2:-3", "K_b=a:2:3", "=1:2:3", "K=1:nan:3"]
)
def test_text_that_is_no_range_is_refused(text):
    with pytest.raises(InputError, match="write NAME=FROM:TO:COUNT"):
        VariedParameter.read(text)
