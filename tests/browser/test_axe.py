"""No violation by axe-core on any tab: wide and narrow, light and dark."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from benchtool.web.application import TABS
from tests.browser.conftest import connect, go_to

if TYPE_CHECKING:
    from playwright.sync_api import Page

AXE = Path(__file__).parents[2] / "node_modules/axe-core/axe.min.js"

SIZES = {"wide": (1280, 900), "narrow": (390, 844)}


@pytest.fixture
def axe_page(page):
    if not AXE.exists():
        pytest.skip("axe-core is not installed; npm install --no-save axe-core@4.14.1")
    page.add_script_tag(content=AXE.read_text("utf-8"))
    # Check final colours, not transitions.
    page.add_style_tag(content="* { transition: none !important; animation: none !important; }")
    return page


def violations(page: Page) -> list[str]:
    """Return the violations found by axe-core: rule, element and reason."""
    rules: list[dict[str, Any]] = page.evaluate("async () => (await axe.run()).violations")
    return [
        f"{rule['id']} ({rule['impact']}): {node['target']} {node['html'][:200]} "
        f"{node.get('failureSummary', '')}"
        for rule in rules
        for node in rule["nodes"]
    ]


def check_everywhere(page: Page, name: str) -> None:
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        for size, (width, height) in SIZES.items():
            page.set_viewport_size({"width": width, "height": height})
            page.wait_for_timeout(300)
            lines = violations(page)
            assert not lines, f"{name}, {scheme}, {size}:\n" + "\n".join(lines)


def test_all_tabs_without_violations(axe_page):
    for tab in sorted(TABS, key=("Bench", "Sweep").__contains__):
        axe_page.set_viewport_size({"width": 1280, "height": 900})
        go_to(axe_page, tab)
        if tab == "Bench":  # and then Sweep: the tabs that show the bench
            connect(axe_page, "sim:pquad")
            go_to(axe_page, tab)  # the mouse leaves the buttons
        axe_page.wait_for_timeout(2000)
        check_everywhere(axe_page, tab)


def test_a_dialog_without_violations(axe_page):
    connect(axe_page, "sim:pquad")
    go_to(axe_page, "Sweep")
    axe_page.get_by_role("button", name="Start the sweep").click()
    axe_page.get_by_text("expected thrust: about").wait_for()
    check_everywhere(axe_page, "the dialog before a sweep")


def test_what_axe_finds_fails_the_test(axe_page):
    axe_page.evaluate("document.querySelector('.stop-button').textContent = ''")
    with pytest.raises(AssertionError, match=r"button-name .critical.: .*stop-button"):
        check_everywhere(axe_page, "a STOP without a name")
