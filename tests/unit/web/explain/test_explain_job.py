"""An explanation in its process: stages, the folder under its name, nothing overwritten."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from benchtool.core.errors import InputError
from benchtool.data.run.recording_file import write_recording
from benchtool.explain.inputs import ExplainInputs
from benchtool.report.flight.pitch_study import pitch_study
from benchtool.simulate.pitch.setup import changed, pitch_setup
from benchtool.web.tabs.explain.sources import command_words
from benchtool.web.tabs.explain.work import ExplainJob, explain
from tests.unit.commands.command_line import run

EXAMPLES = Path(__file__).parents[4] / "datasets"
MODEL = str(EXAMPLES / "pitch_bench/model.toml")
LONG_S = 150.0


def recorded(path: Path, duration_s: float, seed: int) -> str:
    """Write a recording of a bench whose hinge drags, which its model does not know."""
    setup = pitch_setup(model=MODEL, gains="stiff", controllers=("pid",), schedule="identify")
    setup = changed(setup, {"coulomb_friction.torque_Nm": 0.012})
    setup = replace(setup, schedule=setup.schedule.lasting(duration_s))
    run = pitch_study(setup, seed, with_away=False).runs[0]
    write_recording(path, run.recording(setup.bench.model.rig), {})
    return str(path)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> ExplainInputs:
    folder = tmp_path_factory.mktemp("recordings")
    learn = recorded(folder / "learn.csv", 10.0, seed=21)
    check = recorded(folder / "check.csv", 8.0, seed=22)
    return ExplainInputs(recordings=(learn,), check=(check,), model=MODEL)


@pytest.mark.slow
def test_an_effect_is_named_and_accepted_into_a_new_model(
    tmp_path: Path, inputs: ExplainInputs
) -> None:
    out = tmp_path / "runs" / "answer"
    words = command_words(inputs, out)
    job = ExplainJob(out, words, explain, inputs)
    state = job.wait(LONG_S)
    assert state.status == "done", state.error
    assert state.stages[0] == "reading the recordings"
    assert state.stages[-1] == "drawing the figures"
    found = state.result
    assert found is not None
    assert found.named == ("coulomb_friction",)
    assert found.sentence.startswith("The model lacks Coulomb friction")
    assert [part.title for part in found.parts][:4] == ["What now", "Where", "Which", "The gap"]
    assert "What is different in the new model" in found.parts[0].html
    assert "Not written yet" not in found.parts[0].html
    assert all("<img" in part.html for part in found.parts[1:4])
    assert not out.exists()

    job.accept(out)
    assert job.accepted == "pitch_bench_coulomb_friction"
    assert {"model.toml", "report.html", "answer.json", "gap.svg"} <= {
        file.name for file in out.iterdir()
    }
    assert f"benchtool simulate pitch --model {out / 'model.toml'}" in (
        out / "report.html"
    ).read_text("utf-8")
    model = tomllib.loads((out / "model.toml").read_text())
    assert model["effects"]["coulomb_friction"]["torque_Nm"]["value"] == pytest.approx(
        0.012, rel=0.15
    )
    by_command = tmp_path / "command"
    assert run(*command_words(inputs, by_command)) == 0
    assert (out / "model.toml").read_text() == (by_command / "model.toml").read_text()
    with pytest.raises(InputError, match="accepted already"):
        job.accept(out)


def test_an_explanation_that_failed_cannot_be_accepted(tmp_path: Path) -> None:
    out = tmp_path / "runs" / "answer"
    gone = (str(tmp_path / "gone.csv"),)
    bad = ExplainInputs(recordings=gone, check=(str(tmp_path / "check.csv"),), model="pitch_pquad")
    job = ExplainJob(out, command_words(bad, out), explain, bad)
    state = job.wait(LONG_S)
    assert state.status == "failed"
    assert "there is no such run or file" in state.error
    with pytest.raises(InputError, match="no answer to accept"):
        job.accept(out)
