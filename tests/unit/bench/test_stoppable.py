from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchtool.bench.drivers import open_bench
from benchtool.bench.guard import GuardedBench
from benchtool.bench.serial.bench import SerialBench
from benchtool.bench.stop_requests import StoppableBench, StopRequested
from benchtool.core.errors import LinkLost
from benchtool.core.rig_file import load_rig_by_name
from benchtool.virtual.firmware import Firmware
from tests.doubles.loopback_link import LoopbackLink
from tests.unit.acquire.fake_bench import FakeBench
from tests.wire.still_plant import StillPlant, still_hello


class Haltable(FakeBench):
    """A bench that can be stopped from any thread, and note it."""

    def __init__(self, error: Exception | None = None) -> None:
        super().__init__()
        self.halts = 0
        self.error = error

    def halt(self) -> None:
        self.halts += 1
        if self.error is not None:
            raise self.error


def test_zero_goes_out_at_once_and_the_owner_hears_it_once():
    bench = Haltable()
    stoppable = StoppableBench(bench)
    stoppable.request_stop("stopped by me")
    assert bench.halts == 1
    with pytest.raises(StopRequested, match="stopped by me; zero was commanded"):
        stoppable.read(0.1)
    assert len(stoppable.read(0.1)) > 0


@pytest.mark.parametrize("call", ["pwm", "plate", "tare"])
def test_nothing_is_commanded_after_a_request(call):
    bench = FakeBench()
    stoppable = StoppableBench(bench)
    stoppable.request_stop("stopped")
    orders: dict[str, Callable[[], None]] = {
        "pwm": lambda: stoppable.set_pwm(np.array([1500.0])),
        "plate": lambda: stoppable.move_plate(0.2),
        "tare": stoppable.tare,
    }
    before = len(bench.log)
    with pytest.raises(StopRequested):
        orders[call]()
    assert len(bench.log) == before


def test_a_pulse_that_crosses_the_request_is_taken_back():
    class Crossing(FakeBench):
        def set_pwm(self, pwm_us: object) -> None:
            stoppable.request_stop("stopped")
            super().set_pwm(pwm_us)

    bench = Crossing()
    stoppable = StoppableBench(bench)
    with pytest.raises(StopRequested):
        stoppable.set_pwm(np.array([1500.0]))
    assert bench.log[-1][0] == "stop"


@pytest.mark.parametrize("order", ["pwm", "plate"])
def test_an_order_that_a_stopped_device_refuses_is_a_stop_and_no_refusal(order):
    plant = StillPlant()
    firmware = Firmware(plant, still_hello())
    link = LoopbackLink(firmware, lambda: plant.rate_Hz)
    driver = SerialBench(link, "serial:loop", clock=link.clock)
    stoppable = StoppableBench(driver)
    with stoppable:
        driver._arm()
        take = link.write

        def halt_before(data: bytes) -> None:
            """Let another thread stop in the moment in which the order is sent."""
            link.write = take  # type: ignore[method-assign]
            stoppable.request_stop("stopped")
            take(data)

        link.write = halt_before  # type: ignore[method-assign]
        orders: dict[str, Callable[[], None]] = {
            "pwm": lambda: stoppable.set_pwm(np.array([1300.0, 1300.0])),
            "plate": lambda: stoppable.move_plate(0.2),
        }
        with pytest.raises(StopRequested):
            orders[order]()
        assert plant.pwm_us.max() == 1000.0
        assert not plant.plate_moving
        # What the owner orders after that is an order of its own.
        stoppable.set_pwm(np.array([1300.0, 1300.0]))
        assert plant.pwm_us.max() == 1300.0


def test_a_link_that_is_gone_does_not_hide_the_request():
    stoppable = StoppableBench(Haltable(LinkLost("gone")))
    stoppable.request_stop("stopped")
    with pytest.raises(StopRequested):
        stoppable.read(0.1)


def test_a_request_does_not_end_a_guarded_bench_for_good():
    stoppable = StoppableBench(open_bench("sim:pquad_single"))
    with GuardedBench(stoppable, load_rig_by_name("pquad_single")) as bench:
        bench.set_pwm(np.array([1400.0]))
        stoppable.request_stop("stopped")
        with pytest.raises(StopRequested):
            bench.read(0.1)
        bench.stop()
        bench.set_pwm(np.array([1300.0]))
        bench.read(0.1)
        assert bench.reason is None
