"""`explain --bench --until`: the proposed experiments are recorded, each armed by hand."""

from __future__ import annotations

import json
from io import StringIO
from pathlib import Path

import pytest

from benchtool.data.run.read import read_points
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
HIDDEN = "[effects.{}]\n{}"
BENCH = "sim:pquad_single?truth=truth.toml&seed={}"


@pytest.fixture(autouse=True)
def _poor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sweep a bench that hides an offset of its plate so poorly that nothing can be said."""
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    Path("model.toml").write_text(MODEL.format(more=""))
    Path("truth.toml").write_text(MODEL.format(more=HIDDEN.format("plate_offset", "dz_m = 0.012")))
    for name, seed, distances in (("learn", 31, "1,1.5"), ("check", 33, "1.2,3")):
        words = ["--z-over-r", distances, "--pwm", "1500,1600", "--repeats", "2", "--yes"]
        assert call("sweep", BENCH.format(seed), *words, "--out", name) == 0


EXPLAIN = ["explain", "learn", "--model", "model.toml", "--check", "check", "--out", "found"]


def typed(monkeypatch: pytest.MonkeyPatch, lines: str) -> None:
    monkeypatch.setattr("sys.stdin", StringIO(lines))


def test_experiments_are_recorded_until_the_answer_is_sure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed(monkeypatch, "ARM\n" * 3)
    capsys.readouterr()
    code, out, err = said(capsys, *EXPLAIN, "--bench", BENCH.format(35), "--json", "found.json")
    assert (code, err.count("Traceback")) == (0, 0)
    assert out.count("type ARM to arm") == out.count("\nExperiment ") >= 1
    first = out[out.index("\nExperiment 1 of 3 at most: A sweep at z/R ") :]
    # Pulses and distances stand before the word is asked for.
    asked = first.index("type ARM to arm")
    assert first.index("plate z/R ") < first.index("pulses ") < first.index("limits hold") < asked
    assert len(read_points("found/experiment-1")) >= 8
    found = json.loads(Path("found.json").read_text())
    assert "experiment-1" in " ".join(found["data"]["learn"])
    assert "plate_offset" in [effect["name"] for effect in found["effects"]]
    assert out.rstrip().splitlines()[-1].startswith("The answer is as sure as --until 0.95 after ")
