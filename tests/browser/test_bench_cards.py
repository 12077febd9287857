"""Cards of the Bench tab: a calibration beside the bench; a pitch recording up to Explain."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import pytest

from benchtool.core.rig_file import rig_named
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.data.run.read import read_points
from benchtool.data.run.run import Run
from benchtool.simulate.imperfections import Imperfections
from tests.browser.conftest import SWEEP_MS, Web, connect, expect, only_run, start
from tests.browser.device import Device

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.real_time(deadline_s=0.1)

LIGHTER = 0.8
"""What hangs is so many times what is typed: the line stored must be that of the masses typed."""

MASSES_KG = (0.0, 0.5, 1.0, 0.5, 0.0)


def weigh(page: Page, device: Device, mass_kg: float, count: int) -> None:
    """Hang a mass, have it weighed, and wait for its line."""
    device.hang(LIGHTER * mass_kg)
    page.get_by_label("Mass, kg").fill(f"{mass_kg:g}")
    page.get_by_role("button", name="Weigh").click()
    lines = r"(document.body.innerText.match(/ kg: -?[\d.]+ counts/g) ?? []).length"
    page.wait_for_function(f"{lines} === {count}")


def test_masses_make_a_line_that_later_runs_take(page: Page, web: Web, fast_device: Device) -> None:
    connect(page, fast_device.address)
    page.get_by_text("none: thrust is what the device sends").wait_for()
    page.get_by_role("button", name="Calibrate").click()
    page.get_by_text("Hang a mass, wait until it is still").wait_for()
    expect(page.locator(".hold-button")).to_be_hidden()
    page.get_by_label("Mass, kg").fill("500")
    page.get_by_role("button", name="Weigh").click()
    page.get_by_text("500 kg pull with").wait_for()
    for count, mass_kg in enumerate(MASSES_KG, 1):
        weigh(page, fast_device, mass_kg, count)
    command = f"benchtool calibrate {fast_device.address} --masses 0,0.5,1,0.5,0"
    page.locator(".command-text", has_text=command).wait_for()
    page.get_by_text("Who calibrates, with which masses").click()
    page.get_by_label("Certificate", exact=True).fill("K-7")
    page.get_by_label("Gravity +-, m/s2", exact=True).fill("0.01")
    page.locator(".command-text", has_text="--gravity-u 0.01 --certificate K-7").wait_for()
    page.get_by_role("button", name="Store the calibration").click()
    page.get_by_text("uN per count, stored for virtual-pquad-0").wait_for()

    (file,) = (web.runs.parent / "state" / "calibration").iterdir()
    stored = json.loads(file.read_text("utf-8"))
    assert stored["masses_kg"] == list(MASSES_KG)
    assert stored["certificate"] == "K-7"
    gravity = {part["name"]: part for part in stored["components"]}["gravity"]
    assert gravity["relative_sd"] == pytest.approx(0.01 / STANDARD_GRAVITY_M_S2)
    count_N = Imperfections().on(rig_named("pquad")).thrust_quantum_N
    assert stored["slope_N_per_count"] == pytest.approx(count_N / LIGHTER, rel=2e-3)
    hung_N = LIGHTER * STANDARD_GRAVITY_M_S2 * max(MASSES_KG)
    assert max(stored["counts"]) - min(stored["counts"]) == pytest.approx(
        hung_N / count_N, rel=2e-3
    )
    assert fast_device.turning_us() <= 1000.0

    page.get_by_role("button", name="Done").click()
    page.get_by_text(f"calibration {stored['id']}").wait_for()
    page.locator(".hold-button").wait_for()
    start(page, repeats=1, distances="1")
    page.get_by_text("ended: ").first.wait_for(timeout=SWEEP_MS)
    points = read_points(only_run(web).path)
    assert points.provenance["calibration"] == stored["id"]


BENCH = "sim:beam?mode=pitch&schedule=identify&gains=stiff&hidden=coulomb_friction.torque_Nm:0.012"


def test_a_pitch_recording_goes_from_the_bench_to_explain(page: Page, web: Web) -> None:
    connect(page, BENCH)
    page.get_by_label("Virtual clock").click()
    page.get_by_text("20 times faster").click()
    page.get_by_label("Length, s").fill("8")
    record = page.get_by_role("button", name="Record", exact=True)
    record.click()
    page.get_by_text("the beam is free to turn").wait_for()
    command = page.locator(".command-text", has_text="--seconds")
    expect(command).to_have_text(
        re.compile(re.escape(f"benchtool record '{BENCH}' --seconds 8") + r"(\s|$)")
    )
    page.get_by_role("button", name="Start", exact=True).click()
    page.get_by_text("ended: ").wait_for()
    (path,) = web.runs.iterdir()
    run = Run.open(path)
    assert run.metadata["seconds"] == 8.0
    assert run.metadata["samples"]["parquet_sha256"]
    page.get_by_role("button", name="Explain", exact=True).click()
    page.get_by_text(f"{path.name} (pitch recording").wait_for()
    page.get_by_text("no recording to check on is chosen").wait_for()
