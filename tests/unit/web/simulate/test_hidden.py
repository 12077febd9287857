"""What a simulated bench can hide, and the folder that is kept of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.commands.app import main
from benchtool.commands.simulate_pitch import PitchInputs, setup_of
from benchtool.core.errors import WouldOverwrite
from benchtool.core.inputs import make
from benchtool.data.run.entry import entry_of
from benchtool.data.run.recording_file import read_recording
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.web.tabs.simulate.sliders import hidden_slider, hideable
from benchtool.web.tabs.simulate.work import command_words, write_into

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
        assert setup_of(inputs, "s3").bench.model.parameters[slider.name].value == value


def test_what_is_kept_is_what_the_command_writes(tmp_path: Path) -> None:
    assert write_into(HIDES, tmp_path / "kept") == ["pid.csv"]
    with pytest.raises(SystemExit) as left:
        main([*command_words(HIDES), "--out", str(tmp_path / "told")])
    assert left.value.code == 0
    ours, told = (tmp_path / name for name in ("kept", "told"))
    assert [path.name for path in sorted(ours.iterdir())] == [
        path.name for path in sorted(told.iterdir())
    ]
    assert (ours / "pid.csv").read_bytes() == (told / "pid.csv").read_bytes()
    assert read_recording(ours / "pid.csv").simulated
    assert entry_of(RunsFolder(tmp_path), "kept/pid.csv").kind == "recording"


def test_nothing_that_is_there_is_written_over(tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    with pytest.raises(WouldOverwrite):
        write_into(HIDES, tmp_path / "kept")
    assert not list((tmp_path / "kept").iterdir())
