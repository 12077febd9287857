"""The contract of every registered figure: shown by its page, described, drawn."""

from __future__ import annotations

from typing import Any

import pytest

from benchtool.report.figure import SIMULATED_GID, all_figures, figure_bytes
from benchtool.report.page import PAGES
from tests.contracts.figure_subjects import SUBJECTS

FIGURES = {f"{entry.page}/{entry.name}": entry for entry in all_figures()}
EACH = pytest.mark.parametrize("entry", FIGURES.values(), ids=FIGURES)


@pytest.mark.parametrize("page", sorted({entry.page for entry in FIGURES.values()} | set(PAGES)))
def test_a_page_shows_every_figure_of_its_own_and_no_other(page):
    registered = {entry.name for entry in FIGURES.values() if entry.page == page}
    assert page in PAGES, f"no page is called {page}: make one with Page({page!r}, ...)"
    shown = PAGES[page].figures
    missing = sorted(registered ^ set(shown))
    assert not missing, f"name {missing} in the sections of page {page}"
    assert len(shown) == len(set(shown))


@EACH
def test_it_is_drawn_with_axes_words_and_stamp(entry):
    assert entry.page in SUBJECTS, f"add a subject of {entry.page} to figure_subjects.py"
    blocks: dict[str, Any] = {}
    for subject in SUBJECTS[entry.page]():
        blocks |= dict(entry.blocks(subject))
    assert blocks, "no subject allows it: add one to figure_subjects.py"
    for name, block in blocks.items():
        assert name == entry.name or name.startswith(f"{entry.name}_")
        assert len(block.caption) > 20
        assert block.caption.endswith(".")
        assert "{" not in block.caption
        figure = block.figure
        assert figure.get_suptitle().strip()
        assert "{" not in figure.get_suptitle().replace("\\hat{", "")
        assert figure.axes
        stamps = [text for text in figure.texts if text.get_gid() == SIMULATED_GID]
        assert len(stamps) <= 1
    assert figure_bytes(figure).startswith(b"<?xml")
