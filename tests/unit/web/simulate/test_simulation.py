"""Simulations of the page, compared with the files and texts of the command."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

import pytest

from benchtool.core.errors import WouldOverwrite
from benchtool.core.inputs import build_inputs
from benchtool.data.run.entry import build_entry
from benchtool.data.run.recording_file import read_recording
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.simulate.inputs import FlightInputs, PitchInputs
from benchtool.web.command_jobs import Simulation, command_arguments, simulate_to_folder
from benchtool.web.drawing import PageSection
from tests.unit.commands.command_line import run

BEAM: dict[str, Any] = {
    "rig": "beam",
    "gains": ("stiff",),
    "schedule": "triangle",
    "controllers": ("pid", "observer+feedforward"),
    "set": {"gains.attitude": 1.2},
}
HIDES: dict[str, Any] = {
    "controllers": ("pid",),
    "schedule": "steps",
    "seed": 4,
    "set": {"coulomb_friction.torque_Nm": 0.0145},
}
EDGE: dict[str, Any] = {
    "case": "edge", "controllers": ("pid", "both"), "z_over_r": 1.5, "speed_m_s": 0.5,
}  # fmt: skip
SIMULATIONS = [
    build_inputs(PitchInputs, BEAM),
    build_inputs(PitchInputs, HIDES),
    build_inputs(FlightInputs, EDGE),
]


def simulate(inputs: Simulation, out: Path) -> tuple[PageSection, str]:
    command = (*command_arguments(inputs), "--out", str(out))
    return simulate_to_folder(lambda stage, share: None, out, command, inputs)


@pytest.mark.parametrize(
    "inputs", SIMULATIONS, ids=lambda inputs: " ".join(command_arguments(inputs))
)
def test_the_command_prints_and_writes_what_the_page_does(inputs, tmp_path, capsys):
    section, recording = simulate(inputs, tmp_path / "saved")
    assert run(*command_arguments(inputs), "--out", tmp_path / "printed") == 0
    numbers = (tmp_path / "printed" / "numbers.txt").read_text("utf-8")
    assert numbers in capsys.readouterr().out
    head, table = numbers.rstrip().split("\n", 1)
    assert escape(head) in section.html
    assert escape(table) in section.html
    saved, printed = (sorted((tmp_path / name).iterdir()) for name in ("saved", "printed"))
    assert [path.name for path in saved] == [path.name for path in printed]
    for path, expected in zip(saved, printed, strict=True):
        assert path.suffix != ".csv" or path.read_bytes() == expected.read_bytes()
    if isinstance(inputs, PitchInputs):
        assert recording == "saved/pid.csv"
        assert read_recording(tmp_path / recording).simulated
        assert build_entry(RunsFolder(tmp_path), recording).kind == "recording"


def test_nothing_that_is_there_is_written_over(tmp_path):
    (tmp_path / "saved").mkdir()
    with pytest.raises(WouldOverwrite):
        simulate(build_inputs(PitchInputs, HIDES), tmp_path / "saved")
    assert not list((tmp_path / "saved").iterdir())
