"""A bench and a stage as one bench."""

import numpy as np
import pytest

from benchtool.bench.address import open_bench
from benchtool.bench.stage import DeviceStage
from benchtool.bench.staged_bench import StagedBench
from benchtool.errors import LinkLost, StageError


class FakeStage:
    """Take two seconds for every move and be off by a tenth of a millimetre."""

    def __init__(self):
        self.did = []
        self.failing = {}

    def _do(self, what):
        self.did.append(what)
        if error := self.failing.get(what):
            raise error

    def open(self):
        self._do("open")

    def close(self):
        self._do("close")

    def hold(self):
        self._do("hold")

    def move(self, z_m, x_m, tilt_rad, pause):
        self._do("move")
        for _ in range(20):
            pause(0.1)
        return z_m + 1e-4


@pytest.fixture
def stage():
    return FakeStage()


@pytest.fixture
def bench(stage):
    return StagedBench(open_bench("sim:pquad_single"), stage)


def column(bench, readings, name):
    names = [channel.name for channel in bench.identity.channels]
    assert names.count(name) == 1
    return readings.values[:, names.index(name)]


def test_the_plate_is_told_once_and_no_sample_is_lost(bench, stage):
    with bench:
        bench.read(1.0)
        bench.move_plate(0.3, 0.02, 0.1)
        readings = bench.read(0.5)
        later = bench.read(0.5)
    assert readings.values.shape[1] == len(bench.identity.channels)
    assert len(readings) == 500
    assert np.all(np.diff(readings.time_s) < 0.0051)
    for name, value in (("plate_z_m", 0.3001), ("plate_x_m", 0.02), ("plate_tilt_deg", 5.7296)):
        shown = column(bench, readings, name)
        assert np.flatnonzero(~np.isnan(shown)).tolist() == [400]
        assert shown[400] == pytest.approx(value, abs=1e-4)
        assert np.isnan(column(bench, later, name)).all()
    assert stage.did == ["open", "move", "close"]


def test_stop_zeroes_the_motors_and_holds_the_stage_even_if_one_fails(bench, stage):
    with bench:
        bench.set_pwm(np.array([1400.0]))
        stage.failing = {"hold": LinkLost("stage unplugged")}
        with pytest.raises(LinkLost):
            bench.stop()
        assert np.all(column(bench, bench.read(1.0), "pwm1_us") == 1000.0)
        stage.failing = {}
    assert stage.did == ["open", "hold", "close"]


def test_a_stage_that_refuses_leaves_the_plate_unknown(bench, stage):
    stage.failing = {"move": StageError("no")}
    with bench:
        with pytest.raises(StageError):
            bench.move_plate(0.3)
        assert np.isnan(column(bench, bench.read(0.1), "plate_z_m")).all()


def test_a_bench_that_cannot_be_opened_lets_the_stage_go(stage):
    bench = StagedBench(open_bench("tcp:127.0.0.1:1"), stage)
    with pytest.raises(Exception, match=r"127\.0\.0\.1:1"):
        bench.open()
    assert stage.did == ["open", "close"]


def test_a_device_may_be_its_own_stage():
    device = open_bench("sim:pquad_single")
    with device:
        reached_m = DeviceStage(device).move(0.9, 0.0, 0.0, lambda duration_s: None)
        shown = device.read(0.1)
    names = [channel.name for channel in device.identity.channels]
    assert reached_m == shown.values[-1, names.index("plate_z_m")] == 0.9
