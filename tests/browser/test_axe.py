"""No violation by axe-core on any tab: wide and narrow, light and dark."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from benchtool.web.page import TABS
from tests.browser.conftest import connect, go_to

if TYPE_CHECKING:
    from playwright.sync_api import Page

AXE = Path(__file__).parents[2] / "node_modules/axe-core/axe.min.js"

SIZES = {"wide": (1280, 900), "narrow": (390, 844)}


@pytest.fixture
def judged(page):
    if not AXE.exists():
        pytest.skip("axe-core is not installed; npm install --no-save axe-core@4.14.1")
    page.add_script_tag(content=AXE.read_text("utf-8"))
    # Colours are judged as they stay, not on their way.
    page.add_style_tag(content="* { transition: none !important; animation: none !important; }")
    return page


def violations(page: Page) -> list[str]:
    """Return what axe-core finds: rule, element and why."""
    found: list[dict[str, Any]] = page.evaluate("async () => (await axe.run()).violations")
    return [
        f"{one['id']} ({one['impact']}): {node['target']} {node['html'][:200]} "
        f"{node.get('failureSummary', '')}"
        for one in found
        for node in one["nodes"]
    ]


def check_everywhere(page: Page, what: str) -> None:
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        for name, (width, height) in SIZES.items():
            page.set_viewport_size({"width": width, "height": height})
            page.wait_for_timeout(300)
            found = violations(page)
            assert not found, f"{what}, {scheme}, {name}:\n" + "\n".join(found)


@pytest.mark.parametrize("tab", TABS)
def test_a_tab_without_violations(judged, tab):
    if tab in ("Bench", "Sweep"):
        connect(judged, "sim:pquad")
    go_to(judged, tab)
    judged.wait_for_timeout(2000)
    check_everywhere(judged, tab)


def test_a_dialog_without_violations(judged):
    connect(judged, "sim:pquad")
    go_to(judged, "Sweep")
    judged.get_by_role("button", name="Start the sweep").click()
    judged.get_by_text("expected thrust: about").wait_for()
    check_everywhere(judged, "the dialog before a sweep")


def test_what_axe_finds_fails_the_test(judged):
    judged.evaluate("document.querySelector('.stop-button').textContent = ''")
    with pytest.raises(AssertionError, match=r"button-name .critical.: .*stop-button"):
        check_everywhere(judged, "a STOP without a name")
