"""`benchtool explain --each`: every recording by itself, with the answer that it has alone."""

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
        words = f"sim:pquad?truth=virtual_pquad&seed={seed} --yes --z-over-r 0.6,1,2 --pwm 1500 "
        words += f"--repeats 2 --sample-s 1 --out run{seed}"
        assert said(capsys, "sweep", *words.split())[0] == 0
    return ["run1", "run2"]


@pytest.mark.slow
def test_each_has_the_answer_that_it_has_alone(capsys, runs):
    words = ("--model", "quad", "--check", "run3")
    code, out, error = said(capsys, "explain", *runs, *words, "--each", "--out", "found")
    assert code == 0, error
    assert "run1" in out
    assert sorted(each.name for each in Path("found").iterdir()) == runs
    said(capsys, "explain", "run1", *words, "--out", "alone")
    alone, beside = (
        json.loads(Path(folder, "answer.json").read_text()) for folder in ("alone", "found/run1")
    )
    for answer in (alone, beside):
        answer.pop("seconds"), answer.pop("model_out"), answer.pop("next_experiment")
    assert alone == beside


def test_words_that_do_not_fit_are_refused(capsys):
    given = ("a", "b", "--model", "quad", "--each", "--check")
    for words, says in (
        ((*given, "c", "d", "e"), "3 --check recordings for 2 recordings"),
        ((*given, "c", "--json", "x"), "--json is for one explanation"),
        ((*given, "c", "--bench", "sim:pquad"), "--bench is for one explanation"),
        (("a", "--cluster", "tcp://h:1", "--check", "c"), "--cluster needs --each"),
        (("x/a", "y/a", "--model", "quad", "--each", "--check", "c"), "have the same name a"),
    ):
        code, _, error = said(capsys, "explain", *words)
        assert code == 2
        assert says in error
