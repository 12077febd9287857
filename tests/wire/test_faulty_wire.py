"""Host and device on a wire with faults, wired together in memory on a clock of their own."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.bench.serial.bench import SerialBench
from benchtool.bench.serial.commands import Reply, SendPlate
from benchtool.core.errors import CommandRefused, HostSuspended
from benchtool.virtual.faults import Fault, LinkFaults, parse_fault
from benchtool.virtual.firmware import Firmware
from tests.doubles.loopback_link import LoopbackLink
from tests.wire.still_plant import StillPlant, still_hello


def wired(*faults: Fault, seed: int = 1, **hello: object) -> tuple[SerialBench, LoopbackLink]:
    plant = StillPlant(200.0)
    firmware = Firmware(plant, still_hello(rate_Hz=200.0, **hello))
    rng = np.random.default_rng(seed)
    link = LoopbackLink(firmware, lambda: plant.rate_Hz, LinkFaults(faults, rng))
    return SerialBench(link, "serial:loop", clock=link.clock), link


def read_on(bench: SerialBench) -> None:
    """Read until something ends it."""
    while True:
        bench.read(0.1)


def test_nothing_is_lost_on_a_sound_wire():
    bench, link = wired()
    with bench:
        bench.set_pwm(np.array([1300.0, 1300.0]))
        rows, times_us = 0, [np.empty(0)]
        while link.now_s < 70.0:
            readings = bench.read(0.1)
            assert (readings.lost, readings.corrupt, readings.messages) == (0, 0, ())
            rows += len(readings)
            times_us.append(readings.device_time_us)
    assert rows == pytest.approx(70.0 * 200.0, abs=20)
    np.testing.assert_array_equal(np.diff(np.concatenate(times_us)), 5000.0)


@pytest.mark.parametrize("fault", [parse_fault("corrupt:p=0.0005"), parse_fault("drop:p=0.0005")])
@pytest.mark.parametrize("seed", range(5))
def test_a_bad_wire_costs_samples_but_no_command(fault, seed):
    bench, link = wired(fault, seed=seed)
    with bench:
        for step in range(8):
            bench.move_plate(0.1 + 0.005 * (step % 2))
            bench.set_pwm(np.array([1300.0 + step, 1300.0]))
            assert link.device.firmware.pwm_us[0] == 1300.0 + step
            good = lost = 0
            for _ in range(20):
                readings = bench.read(0.1)
                good += len(readings)
                lost += readings.lost
                # Whatever is handed out is whole.
                assert set(readings.values[:, 4]) <= {12.0}
            assert good > lost
            bench.set_pwm(np.array([1000.0, 1000.0]))
    assert link.device.firmware.latched is None


def test_a_silence_shorter_than_a_second_is_lived_through():
    bench, link = wired(parse_fault("silence:at_s=1,for_s=0.6"))
    with bench:
        lost = 0
        while link.now_s < 3.0:
            lost += bench.read(0.1).lost
    assert lost == pytest.approx(120, abs=2)


def assert_pause_is_named(bench: SerialBench, link: LoopbackLink) -> None:
    with pytest.raises(HostSuspended, match=r"was not running for 2\.0 s, limit 0\.5 s"):
        bench.set_pwm(np.array([1400.0, 1400.0]))
    assert link.device.firmware.pwm_us.max() == 1000.0


def test_an_order_that_a_pause_of_the_host_made_old_is_refused_and_the_pause_is_named():
    bench, link = wired()
    with bench:
        bench.set_pwm(np.array([1300.0, 1300.0]))
        bench.set_pwm(np.array([1000.0, 1000.0]))
        send = link.write

        def stand_still(data: bytes) -> None:
            """Let the computer be suspended between building the line and sending it."""
            link.write = send  # type: ignore[method-assign]
            link.pass_time(2.0)
            send(data)

        link.write = stand_still  # type: ignore[method-assign]
        assert_pause_is_named(bench, link)


def test_an_order_that_the_pause_of_a_host_made_old_while_it_asked_for_the_time():
    bench, link = wired()
    with bench:
        bench.stop()
        link.pass_time(1.0)
        link.read(0.0)  # What was streamed meanwhile is gone, so that the time must be asked for.
        send = link.write

        def stand_still(data: bytes) -> None:
            """Let the computer be suspended when the device has told its time."""
            send(data)
            if b",where" in data:
                link.write = send  # type: ignore[method-assign]
                told = link._answer
                link.pass_time(2.0)
                link._answer = told

        link.write = stand_still  # type: ignore[method-assign]
        assert_pause_is_named(bench, link)


def read_all(bench: SerialBench, link: LoopbackLink) -> None:
    """Read until nothing is left that came before."""
    begun_s = link.now_s
    while link.now_s == begun_s:
        bench.read(0.1)


def behind(link: LoopbackLink) -> None:
    """Let the computer be suspended for 2 s and then read what waited in small blocks."""
    link.pass_time(2.0)

    def some(timeout_s: float) -> bytes:
        link.pass_time(1e-4 if link._answer else max(min(timeout_s, 0.005), 1e-6))
        data, link._answer = link._answer[:1000], link._answer[1000:]
        return data

    link.read = some  # type: ignore[method-assign]


def test_the_plate_moves_although_samples_from_before_a_pause_were_read_just_now():
    bench, link = wired(speed=20.0)
    with bench:
        bench.set_pwm(np.array([1000.0, 1000.0]))
        bench.move_plate(0.2)
        read_all(bench, link)
        behind(link)
        bench.read(0.1)
        bench.move_plate(0.3)
        assert bench.read(0.1).values[-1, 3] == pytest.approx(0.3)


def test_a_pause_before_an_order_to_turn_is_named_where_only_old_samples_were_read():
    bench, link = wired()
    with bench:
        bench.set_pwm(np.array([1300.0, 1300.0]))
        bench.set_pwm(np.array([1000.0, 1000.0]))
        read_all(bench, link)
        behind(link)
        bench.read(0.1)
        assert_pause_is_named(bench, link)


def test_a_plate_order_that_the_link_delivers_late_is_no_fault_of_the_stage():
    bench, _ = wired()
    with bench:
        bench.move_plate(0.2)
        refused = Reply(False, "late: 612 ms old; limit 500 ms")
        exchange = bench._channel.exchange
        bench._channel.exchange = (  # type: ignore[method-assign]
            lambda order, *more, **also: (
                refused if isinstance(order, SendPlate) else exchange(order, *more, **also)
            )
        )
        with pytest.raises(CommandRefused, match=r"612 ms old; .*; the link delivered it late"):
            bench.move_plate(0.3)
