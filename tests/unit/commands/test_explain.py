"""`benchtool explain`: what it prints and writes, and what it refuses."""

from __future__ import annotations

import json
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


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    return command_line.said(capsys, "explain", *words)


def shortened(folder: Path, name: str, seconds: float) -> str:
    """Write the beginning of a recording that ships."""
    whole = read_recording(LEARN)
    part = whole.select(whole.column("time_s") < seconds)
    write_recording(folder / name, part, {})
    return str(folder / name)


@pytest.mark.slow
def test_hidden_friction_is_named_and_everything_is_written(capsys, tmp_path):
    out, answer = tmp_path / "out", tmp_path / "answer.json"
    words = (LEARN, "--model", str(MODEL), "--check", CHECK, "--draws", "30")
    code, said, _ = run(capsys, *words, "--out", str(out), "--json", str(answer))
    assert code == 0
    lines = said.splitlines()
    assert lines[0].startswith("SIMULATED DATA")
    assert lines[1].startswith("The model lacks Coulomb friction")
    found = json.loads(answer.read_text("utf-8"))
    assert found["verdict"] == "effect"
    torque = found["effects"][0]["parameters"]["torque_Nm"]
    assert torque["value"] == pytest.approx(0.012, abs=0.001)
    gap = found["gap"]["theta_rad"]
    assert gap["after"] < 0.7 * gap["before"]
    assert found["model_out"] == str(out / "model.toml")
    new = load_model(found["model_out"]).model
    assert new.parameters["coulomb_friction.torque_Nm"].value == torque["value"]
    assert new.parameters["inertia_kgm2"].value == pytest.approx(0.0306, rel=0.02)
    assert set(found["data"]["learn"].values()) <= set(new.provenance.values())
    code, _, refused = run(capsys, *words, "--out", str(out))
    assert code == 2
    assert f"{out} exists already" in refused


@pytest.mark.slow  # a new law is compiled
@pytest.mark.timeout(600)
def test_an_effect_of_the_users_own_is_tried_and_goes_with_the_model(capsys, tmp_path):
    own = tmp_path / "mine.py"
    own.write_text(GOOD, encoding="utf-8")
    code, _, _ = run(
        capsys, shortened(tmp_path, "a.csv", 12.0), "--model", str(MODEL), "--check", CHECK,
        "--effects", str(own), "--draws", "20", "--json", str(tmp_path / "answer.json"),
    )  # fmt: skip
    assert code == 0
    found = json.loads((tmp_path / "answer.json").read_text("utf-8"))
    assert found["tolerances"]["cubic_damping.c_Nms3"] == 0.002
    assert "cubic_damping" in found["probabilities"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("a.csv", "--check", "b.csv"), "which model"),
        (("short.csv", "--model", str(MODEL), "--check", CHECK), "2.0 s long"),
        ((LEARN, "--model", str(MODEL), "--check", CHECK, "--effects", "no.py"), "no such file"),
        (("--check", "b.csv", "a.csv"), "(every word behind --check is to check on)"),
        ((LEARN, "no.csv", "--model", "bad.csv"), "3 things to mend: (1) no.csv: "),
        ((LEARN, "--model", "word.txt", "--check", CHECK), "word.txt: this looks like plain text"),
        ((LEARN, "--model", "pitch_beam", "--check", CHECK), "name it with --rig, a shipped one"),
        (
            (LEARN, "--model", "pitch_pquad", "--rig", "pquad", "--check", CHECK),
            "2 rotors, and the model 4 (rig 'pquad')",
        ),
    ],
)
def test_what_cannot_be_answered_ends_with_one_sentence(capsys, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    shortened(tmp_path, "short.csv", 2.0)
    for name, text in (
        ("bad.csv", "t,theta\n0,1\n"),
        ("word.txt", "hello\n"),
    ):
        (tmp_path / name).write_text(text, "utf-8")
    code, out, err = run(capsys, *words)
    assert (code, out) == (2, "")
    assert said in err
    assert len(err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("a b --check c d --model m", "a b --check c --check d --model m"),
        ("a --check=c d --out o", "a --check=c --check d --out o"),
        ("a --model m b", "a --model m b"),
    ],
)
def test_every_word_behind_check_is_a_check_recording(words, meant):
    assert expand_repeated(words.split()) == meant.split()


@pytest.mark.slow
def test_a_record_of_another_simulator_is_explained_as_it_stands(capsys, tmp_path, reference_data):
    folder = reference_data / "pitch_bench"
    code, said, _ = run(
        capsys, str(folder / "body_lift.csv"), "--model", str(MODEL),
        "--check", str(folder / "body_lift_check.csv"), "--out", str(tmp_path / "out"),
    )  # fmt: skip
    assert code == 0
    # The other simulator's laws leave 1.7 floors beside the body lift.
    assert said.startswith(
        "What the model lacks is mostly like body lift (fountain): body_lift.K_b"
    )
    assert "between rotor speed and thrust" in said
    assert (tmp_path / "out" / "report.html").is_file()


@pytest.mark.slow
def test_a_reader_who_leaves_early_loses_no_file(tmp_path):
    """As `benchtool explain ... | head -1` does."""
    words = [shortened(tmp_path, "a.csv", 8.0), "--model", str(MODEL), "--check", CHECK]
    answer = tmp_path / "answer.json"
    process = subprocess.Popen(
        [*COMMAND, "explain", *words, "--draws", "20", "--json", str(answer)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    process.stdout.close()
    _, complaint = process.communicate(timeout=300)
    assert process.returncode == 0
    assert complaint == f"explaining {words[0]}, {CHECK}; this can take a minute or more\n"
    assert json.loads(answer.read_text("utf-8"))["version"] == 2
