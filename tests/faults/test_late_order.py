"""An order that the link delivers after the host's stop turns nothing."""

from __future__ import annotations

import pytest

from tests.faults.loop import Outcome, World, plan, sweep
from tests.faults.proxy import Fault


def stops_after_turning(outcome: Outcome) -> list[float]:
    turned_s = outcome.seen.phases["ramping"]
    return [s for s, words in outcome.seen.commands if words == "stop" and s > turned_s]


def test_a_pulse_that_comes_after_the_stop_is_refused(tmp_path):
    late = Fault("delay", phase="ramping", way="device", only=",pwm,", delay_s=0.9, skip=4)
    outcome = sweep(tmp_path, plan("1.36, 1.32"), [late])
    assert late.hit >= 5
    assert outcome.code == 3, outcome.said
    stopped_s = stops_after_turning(outcome)[0]
    # The late line came, at a device that the stop had reached before.
    assert any(s > stopped_s and "late: " in reason for s, reason in outcome.seen.refused)
    assert outcome.orders_to_turn_after(stopped_s) == []
    zero_s = outcome.standing_at()
    assert zero_s is not None
    assert zero_s < stopped_s + 0.02


def test_the_age_of_an_order_alone_refuses_it(tmp_path):
    """Every command comes late, the stop as well, and heartbeats keep the watchdog quiet."""
    late = Fault("delay", phase="ramping", way="device", only="$C,", delay_s=0.55)
    outcome = sweep(tmp_path, plan(), [late])
    assert outcome.orders_to_turn_after(0.0) == []
    assert outcome.code == 3, outcome.said
    old = [s for s, reason in outcome.seen.refused if "ms old; limit 500 ms" in reason]
    stop_s = stops_after_turning(outcome)[0] + late.delay_s
    assert old
    assert old[0] < stop_s


@pytest.mark.parametrize("phase", ["ramping", "sampling"])
def test_a_host_that_was_suspended_says_so(tmp_path, phase):
    paused_s: list[float] = []

    def pause(world: World) -> None:
        """Let everything but the host go on for two seconds, as SIGSTOP does."""
        begun_s = world.proxy.seen.phases.get(phase)
        if not paused_s and begun_s is not None and world.now_s > begun_s + 0.02:
            paused_s.append(world.now_s)
            world.wait(2.0)

    outcome = sweep(tmp_path, plan(sample_s=30.0), [], hooks=[pause])
    assert paused_s
    assert outcome.code == 5
    last = outcome.said.strip().splitlines()[-1]
    assert "benchtool was not running for 2.0 s" in last
    assert "rpm1" not in last
    assert "benchtool was not running" in outcome.metadata["reason"]
    # Motors stood by the device's watchdog, and no order turned them again.
    assert not outcome.orders_to_turn_after(paused_s[0] + 0.3)


def test_a_pause_with_motors_at_zero_ends_nothing(tmp_path):
    paused_s: list[float] = []

    def pause(world: World) -> None:
        begun_s = world.proxy.seen.phases.get("tare")
        if not paused_s and begun_s is not None and world.now_s > begun_s + 0.02:
            paused_s.append(world.now_s)
            world.wait(0.6)

    outcome = sweep(tmp_path, plan(), [], hooks=[pause])
    assert paused_s
    assert outcome.code == 0, outcome.said


@pytest.mark.parametrize("paused_s", [0.252, 0.26, 0.3])
def test_a_stop_by_the_watchdog_blames_neither_motor_nor_channel(tmp_path, paused_s):
    """Samples of motors that stand arrive together with the device's word that it stopped them."""
    begun: list[float] = []

    def pause(world: World) -> None:
        sampling_s = world.proxy.seen.phases.get("sampling")
        if not begun and sampling_s is not None and world.now_s > sampling_s + 0.02:
            begun.append(world.now_s)
            world.wait(paused_s)

    outcome = sweep(tmp_path, plan(sample_s=30.0), [], hooks=[pause])
    assert begun
    assert outcome.code in (4, 5), outcome.said
    last = outcome.said.strip().splitlines()[-1]
    assert "watchdog: no line for" in last or "benchtool was not running" in last
    assert "not seen to stand" not in last
    assert not outcome.orders_to_turn_after(begun[0] + 0.3)
