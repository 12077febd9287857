"""Form values after a reload of the page and a restart of the server."""

from __future__ import annotations

from urllib.parse import urlsplit

from tests.browser.conftest import expect, serving


def test_forms_survive_a_reload_and_a_restart_of_the_server(open_page, tmp_path, capfd):
    folders = tmp_path / "runs", tmp_path / "state"
    with serving(*folders) as web:
        page = open_page(f"{web.url}?tab=fit")
        page.get_by_role("checkbox", name="emcee").click()
        page.get_by_label("Name of the fit's folder").fill("my-fit")
        page.get_by_label("body_lift.K_b is free").click()
        page.get_by_role("tab", name="Sweep").click()
        page.get_by_label("Plate distances, z/R").fill("0.7,2")
        page.wait_for_timeout(1000)
        page.goto(f"{web.url}?tab=fit")
        expect(page.get_by_role("checkbox", name="emcee")).to_be_checked()
        port = urlsplit(web.url).port
    with serving(*folders, "--port", str(port)) as web:
        page.goto(f"{web.url}?tab=fit")
        expect(page.get_by_role("checkbox", name="emcee")).to_be_checked()
        expect(page.get_by_label("Name of the fit's folder")).to_have_value("my-fit")
        expect(page.get_by_label("body_lift.K_b is free")).not_to_be_checked()
        page.get_by_role("tab", name="Sweep").click()
        expect(page.get_by_label("Plate distances, z/R")).to_have_value("0.7,2")
        other = open_page(f"{web.url}?tab=fit")
        expect(other.get_by_role("checkbox", name="emcee")).not_to_be_checked()
    assert "Traceback" not in capfd.readouterr().err
