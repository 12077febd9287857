"""Faults x phases x links: each cell of the table is a whole sweep on a virtual clock."""

from __future__ import annotations

import os
from math import isnan
from pathlib import Path

import pytest

from tests.faults.cell import (
    Cell,
    check_folder,
    check_lost,
    check_motors,
    check_rows,
    check_sentence,
    run_cell,
)
from tests.faults.matrix import CELLS, PHASES, fault_of

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
    fault = fault_of(cell)
    outcome, result = run_cell(cell, fault, tmp_path)
    assert fault.hit > 0
    check_sentence(outcome, cell.expected)
    check_motors(outcome, cell.visits)
    check_folder(outcome, cell.visits)
    check_rows(outcome, cell.link, fault)
    check_lost(outcome, cell.link, fault)
    limit_s = cell.expected.within_s
    if limit_s is not None and outcome.code != 0 and not isnan(result.zero_s):
        assert result.zero_s <= limit_s


def test_the_table_covers_what_it_says() -> None:
    names = [cell.name for cell in CELLS]
    assert len(set(names)) == len(names) >= 280
    for cells in (CELLS, CELLS[FIRST::SAMPLE]):
        assert {cell.link for cell in cells} == {"tcp", "pty", "mavlink", "rcbudp", "grbl"}
    assert {cell.phase for cell in CELLS} <= set(PHASES)
