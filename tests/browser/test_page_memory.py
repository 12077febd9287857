"""What a page shows and holds when it is loaded again, when its server starts anew, when narrow."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest

from tests.browser.conftest import Web, connect, expect, go_to, serving

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.real_time(deadline_s=0.1)


def test_forms_survive_a_reload_and_a_restart_of_the_server(
    open_page: Callable[[str], Page], tmp_path: Path
) -> None:
    places = tmp_path / "runs", tmp_path / "state"
    with serving(*places) as web:
        page = open_page(f"{web.url}?tab=fit")
        page.get_by_role("checkbox", name="emcee").click()
        page.get_by_label("Name of the fit's folder").fill("my-fit")
        page.get_by_label("body_lift.K_b is free").click()
        page.wait_for_timeout(1000)
        page.reload()
        expect(page.get_by_role("checkbox", name="emcee")).to_be_checked()
        port = urlsplit(web.url).port
    with serving(*places, "--port", str(port)) as web:
        page.goto(f"{web.url}?tab=fit")
        expect(page.get_by_role("checkbox", name="emcee")).to_be_checked()
        expect(page.get_by_label("Name of the fit's folder")).to_have_value("my-fit")
        expect(page.get_by_label("body_lift.K_b is free")).not_to_be_checked()
        other = open_page(f"{web.url}?tab=fit")
        expect(other.get_by_role("checkbox", name="emcee")).not_to_be_checked()


def test_one_alarm_banner_says_why_and_the_log_says_when(page: Page) -> None:
    page.set_viewport_size({"width": 420, "height": 900})
    expect(page.get_by_text("at the controls", exact=True)).to_be_visible()
    page.get_by_label("Address of the bench").fill("serial:/dev/none")
    page.get_by_label("Rig", exact=True).click()
    page.get_by_role("option", name="pquad", exact=True).click()
    for _ in range(2):
        page.get_by_role("button", name="Connect", exact=True).click()
        alarm = page.locator(".alarm")
        expect(alarm).to_contain_text("/dev/none")
        expect(page.get_by_text("/dev/none", exact=False).filter(visible=True)).to_have_count(2)
    colours = [
        page.locator(name).evaluate("(one) => getComputedStyle(one).backgroundColor")
        for name in (".alarm", ".stop-button")
    ]
    assert colours[0] != colours[1]
    page.get_by_role("button", name="Messages").click()
    expect(page.locator(".q-dialog .events")).to_contain_text("(2 times)")
    page.get_by_role("button", name="Close").click()
    page.get_by_role("button", name="Dismiss").click()
    expect(alarm).to_be_hidden()


def test_the_address_shown_is_the_bench_that_is_connected(page: Page, web: Web) -> None:
    connect(page, "sim:pquad?rate=200")
    page.reload()
    field = page.get_by_label("Address of the bench")
    expect(field).to_have_value("sim:pquad?rate=200")
    go_to(page, "Fit")
    assert page.evaluate("document.documentElement.lang") == "en-US"
