"""The Bench tab: a pitch recording up to Explain."""

from __future__ import annotations

import re

import pytest

from benchtool.data.run.run import Run
from tests.browser.conftest import connect, expect

pytestmark = pytest.mark.real_time(deadline_s=0.1)


BENCH = "sim:beam?mode=pitch&schedule=identify&gains=stiff&hidden=coulomb_friction.torque_Nm:0.012"


def test_a_pitch_recording_goes_from_the_bench_to_explain(page, web):
    connect(page, BENCH)
    page.get_by_label("Virtual clock").click()
    page.get_by_text("20 times faster").click()
    page.get_by_label("Duration, s").fill("8")
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
    page.get_by_text("no validation recording is selected").wait_for()
