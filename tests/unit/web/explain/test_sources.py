"""Choices of the Explain tab, rejected paths, and the equivalent command."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.run.recording_file import write_recording
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.web.choices import EXAMPLE_PREFIX, RecordingSources
from benchtool.web.command_jobs import command_arguments
from benchtool.web.tabs.explain import explain_inputs, suggested_folder

EXAMPLES = Path(__file__).parents[4] / "datasets"


@pytest.fixture
def sources(tmp_path):
    runs = tmp_path / "runs"
    mine = runs / "mine"
    mine.mkdir(parents=True)
    for name in ("learn.parquet", "learn.parquet.json"):
        shutil.copy(EXAMPLES / "pitch_friction" / name, mine / name)
    shutil.copy(EXAMPLES / "pitch_bench" / "model.toml", mine / "bench.toml")
    (runs / "plan.toml").write_text("[grid]\nz_over_R = [1.0]\n")
    (runs / "broken.toml").write_text("[model\n")
    (runs / "table.csv").write_text("time_s,theta_rad\n0,0\n1,0.1\n")
    return RecordingSources(RunsFolder(runs), RunsFolder(EXAMPLES))


def test_recordings_of_the_runs_folder_come_before_the_examples(sources):
    recordings, _ = sources.read_choices()
    assert set(list(recordings)[:2]) == {"mine/learn.parquet", "table.csv"}
    assert f"{EXAMPLE_PREFIX}pitch_friction/check.parquet" in recordings
    assert f"{EXAMPLE_PREFIX}quad/run" in recordings
    assert "7,500 rows" in recordings["mine/learn.parquet"]


@pytest.mark.parametrize(
    ("recording", "model"),
    [
        (f"{EXAMPLE_PREFIX}quad/run", "quad_bench"),
        (f"{EXAMPLE_PREFIX}single_rotor/run", "single_bench"),
        ("hinge.csv", "pitch_pquad"),
        ("mine/learn.parquet", ""),  # contains no rig
        ("table.csv", ""),
        ("lab.csv", "single"),
    ],
)
def test_a_recording_proposes_the_model_of_its_bench(sources, recording, model):
    (sources.runs.root / "lab.csv").write_text("plate_z_m,thrust_N\n0.1,4\n")
    hinge = Recording.from_columns([(Channel("theta_rad", "rad"), np.zeros(2))])
    facts = {"rig": json.loads(json.dumps(asdict(load_rig_by_name("pquad"))))}
    write_recording(sources.runs.root / "hinge.csv", hinge, facts)
    assert sources.suggest_model(recording) == model


@pytest.mark.parametrize(
    "choice",
    ["../secret.csv", "/etc/passwd", f"{EXAMPLE_PREFIX}../pyproject.toml", "a\\b", ".hidden"],
)
def test_a_choice_that_leads_elsewhere_is_refused(sources, choice):
    with pytest.raises(InputError, match="is outside the runs folder"):
        sources.find_path(choice)
    with pytest.raises(InputError, match="is outside the runs folder"):
        sources.find_model(choice)


def test_the_command_names_everything(sources):
    chosen = (
        ["mine/learn.parquet"],
        [f"{EXAMPLE_PREFIX}pitch_friction/check.parquet"],
        "pitch_pquad",
    )
    out = suggested_folder(sources, ["mine/learn.parquet"], "2024-05-06")
    inputs = explain_inputs(sources, *chosen, "pquad", out)
    with pytest.raises(InputError, match="does not say which rig it was measured on"):
        explain_inputs(sources, *chosen)
    with pytest.raises(InputError, match=r"unknown rig 'mine\.toml'"):
        explain_inputs(sources, *chosen, "mine.toml")
    assert out == sources.runs.root / "2024-05-06-explain-learn"
    assert command_arguments(inputs) == [
        "explain", str(sources.runs.root / "mine/learn.parquet"), "--model", "pitch_pquad",
        "--rig", "pquad", "--check", str(EXAMPLES / "pitch_friction/check.parquet"),
        "--out", str(out),
    ]  # fmt: skip
