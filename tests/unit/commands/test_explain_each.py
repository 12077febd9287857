"""Option `benchtool explain --each`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.unit.commands.command_line import said

ROOT = Path(__file__).parents[3]
Capsys = pytest.CaptureFixture[str]


@pytest.fixture
def runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for seed in (1, 2, 3):
        arguments = f"sim:pquad?truth=virtual_pquad&seed={seed} --yes --z-over-r 0.6,1,2 "
        arguments += f"--pwm 1500 --repeats 2 --sample-s 1 --out run{seed}"
        assert said(capsys, "sweep", *arguments.split())[0] == 0
    return ["run1", "run2"]


@pytest.mark.slow
def test_each_answer_equals_the_single_answer(capsys, runs):
    options = ("--model", "quad", "--check", "run3")
    code, out, error = said(capsys, "explain", *runs, *options, "--each", "--out", "found")
    assert code == 0, error
    assert "run1" in out
    assert sorted(path.name for path in Path("found").iterdir()) == runs
    said(capsys, "explain", "run1", *options, "--out", "alone")
    single, batch = (
        json.loads(Path(folder, "answer.json").read_text()) for folder in ("alone", "found/run1")
    )
    for answer in (single, batch):
        answer.pop("seconds"), answer.pop("model_out"), answer.pop("next_experiment")
    assert single == batch


def test_invalid_combinations_are_rejected(capsys):
    options = ("a", "b", "--model", "quad", "--each", "--check")
    for arguments, message in (
        ((*options, "c", "d", "e"), "3 --check recordings for 2 recordings"),
        ((*options, "c", "--json", "x"), "--json is for one explanation"),
        ((*options, "c", "--bench", "sim:pquad"), "--bench is for one explanation"),
        (("a", "--cluster", "tcp://h:1", "--check", "c"), "--cluster needs --each"),
        (("x/a", "y/a", "--model", "quad", "--each", "--check", "c"), "have the same name a"),
    ):
        code, _, error = said(capsys, "explain", *arguments)
        assert code == 2
        assert message in error
