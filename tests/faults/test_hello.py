"""Noise while the device says who it is costs time, and never a channel's name."""

from __future__ import annotations

from unittest import mock

import pytest

from benchtool.bench.serial.hello import Hello, hello_lines
from tests.faults.loop import Outcome, plan, sweep
from tests.faults.proxy import Fault


def channels_recorded(outcome: Outcome) -> list[str]:
    header = (outcome.folder / "run/samples.csv").read_text().partition("\n")[0]
    return header.split(",")[4:]


@pytest.mark.parametrize("name", ["current_A", "thrust_raw", "plate_x_m", "plate_z_m", "thrust_N"])
def test_a_line_lost_once_leaves_the_channels_as_they_are(tmp_path, name):
    lost = Fault("drop", phase="connect", way="host", only=f",channel,{name},", times=1)
    outcome = sweep(tmp_path, plan(), [lost])
    assert lost.hit == 1
    assert outcome.code == 0, outcome.said
    assert channels_recorded(outcome) == outcome.seen.channels
    (point,) = outcome.points()
    assert 10.0 < float(point["voltage_V"]) < 13.0
    assert float(point["temperature_degC"]) > 10.0
    assert outcome.metadata["device"]["channel_hash"]
    assert outcome.metadata["device"]["orders_protected"] is True


@pytest.mark.parametrize(("phase", "seed"), [("connect", 0), ("hello", 1)])
def test_a_hello_out_of_order(tmp_path, phase, seed):
    noise = Fault("reorder", phase=phase, for_s=1.0, p=0.3, seed=seed)
    outcome = sweep(tmp_path, plan(), [noise])
    assert noise.hit >= 3
    assert outcome.code == 0, outcome.said
    assert channels_recorded(outcome) == outcome.seen.channels
    assert float(outcome.points()[0]["voltage_V"]) > 10.0


@pytest.mark.parametrize(("key", "value"), [(("speed",), "nan"), (("limit", "rpm"), "0")])
def test_a_number_out_of_its_range_ends_in_one_sentence(tmp_path, key, value):
    said: list[tuple[str, ...]] = []

    def lines(hello: Hello) -> list[tuple[str, ...]]:
        true = hello_lines(hello)
        said[:] = [(*key, value) if line[: len(key)] == key else line for line in true]
        assert said != list(true)
        return said

    with mock.patch("benchtool.virtual.server.hello_lines", lines):
        outcome = sweep(tmp_path, plan(), [])
    assert (*key, value) in said
    assert outcome.code == 3
    assert f"the device's hello is invalid: {' '.join(key)} is " in outcome.last_line
    assert "not a number from" in outcome.last_line
    assert max(us for _, us in outcome.pulses) == 1000.0
    assert not (tmp_path / "run").exists()
