"""Blocks as HTML: whatever stands in a run's files is text, never markup."""

from __future__ import annotations

from base64 import b64decode

import pytest
from matplotlib.figure import Figure

from benchtool.report.page import (
    Block,
    Commands,
    Facts,
    FigureBlock,
    Listing,
    Paragraph,
    Table,
    Warnings,
)
from benchtool.web.drawing import FigureImage, as_html, blocks_html

EVIL = "<script>alert('x')</script><img src=x onerror=y>\"'&"


@pytest.mark.parametrize(
    "block",
    [
        Paragraph(EVIL),
        Facts({EVIL: EVIL}),
        Warnings([EVIL]),
        Commands([EVIL]),
        Listing(EVIL, EVIL),
        Table(EVIL, (EVIL, EVIL), [(EVIL, EVIL)]),
        FigureImage(b"<svg><script>alert(1)</script></svg>", EVIL),
    ],
    ids=lambda block: type(block).__name__,
)
def test_nothing_in_a_block_is_markup(block: Block | FigureImage) -> None:
    html = as_html(block)
    assert "<script" not in html
    assert "<img src=x" not in html
    assert "onerror=y>&quot;" in html or "onerror=y&gt;" in html


def test_a_figure_becomes_an_image_that_crosses_processes() -> None:
    html = blocks_html([FigureBlock(Figure(), "a caption"), Paragraph("x")])
    assert html.startswith('<div class="block-beside"><figure')
    assert html.endswith("</div><p>x</p>")
    assert 'alt="a caption"' in html
    encoded = html.split("base64,")[1].split('"')[0]
    assert b"<svg" in b64decode(encoded)


def test_numbers_of_a_table_are_marked_and_heads_named() -> None:
    html = as_html(Table("What.", ("name", "value"), [("R", "0.12")]))
    assert '<th scope="row">R</th><td class="number">0.12</td>' in html
    assert '<th scope="col"><button type="button">name</button></th>' in html


def test_no_warning_makes_no_box() -> None:
    assert as_html(Warnings([])) == ""
