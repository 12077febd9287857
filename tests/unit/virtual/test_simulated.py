"""The bench on a virtual clock: exact times, no sample lost, the device's own limits."""

import numpy as np
import pytest

from benchtool.bench.drivers import open_bench
from benchtool.core.errors import DeviceStopped
from tests.unit.commands.command_line import run


@pytest.fixture
def bench():
    with open_bench("sim:pquad?seed=5") as opened:
        yield opened


def column(bench, readings, name):
    return readings.values[:, [item.name for item in bench.identity.channels].index(name)]


def test_time_advances_by_exactly_what_was_asked(bench):
    start_s = bench.now_s()
    readings = [bench.read(timeout_s) for timeout_s in (0.001, 0.004, 0.0125, 1.0, 10.0)]
    assert bench.now_s() - start_s == pytest.approx(11.0175, abs=1e-9)
    assert [len(item) for item in readings] == [0, 1, 2, 200, 2000]
    time_s = np.concatenate([item.time_s for item in readings])
    np.testing.assert_allclose(np.diff(time_s), 0.005, rtol=0, atol=1e-9)
    device_us = np.concatenate([item.device_time_us for item in readings])
    assert np.all(np.diff(device_us) == 5000.0)


def test_the_device_stops_by_itself_and_the_samples_that_show_why_come_first(bench):
    bench.tare()
    bench.set_limit("thrust_N", 5.0)
    bench.set_pwm(np.full(4, 1500.0))
    readings = bench.read(1.0)
    assert np.nanmax(column(bench, readings, "thrust_N")) > 5.0
    assert any(message.startswith("limit") for message in readings.messages)
    with pytest.raises(DeviceStopped, match="limit 5"):
        bench.read(1.0)
    with pytest.raises(DeviceStopped):
        bench.set_pwm(np.full(4, 1300.0))
    bench.clear()
    later = bench.read(2.0)
    assert np.nanmax(column(bench, later, "rpm1")[-50:]) == 0.0


@pytest.mark.parametrize("name", ["pquad", "amuse", "pquad_single"])
def test_no_channel_of_a_shipped_bench_counts_as_frozen(name, tmp_path):
    """The reaction torques of a balanced vehicle cancel: without noise the sensor showed 0."""
    words = ["--z-over-r", "2", "--pwm", "1500,1600", "--repeats", "1", "--yes"]
    assert run("sweep", f"sim:{name}", *words, "--out", str(tmp_path / "run")) == 0
    assert '"frozen"' not in (tmp_path / "run" / "events.jsonl").read_text("utf-8")
