"""What the page asks is what its command asks."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest

from benchtool.commands.app import main
from benchtool.core.errors import InputError
from benchtool.core.rig_file import rig_names
from benchtool.core.schedule_file import schedule_names
from benchtool.simulate.flight.cases import FLIGHTS
from benchtool.web.tabs.simulate.inputs import FlightAsk, PitchAsk, flight_sliders, pitch_sliders
from benchtool.web.tabs.simulate.work import Simulation, simulated, zipped

ASKS = [
    PitchAsk(
        rig="beam",
        gains="stiff",
        schedule="triangle",
        controllers=("pid", "observer+feedforward"),
        numbers={"gains.attitude": 1.2},
    ),
    PitchAsk(numbers={"plate.z_over_R": 1.25, "body_lift.K_b": 3.0}, duration_s=25.0, seed=4),
    FlightAsk(case="edge", controllers=("pid", "both"), z_over_R=1.5, speed_m_s=0.5),
    FlightAsk(case="plate", controllers=("pid",), numbers={"K_b": 0.5, "gains.position": 0.9}),
]


@pytest.mark.parametrize("ask", ASKS, ids=lambda ask: " ".join(ask.words))
def test_the_command_prints_the_numbers_that_the_page_shows(
    ask: Simulation, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main(ask.words)
    assert left.value.code == 0
    printed = capsys.readouterr().out.splitlines()
    lines = simulated(ask, quick=False)["lines"]
    assert printed[1 : 1 + len(lines)] == lines


def test_what_is_shown_is_plain_and_short() -> None:
    shown = simulated(PitchAsk(controllers=("pid",)), quick=True)
    motion = shown["lanes"][0]["motion"]
    assert motion["own"][0].dtype == np.float32
    assert len(motion["time_s"]) == len(motion["pitch_deg"]) <= 800
    assert shown["end_s"] == 40.0
    assert shown["panels"][0]["range"] == (-2.0, 1.0, 1.0)


def test_the_zip_holds_what_the_command_writes() -> None:
    names = zipfile.ZipFile(io.BytesIO(zipped(PitchAsk(controllers=("pid",))))).namelist()
    assert names == ["numbers.txt", "pid.csv", "pid.csv.json", "pitch.png", "pitch.svg"]


def test_nobody_at_the_controls_is_refused() -> None:
    for ask in (PitchAsk(controllers=()), FlightAsk(controllers=())):
        with pytest.raises(InputError, match="choose one or more"):
            ask.setup()


@pytest.mark.parametrize("schedule", schedule_names())
def test_sliders_of_the_pitch_bench_can_be_moved_to_both_ends(schedule: str) -> None:
    for rig in rig_names():
        if rig.endswith("_single"):
            continue
        for slider in pitch_sliders(rig, schedule):
            assert slider.low <= slider.start <= slider.high
            for value in (slider.low, slider.high):
                ask = PitchAsk(rig=rig, schedule=schedule, numbers={slider.name: value})
                assert ask.setup().schedule.name == schedule


def test_a_schedule_without_a_plate_or_with_several_distances_offers_no_distance() -> None:
    offered = {
        name: "plate.z_over_R" in [slider.name for slider in pitch_sliders("pquad", name)]
        for name in ("plate", "switch", "steps", "distances")
    }
    assert offered == {"plate": True, "switch": True, "steps": False, "distances": False}


@pytest.mark.parametrize("case", FLIGHTS)
def test_sliders_of_a_flight_can_be_moved_to_both_ends(case: str) -> None:
    for slider in flight_sliders(case):
        assert slider.low <= slider.start <= slider.high
        for value in (slider.low, slider.high):
            if slider.name in ("z_over_R", "speed_m_s"):
                ask = FlightAsk(case=case, **{slider.name: value})
            else:
                ask = FlightAsk(case=case, numbers={slider.name: value})
            assert ask.setup().case == case


def test_a_value_shows_as_many_digits_as_its_step() -> None:
    assert [slider.decimals for slider in flight_sliders("over")] == [2, 2, 1, 2, 2, 2]
