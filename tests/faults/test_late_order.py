"""An order that the link delivers after the host's stop turns nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.faults.loop import Outcome, plan, sweep
from tests.faults.proxy import Fault


def stops_after_turning(outcome: Outcome) -> list[float]:
    turned_s = outcome.seen.phases["ramping"]
    return [s for s, words in outcome.seen.commands if words == "stop" and s > turned_s]


def test_a_pulse_that_comes_after_the_stop_is_refused(tmp_path: Path) -> None:
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


@pytest.mark.parametrize("seed", range(3))
def test_a_line_that_stalls_and_pours_turns_nothing_again(tmp_path: Path, seed: int) -> None:
    stall = Fault("stall", phase="ramping", after_s=0.02 * seed, for_s=2.0)
    outcome = sweep(tmp_path, plan("1.36, 1.32"), [stall])
    assert stall.hit >= 5
    assert stall.begun_s is not None
    assert outcome.code != 0
    # The watchdog stopped the motors in the silence; what pours in then is too old.
    assert outcome.orders_to_turn_after(stall.begun_s + 0.35) == []
    assert outcome.standing_at() is not None


def test_orders_that_come_twice_are_carried_out_once(tmp_path: Path) -> None:
    twice = Fault("duplicate", phase="connect", way="device")
    outcome = sweep(tmp_path, plan(), [twice])
    assert twice.hit > 20
    assert (outcome.code, outcome.metadata["state"]) == (0, "ended"), outcome.said
    assert len(outcome.points()) == 1


def test_a_line_with_a_round_trip_of_300_ms_is_driven(tmp_path: Path) -> None:
    slow = Fault("delay", phase="connect", delay_s=0.15)
    outcome = sweep(tmp_path, plan(), [slow])
    assert slow.hit > 500
    assert outcome.code == 0, outcome.said
    assert len(outcome.points()) == 1
