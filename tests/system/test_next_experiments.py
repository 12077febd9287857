"""`explain --bench --until`: the proposed experiments are recorded, each armed by hand."""

from __future__ import annotations

import json
import signal
from io import StringIO
from pathlib import Path

import pytest

from benchtool.acquire.record import ProgressLines
from benchtool.data.run.append import read_events
from benchtool.data.run.points import Point
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run
from tests.unit.commands.command_line import run as call
from tests.unit.commands.command_line import said

MODEL = """
[model]
name = "eq2"
rig = "pquad_single"
description = "One rotor, eq. (2)."

[parameters]
k.value = 1.035e-5
k.prior = {{ kind = "normal", mean = 1.035e-5, sd = 3e-7, source = "its maker" }}
R_m.value = 0.12
R_m.prior = {{ kind = "normal", mean = 0.12, sd = 0.003, source = "a guess" }}

[effects.rotor_images]
own_strength = 1.0
{more}
"""
BENCH = "sim:pquad_single?truth=truth.toml&seed={}"


def truth(effect: str, value: str) -> str:
    return MODEL.format(more=f"[effects.{effect}]\n{value}")


@pytest.fixture(autouse=True)
def _poor(tmp_path, monkeypatch):
    """Sweep a bench that hides a tilt of its plate so poorly that nothing can be said."""
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    Path("model.toml").write_text(MODEL.format(more=""))
    Path("truth.toml").write_text(truth("plate_tilt", "angle_rad = 0.03"))
    for name, seed, distances in (("learn", 31, "1,1.5"), ("check", 33, "1.2,3")):
        words = ["--z-over-r", distances, "--pwm", "1500,1600", "--repeats", "2", "--yes"]
        assert call("sweep", BENCH.format(seed), *words, "--out", name) == 0


EXPLAIN = ["explain", "learn", "--model", "model.toml", "--check", "check", "--out", "found"]


def typed(monkeypatch: pytest.MonkeyPatch, lines: str) -> None:
    monkeypatch.setattr("sys.stdin", StringIO(lines))


def test_experiments_are_recorded_until_the_answer_is_sure(monkeypatch, capsys):
    typed(monkeypatch, "ARM\n" * 3)
    capsys.readouterr()
    code, out, err = said(capsys, *EXPLAIN, "--bench", BENCH.format(35), "--json", "found.json")
    assert (code, err.count("Traceback")) == (0, 0)
    assert out.count("type ARM to arm") == out.count("\nExperiment ") >= 1
    first = out[out.index("\nExperiment 1 of up to 3: A sweep at z/R ") :]
    # Pulses and distances stand before the word is asked for.
    asked = first.index("type ARM to arm")
    assert first.index("plate z/R ") < first.index("pulses ") < first.index("within limits") < asked
    assert len(read_points("found/experiment-1")) >= 8
    found = json.loads(Path("found.json").read_text())
    assert "experiment-1" in " ".join(found["data"]["learn"])
    assert "plate_tilt" in [effect["name"] for effect in found["effects"]]
    assert out.rstrip().splitlines()[-1].startswith("The verdict has reached --until 0.95 after ")


def test_each_experiment_is_armed_by_hand_and_not_by_yes(monkeypatch, capsys):
    typed(monkeypatch, "yes\n")
    code, _, err = said(capsys, *EXPLAIN, "--bench", BENCH.format(35))
    assert code == 5
    assert "not armed: ARM was not typed; no motor was started" in err
    assert not Path("found/experiment-1").exists()
    assert Path("found/answer.json").is_file()
    assert said(capsys, *EXPLAIN, "--bench", BENCH.format(35), "--yes")[0] == 2


def test_ctrl_c_in_the_second_experiment_leaves_motors_at_zero_and_the_answer(monkeypatch, capsys):
    """The signal comes for real, when the second sweep has measured three points."""
    typed(monkeypatch, "ARM\nARM\n")
    measured = ProgressLines.measured

    def interrupted(display: ProgressLines, point: Point, remaining_s: float) -> None:
        measured(display, point, remaining_s)
        if point.point == 3 and Path("found/experiment-2").exists():
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(ProgressLines, "measured", interrupted)
    Path("truth.toml").write_text(truth("plate_offset", "dz_m = 0.012"))
    words = ["--bench", BENCH.format(35), "--until", "0.9999"]
    code, out, err = said(capsys, *EXPLAIN, *words)
    assert code == 5
    assert "stopped by Ctrl-C; zero was commanded" in err
    assert "benchtool sweep --resume found/experiment-2" in out
    run = Path("found/experiment-2")
    assert Run.open(run).metadata["state"] == "stopped"
    assert read_events(run / "events.jsonl")[-1].event == "stopped"
    assert read_samples(run).column("pwm1_us")[-1] <= 1000.0
    assert read_samples(run).column("pwm1_us").max() > 1400.0
    answer = json.loads(Path("found/answer.json").read_text())
    assert list(answer["data"]["learn"]) == ["learn", "experiment-1"]
