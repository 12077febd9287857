"""Faults x phases x links: each cell of the table is a whole sweep on a virtual clock."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from tests.faults.cell import Cell, run_cell
from tests.faults.matrix import CELLS, PHASES, fault_of, main

FIRST, SAMPLE = 4, 24
"""Every so many-th cell runs in `make test`, from one on that brings every link; all of them in
`make test-all`.
"""


def cell_or_slow(at: int, cell: Cell) -> object:
    marks = [pytest.mark.slow] if at % SAMPLE != FIRST else []
    if cell.link in ("pty", "grbl") and os.name != "posix":
        marks.append(pytest.mark.skip(reason="needs pseudo-terminals"))
    return pytest.param(cell, id=cell.name, marks=marks)


@pytest.mark.parametrize("cell", [cell_or_slow(*item) for item in enumerate(CELLS)])
def test_a_cell_of_the_table(tmp_path: Path, cell: Cell) -> None:
    assert run_cell(cell, fault_of(cell), tmp_path).wrong == ""


def test_the_table_covers_what_it_says() -> None:
    names = [cell.name for cell in CELLS]
    assert len(set(names)) == len(names) >= 230
    for cells in (CELLS, CELLS[FIRST::SAMPLE]):
        assert {cell.link for cell in cells} == {"tcp", "pty", "mavlink", "grbl"}
    assert {cell.phase for cell in CELLS} <= set(PHASES)


def test_the_program_prints_and_counts_what_is_not_as_the_table_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = next(cell for cell in CELLS if cell.name == "tcp-hello-device_silent_0.6_s")
    bad = replace(runs, phase="arming")  # which ends with exit code 3
    path = tmp_path / "cells.jsonl"
    assert main(path, [runs, bad]) == 1
    said = capsys.readouterr().out
    assert f"wrong: {bad.name}: AssertionError" in said
    assert "(check_sentence: assert outcome.code in expected.codes" in said
    assert said.endswith("1 of 2 cells wrong\n")
    assert [json.loads(line)[0] for line in path.read_text().splitlines()] == [runs.name, bad.name]
    assert main(path, [runs]) == 0
