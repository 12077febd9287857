"""Option `benchtool fit --each`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchtool.commands.terminal import batch
from tests.proof.truth.budgets import budget_sweep
from tests.unit.commands.command_line import said

OPTIONS = ("--rig", "pquad", "--model", "quad_bench")
Capsys = pytest.CaptureFixture[str]


@pytest.fixture
def tables(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for k in range(2):
        budget_sweep(k, tmp_path / f"bench{k}.csv")
    return [f"bench{k}.csv" for k in range(2)]


def results(folder: str) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(Path(folder, "result.json").read_text())["results"]
    return data


@pytest.mark.slow
def test_each_fit_equals_the_single_fit(capsys, tables):
    code, out, error = said(capsys, "fit", *tables, "--each", *OPTIONS, "--out", "fits")
    assert code == 0, error
    assert "benchtool pool fits/bench0 fits/bench1" in out
    assert sorted(path.name for path in Path("fits").iterdir()) == ["bench0", "bench1"]
    said(capsys, "fit", tables[1], *OPTIONS, "--out", "alone")
    assert results("fits/bench1") == results("alone")
    code, _, error = said(capsys, "fit", *tables, "--each", *OPTIONS, "--out", "fits")
    assert code == 2
    assert "fits exists already" in error


def test_a_failed_fit_does_not_stop_the_others(capsys, tables):
    Path("bench1.csv").write_text("time_s,thrust_N\n1,2\n")
    code, out, error = said(capsys, "fit", *tables, "--each", *OPTIONS)
    assert code == 2
    assert "! bench1: " in out
    assert "1 of 2 failed, first bench1" in error
    assert "bench0" in out


def test_invalid_combinations_are_rejected(capsys, tables):
    code, _, error = said(capsys, "fit", *tables, *OPTIONS, "--cluster", "tcp://127.0.0.1:1")
    assert (code, "add --each" in error) == (2, True)
    code, _, error = said(capsys, "fit", tables[0], tables[0], "--each", *OPTIONS)
    assert (code, "have the same name bench0" in error) == (2, True)
    assert batch.index_by_name(tables) == {f"bench{k}": f"bench{k}.csv" for k in range(2)}
