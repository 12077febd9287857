"""Campaigns of flights: each run is the flight as flown alone, and memory does not grow."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig_file import rig_named
from benchtool.data.run import campaign as store
from benchtool.data.run.campaign import write_campaign
from benchtool.simulate.campaign import Campaign
from benchtool.simulate.campaign_flight import OGE, flight_campaign
from benchtool.simulate.design import Design
from benchtool.simulate.flight.environment import Environment
from benchtool.simulate.flight.flight import fly
from benchtool.simulate.flight.measures import measure
from benchtool.simulate.flight.setup import FlightSetup, changed
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import gains_named

SETUP = FlightSetup(
    case="over",
    vehicle=FlightVehicle.of_rig(rig_named("pquad")),
    gains=gains_named("s3"),
    gyro_noise_rad_s=0.015,
)


def campaign(*controllers: str, setup: FlightSetup = SETUP) -> Campaign:
    return flight_campaign({"s3": setup}, controllers or ("pid",))


def test_every_row_is_the_flight_as_flown_alone() -> None:
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
    slow = changed(SETUP, {"speed_m_s": 0.2}).flown("pid", 6)
    for row, case in ((rows[5], slow), (rows[1], replace(slow, below=Environment()))):
        found = measure(fly(case))
        assert row["rms_pitch_deg"] == found.rms_pitch_deg
        assert row["max_x_m"] == found.max_x_m
        assert row["ending"] == found.ending
        assert row["arrives"] == float(found.arrives)
    assert [row["arrives"] for row in rows] == [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0]
    assert rows[4]["rms_pitch_deg"] != rows[5]["rms_pitch_deg"]


def test_seeds_that_would_all_be_alike_are_refused() -> None:
    calm = campaign(setup=replace(SETUP, gyro_noise_rad_s=0.0))
    with pytest.raises(InputError, match="the gyro has no noise"):
        calm.check(Design.read(["K_b=1:2:2"], seeds=2))
    calm.check(Design.read(["K_b=1:2:2"]))
    calm.check(Design.read(["gyro_noise_rad_s=0:0.02:2"], seeds=2))


def test_flights_too_short_to_arrive_are_refused() -> None:
    with pytest.raises(
        InputError, match=r"takes 140 s of a flight of 120 s.*give --duration-s 210"
    ):
        campaign().check(Design.read(["speed_m_s=0.05:0.5:4"]))
    longer = replace(SETUP, duration_s=210.0)
    campaign(setup=longer).check(Design.read(["speed_m_s=0.05:0.5:4"]))
    campaign(setup=replace(SETUP, case="plate")).check(Design.read(["speed_m_s=0.05:0.5:4"]))


@pytest.mark.parametrize(
    ("vary", "says"),
    [
        ("K_b=1:60:3", r"K_b is 60; give 0 to 50 \(at K_b = 60\)"),
        ("lag_s=0:0.004:5", r"too short for a step_s of 0.001.* \(at lag_s = 0.001\)"),
        ("gains.control_rate_Hz=0:250:2", "above 0"),
    ],
)
def test_a_point_that_cannot_be_flown_is_refused_before_the_first_flight(
    vary: str, says: str
) -> None:
    with pytest.raises(InputError, match=says):
        campaign().check(Design.read([vary]))


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(UnknownChoice, match=r"did you mean 'attitude'\? known: altitude"):
        campaign().check(Design.read(["gains.atitude=1:2:2"]))


def test_memory_of_flights_does_not_grow_with_their_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "ROWS_AT_ONCE", 32)
    short = replace(SETUP, case="plate", duration_s=1.0)
    one_log = fly(short.flown("pid")).log.nbytes

    def peak_of(count: int) -> int:
        design = Design.read(["K_b=1:2:2"], seeds=count // 2)
        tracemalloc.start()
        rows = campaign(setup=short).rows(design, threads=2)
        assert write_campaign(rows, tmp_path / f"{count}.parquet", {}) == count
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    peak_of(40)
    # A thousand flights more cost 0.7 kB each: free lists of the interpreter, no logs of 16 kB.
    assert peak_of(1200) - peak_of(200) < 60 * one_log < 1e6
