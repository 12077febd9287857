"""Command `benchtool explain`: output, files and errors."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import pytest

from benchtool.commands.explain import expand_repeated
from benchtool.data.run.recording_file import read_recording, write_recording
from benchtool.physics.model_file import load_model
from tests.system.served import COMMAND
from tests.unit.commands import command_line
from tests.unit.explain.hand_made import MODEL
from tests.unit.physics.test_own_effects import GOOD

PAIR = MODEL.parents[1] / "pitch_friction"
LEARN, CHECK = str(PAIR / "learn.parquet"), str(PAIR / "check.parquet")


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    return command_line.said(capsys, "explain", *arguments)


def shortened(folder: Path, name: str, seconds: float) -> str:
    """Write the beginning of the training recording."""
    whole = read_recording(LEARN)
    part = whole.select(whole.column("time_s") < seconds)
    write_recording(folder / name, part, {})
    return str(folder / name)


@pytest.mark.slow
def test_hidden_friction_is_identified_and_all_files_are_written(capsys, tmp_path):
    out, answer = tmp_path / "out", tmp_path / "answer.json"
    arguments = (LEARN, "--model", str(MODEL), "--check", CHECK, "--draws", "30")
    code, output, _ = run(capsys, *arguments, "--out", str(out), "--json", str(answer))
    assert code == 0
    lines = output.splitlines()
    assert lines[0].startswith("SIMULATED DATA")
    assert lines[1].startswith("The model lacks Coulomb friction")
    data = json.loads(answer.read_text("utf-8"))
    assert data["verdict"] == "effect"
    torque = data["effects"][0]["parameters"]["torque_Nm"]
    assert torque["value"] == pytest.approx(0.012, abs=0.001)
    gap = data["gap"]["theta_rad"]
    assert gap["after"] < 0.7 * gap["before"]
    assert data["model_out"] == str(out / "model.toml")
    new = load_model(data["model_out"]).model
    assert new.parameters["coulomb_friction.torque_Nm"].value == torque["value"]
    assert new.parameters["inertia_kgm2"].value == pytest.approx(0.0306, rel=0.02)
    assert set(data["data"]["learn"].values()) <= set(new.provenance.values())
    code, _, error = run(capsys, *arguments, "--out", str(out))
    assert code == 2
    assert f"{out} exists already" in error


@pytest.mark.slow  # a new law is compiled
@pytest.mark.timeout(600)
def test_a_user_effect_is_a_candidate(capsys, tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(GOOD, encoding="utf-8")
    code, _, _ = run(
        capsys, shortened(tmp_path, "a.csv", 12.0), "--model", str(MODEL), "--check", CHECK,
        "--effects", str(file), "--draws", "20", "--json", str(tmp_path / "answer.json"),
    )  # fmt: skip
    assert code == 0
    data = json.loads((tmp_path / "answer.json").read_text("utf-8"))
    assert data["tolerances"]["cubic_damping.c_Nms3"] == 0.002
    assert "cubic_damping" in data["probabilities"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("a.csv", "--check", "b.csv"), "no model; use --model"),
        (("short.csv", "--model", str(MODEL), "--check", CHECK), "too short: 2.0 s"),
        ((LEARN, "--model", str(MODEL), "--check", CHECK, "--effects", "no.py"), "no such file"),
        (("--check", "b.csv", "a.csv"), "(all arguments after --check are validation recordings)"),
        ((LEARN, "no.csv", "--model", "bad.csv"), "3 problems: (1) no.csv: "),
        ((LEARN, "--model", "word.txt", "--check", CHECK), "word.txt: this looks like plain text"),
        ((LEARN, "--model", "pitch_beam", "--check", CHECK), "name it with --rig"),
        (
            (LEARN, "--model", "pitch_pquad", "--rig", "pquad", "--check", CHECK),
            "2 rotors, and the model 4 (rig 'pquad')",
        ),
    ],
)
def test_invalid_input_gives_one_error_line(capsys, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    shortened(tmp_path, "short.csv", 2.0)
    for name, text in (
        ("bad.csv", "t,theta\n0,1\n"),
        ("word.txt", "hello\n"),
    ):
        (tmp_path / name).write_text(text, "utf-8")
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert message in err
    assert len(err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("text", "expanded"),
    [
        ("a b --check c d --model m", "a b --check c --check d --model m"),
        ("a --check=c d --out o", "a --check=c --check d --out o"),
        ("a --model m b", "a --model m b"),
    ],
)
def test_check_takes_all_following_arguments(text, expanded):
    assert expand_repeated(text.split()) == expanded.split()


@pytest.mark.slow
def test_a_recording_of_another_simulator_is_explained(capsys, tmp_path, reference_data):
    folder = reference_data / "pitch_bench"
    code, output, _ = run(
        capsys, str(folder / "body_lift.csv"), "--model", str(MODEL),
        "--check", str(folder / "body_lift_check.csv"), "--out", str(tmp_path / "out"),
        "--draws", "30",
    )  # fmt: skip
    assert code == 0
    # Other differences of the simulators are 1.7 noise floors. A second effect, viscous friction,
    # has log odds of 0.00 to -0.04: the rounding of the processor decides whether it is named.
    lift = r"body lift \(fountain\): body_lift\.K_b = 0\.51"
    both = f"The model lacks {lift}.* and probably lacks viscous friction: "
    assert re.match(f"The missing effect is mostly similar to {lift}|{both}", output)
    assert "between rotor speed and thrust" in output
    assert (tmp_path / "out" / "report.html").is_file()


@pytest.mark.slow
def test_a_closed_pipe_loses_no_file(tmp_path):
    """As in `benchtool explain ... | head -1`."""
    arguments = [shortened(tmp_path, "a.csv", 8.0), "--model", str(MODEL), "--check", CHECK]
    answer = tmp_path / "answer.json"
    process = subprocess.Popen(
        [*COMMAND, "explain", *arguments, "--draws", "20", "--json", str(answer)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    process.stdout.close()
    _, error = process.communicate(timeout=300)
    assert process.returncode == 0
    assert error == f"explaining {arguments[0]}, {CHECK}; this can take a minute or more\n"
    assert json.loads(answer.read_text("utf-8"))["version"] == 2
