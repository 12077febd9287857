"""Tables of an explanation's page: none is cut at the width of a screen."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from benchtool.explain.engine.verdict import Kind
from benchtool.report.answer.page import answer_page
from benchtool.report.html import render_report
from tests.unit.explain.hand_made import answer

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.real_time(deadline_s=0.1)


@pytest.mark.parametrize("width", [1280, 820])
@pytest.mark.parametrize("kind", ["effect", "class"])
def test_no_table_is_cut_at_the_width_of_a_screen(
    kind: Kind, width: int, browser: Browser, tmp_path: Path
) -> None:
    given = answer(kind)
    path = tmp_path / "report.html"
    path.write_text(render_report(answer_page(given, {}, folder="found")), encoding="utf-8")
    page = browser.new_page(viewport={"width": width, "height": 900})
    page.goto(path.as_uri())
    cut = page.evaluate(
        "[...document.querySelectorAll('.wide')].map(box => box.scrollWidth - box.clientWidth)"
    )
    page.close()
    assert len(cut) >= 4
    assert max(cut) <= 0
