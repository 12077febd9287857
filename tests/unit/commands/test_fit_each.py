"""`benchtool fit --each`: every run by itself, with the same numbers as alone, and resumable."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchtool.commands.terminal import batch
from tests.proof.truth.budgets import budget_sweep
from tests.unit.commands.command_line import said

WORDS = ("--rig", "pquad", "--model", "quad_bench")
Capsys = pytest.CaptureFixture[str]


@pytest.fixture
def tables(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for k in range(2):
        budget_sweep(k, tmp_path / f"bench{k}.csv")
    return [f"bench{k}.csv" for k in range(2)]


def results(folder: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(Path(folder, "result.json").read_text())["results"]
    return found


@pytest.mark.slow
def test_each_is_fitted_as_alone_and_pooled_next(capsys, tables):
    code, out, error = said(capsys, "fit", *tables, "--each", *WORDS, "--out", "fits")
    assert code == 0, error
    assert "benchtool pool fits/bench0 fits/bench1" in out
    assert sorted(each.name for each in Path("fits").iterdir()) == ["bench0", "bench1"]
    said(capsys, "fit", tables[1], *WORDS, "--out", "alone")
    assert results("fits/bench1") == results("alone")
    code, _, error = said(capsys, "fit", *tables, "--each", *WORDS, "--out", "fits")
    assert code == 2
    assert "fits exists already" in error


def test_one_that_fails_ends_no_other(capsys, tables):
    Path("bench1.csv").write_text("time_s,thrust_N\n1,2\n")
    code, out, error = said(capsys, "fit", *tables, "--each", *WORDS)
    assert code == 2
    assert "! bench1: " in out
    assert "1 of 2 failed, first bench1" in error
    assert "bench0" in out


def test_words_that_do_not_fit_are_refused(capsys, tables):
    code, _, error = said(capsys, "fit", *tables, *WORDS, "--cluster", "tcp://127.0.0.1:1")
    assert (code, "add --each" in error) == (2, True)
    code, _, error = said(capsys, "fit", tables[0], tables[0], "--each", *WORDS)
    assert (code, "have the same name bench0" in error) == (2, True)
    assert batch.index_by_name(tables) == {f"bench{k}": f"bench{k}.csv" for k in range(2)}
