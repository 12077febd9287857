"""Blocks as HTML with escaped contents of a run's files."""

from __future__ import annotations

import pytest

from benchtool.report.page import Commands, Listing, Table, Warnings
from benchtool.web.drawing import FigureImage, as_html

EVIL = "<script>alert('x')</script><img src=x onerror=y>\"'&"


@pytest.mark.parametrize(
    "block",
    [
        EVIL,
        {EVIL: EVIL},
        Warnings([EVIL]),
        Commands([EVIL]),
        Listing(EVIL, EVIL),
        Table(EVIL, (EVIL, EVIL), [(EVIL, EVIL)]),
        FigureImage(b"<svg><script>alert(1)</script></svg>", EVIL),
    ],
    ids=lambda block: type(block).__name__,
)
def test_nothing_in_a_block_is_markup(block):
    html = as_html(block)
    assert "<script" not in html
    assert "<img src=x" not in html
    assert "onerror=y>&quot;" in html or "onerror=y&gt;" in html
