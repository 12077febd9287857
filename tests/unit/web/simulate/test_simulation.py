"""What the page simulates is what its command simulates; what a bench can hide; what is saved."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from benchtool.core.errors import WouldOverwrite
from benchtool.core.inputs import make
from benchtool.core.rig_file import rig_names
from benchtool.core.schedule_file import schedule_names
from benchtool.data.run.entry import entry_of
from benchtool.data.run.recording_file import read_recording
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.simulate.flight.cases import FLIGHTS
from benchtool.simulate.flight.inputs import FlightInputs
from benchtool.simulate.flight.inputs import setup_of as flight_setup_of
from benchtool.simulate.pitch.inputs import PitchInputs
from benchtool.simulate.pitch.inputs import setup_of as pitch_setup_of
from benchtool.web.tabs.simulate.sliders import (
    flight_sliders,
    hidden_slider,
    hideable,
    pitch_sliders,
)
from benchtool.web.tabs.simulate.work import (
    Simulation,
    command_words,
    simulated,
    write_into,
    zipped,
)
from tests.unit.commands.command_line import run

SIMULATIONS = [
    make(
        PitchInputs,
        {
            "rig": "beam",
            "gains": ("stiff",),
            "schedule": "triangle",
            "controllers": ("pid", "observer+feedforward"),
            "set": {"gains.attitude": 1.2},
        },
    ),
    make(
        PitchInputs,
        {"set": {"plate.z_over_R": 1.25, "body_lift.K_b": 3.0}, "duration_s": 25.0, "seed": 4},
    ),
    make(
        FlightInputs,
        {"case": "edge", "controllers": ("pid", "both"), "z_over_r": 1.5, "speed_m_s": 0.5},
    ),
    make(
        FlightInputs,
        {"case": "plate", "controllers": ("pid",), "set": {"K_b": 0.5, "gains.position": 0.9}},
    ),
]
PID = PitchInputs(controllers=("pid",))


@pytest.mark.parametrize("inputs", SIMULATIONS, ids=lambda inputs: " ".join(command_words(inputs)))
def test_the_command_prints_the_numbers_that_the_page_shows(
    inputs: Simulation, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*command_words(inputs)) == 0
    printed = capsys.readouterr().out.splitlines()
    lines = simulated(inputs, quick=False)["lines"]
    assert printed[1 : 1 + len(lines)] == lines


def test_what_is_shown_is_plain_and_short() -> None:
    shown = simulated(PID, quick=True)
    motion = shown["lanes"][0]["motion"]
    assert motion["own"][0].dtype == np.float32
    assert len(motion["time_s"]) == len(motion["pitch_deg"]) <= 800
    assert shown["end_s"] == 40.0
    assert shown["panels"][0]["range"] == (-2.0, 1.0, 1.0)


def test_the_zip_holds_what_the_command_writes() -> None:
    names = zipfile.ZipFile(io.BytesIO(zipped(PID))).namelist()
    assert names == ["numbers.txt", "pid.csv", "pid.csv.json", "pitch.png", "pitch.svg"]


@pytest.mark.parametrize("schedule", schedule_names())
def test_sliders_of_the_pitch_bench_can_be_moved_to_both_ends(schedule: str) -> None:
    for rig in rig_names():
        if rig.endswith("_single"):
            continue
        for slider in pitch_sliders(rig, schedule):
            assert slider.low <= slider.start <= slider.high
            for value in (slider.low, slider.high):
                given = {"rig": rig, "schedule": schedule, "set": {slider.name: value}}
                setup = pitch_setup_of(make(PitchInputs, given), "s3")
                assert setup.schedule.name == schedule


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
            own = {"z_over_R": "z_over_r", "speed_m_s": "speed_m_s"}.get(slider.name)
            given = {own: value} if own else {"set": {slider.name: value}}
            inputs = make(FlightInputs, {"case": case, **given})
            assert flight_setup_of(inputs, "s3").case == case


def test_a_value_shows_as_many_digits_as_its_step() -> None:
    assert [slider.decimals for slider in flight_sliders("over")] == [2, 2, 1, 2, 2, 2]


HIDES = make(
    PitchInputs,
    {
        "controllers": ("pid",),
        "schedule": "steps",
        "seed": 4,
        "set": {"coulomb_friction.torque_Nm": 0.0145},
    },
)


@pytest.mark.parametrize("rig", ["beam", "pquad", "amuse"])
@pytest.mark.parametrize("effect", hideable())
def test_every_effect_can_be_hidden_as_far_as_its_slider_goes(rig: str, effect: str) -> None:
    slider = hidden_slider(rig, effect)
    assert slider.first is not None
    assert abs(slider.first - slider.start) > 5.0 * slider.step
    assert 10 <= (slider.high - slider.low) / slider.step <= 200
    for value in (slider.low, slider.first, slider.high):
        assert slider.low <= value <= slider.high
        inputs = make(PitchInputs, {"rig": rig, "set": {slider.name: value}})
        assert pitch_setup_of(inputs, "s3").bench.model.parameters[slider.name].value == value


def test_what_is_saved_is_what_the_command_writes(tmp_path: Path) -> None:
    assert write_into(HIDES, tmp_path / "saved") == ["pid.csv"]
    assert run(*command_words(HIDES), "--out", tmp_path / "printed") == 0
    ours, printed = (tmp_path / name for name in ("saved", "printed"))
    assert [path.name for path in sorted(ours.iterdir())] == [
        path.name for path in sorted(printed.iterdir())
    ]
    assert (ours / "pid.csv").read_bytes() == (printed / "pid.csv").read_bytes()
    assert read_recording(ours / "pid.csv").simulated
    assert entry_of(RunsFolder(tmp_path), "saved/pid.csv").kind == "recording"


def test_nothing_that_is_there_is_written_over(tmp_path: Path) -> None:
    (tmp_path / "saved").mkdir()
    with pytest.raises(WouldOverwrite):
        write_into(HIDES, tmp_path / "saved")
    assert not list((tmp_path / "saved").iterdir())
