"""Faults x phases x links: each cell of the table is a whole sweep on a virtual clock."""

from __future__ import annotations

import os

import pytest

from tests.faults.cell import Cell, run_cell
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
def test_a_cell_of_the_table(tmp_path, cell):
    assert run_cell(cell, fault_of(cell), tmp_path).wrong == ""


def test_the_table_covers_what_it_says():
    names = [cell.name for cell in CELLS]
    assert len(set(names)) == len(names) >= 230
    for cells in (CELLS, CELLS[FIRST::SAMPLE]):
        assert {cell.link for cell in cells} == {"tcp", "pty", "mavlink", "grbl"}
    assert {cell.phase for cell in CELLS} <= set(PHASES)
