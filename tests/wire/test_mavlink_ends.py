"""What ends a run behind an autopilot, and what does not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from benchtool.bench.guard import GuardedBench
from benchtool.bench.mavlink.bench import MavlinkBench
from benchtool.bench.mavlink.frames import MavlinkFrames
from benchtool.bench.mavlink.settings import MavlinkSettings, MotorMap
from benchtool.core.errors import (
    BenchError,
    DeviceStopped,
    HostSuspended,
    LinkLost,
)
from benchtool.core.rig_file import load_rig_by_name
from benchtool.virtual.autopilot import VirtualAutopilot
from tests.doubles.loopback_link import LoopbackLink
from tests.wire.autopilot_bench import PLUS, Bench, pulses


def test_an_order_is_renewed_while_somebody_reads_and_dies_when_nobody_does():
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        made.read(2.0)
        assert max(made.autopilot.outputs_us) == 1300
        made.link.pass_time(0.2)
        assert max(made.autopilot.outputs_us) == 1300
        made.link.pass_time(0.1)
        assert max(made.autopilot.outputs_us) == 1000
        # The order is too old to be sent again: it would start a motor that stands.
        with pytest.raises(HostSuspended, match=r"was not running for 0\.\d s, limit 0\.25 s"):
            made.read(1.0)
        made.read(1.0)
        assert max(made.autopilot.outputs_us) == 1000


@pytest.mark.parametrize(
    ("again", "lost_s", "said"),
    [
        (True, 0.6, "did not acknowledge a motor command in 0.2 s"),
        (False, 0.3, r"acknowledged no command for 0.\d s and output 3 shows 1000 us"),
    ],
    ids=["new order", "renewed"],
)
def test_an_order_that_gets_lost_starts_no_motor_that_stands_by_then(again, lost_s, said):
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        made.read(1.0)
        write, until_s = made.link.write, made.link.now_s + lost_s
        shown: list[int] = []

        def carry(data: bytes) -> None:
            shown.append(max(made.autopilot.outputs_us))
            if made.link.now_s >= until_s:
                write(data)

        made.link.write = carry  # type: ignore[method-assign]
        with pytest.raises(BenchError, match=said):
            bench.set_pwm(pulses(1250.0, 1000.0)) if again else made.read(2.0)
        made.link.pass_time(0.5)
        carry(b"")
        assert set(shown[shown.index(1000) :]) == {1000}


def test_an_order_is_as_old_as_when_it_was_sent_however_late_it_was_acknowledged():
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        write = made.link.write

        def carry_slowly(data: bytes) -> None:
            write(data)
            made.link.pass_time(0.15)

        made.link.write = carry_slowly  # type: ignore[method-assign]
        bench.set_pwm(pulses(1300.0, 1000.0))
        made.link.write = write  # type: ignore[method-assign]
        made.link.pass_time(0.12)
        assert max(made.autopilot.outputs_us) == 1000
        with pytest.raises(HostSuspended, match=r"was not running for 0\.3 s, limit 0\.25 s"):
            made.read(1.0)
        assert max(made.autopilot.outputs_us) == 1000


def test_no_order_is_sent_after_a_pause_while_its_acknowledgement_was_waited_for():
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        send, sent = made.link.write, []

        def lose_and_stand_still(data: bytes) -> None:
            """Lose the first order; the computer is suspended while its answer is waited for."""
            sent.append(data)
            if len(sent) == 1:
                made.link.pass_time(2.0)

        made.link.write = lose_and_stand_still  # type: ignore[method-assign]
        with pytest.raises(HostSuspended, match=r"was not running for 2\.0 s, limit 0\.25 s"):
            bench.set_pwm(pulses(1300.0, 1000.0))
        assert len([data for data in sent if data[7:10] == b"L\0\0"]) == 1  # COMMAND_LONG
        made.link.write = send  # type: ignore[method-assign]
        bench.stop()
        made.read(1.0)
        assert max(made.autopilot.outputs_us) == 1000


def test_an_order_that_is_acknowledged_and_ignored_ends_the_run():
    ninth = MotorMap(rig="two", autopilot="ArduPilot", motors=(9, 2), outputs=(3, 1), escs=(3, 1))
    made = Bench(motor_map=ninth)
    said = r"commanded 1300 us and ArduPilot acknowledged it, but output 3 shows 1000 us after 0\.3"
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        begun_s = bench.now_s()
        with pytest.raises(DeviceStopped, match=said):
            made.read(2.0)
        assert bench.now_s() - begun_s < 0.4
        made.read(0.2)  # told once; afterwards it reads on


def restart(made: Bench) -> None:
    made.autopilot.restart(made.link.now_s)


def overload(made: Bench) -> None:
    made.autopilot.firmware._plant.zero_N = -1000.0


def disarm(made: Bench) -> None:
    order = MavlinkFrames(250)._mav.command_long_encode(1, 1, 400, 0, 0, 21196, 0, 0, 0, 0, 0)
    made.autopilot.receive(MavlinkFrames(250).pack(order), made.link.now_s)
    made.link.pass_time(0.02)
    assert max(made.autopilot.outputs_us) == 1300


def lose_orders(made: Bench) -> None:
    made.autopilot.receive = lambda data, now_s: b""


def hush(made: Bench) -> None:
    lose_orders(made)
    made.autopilot.tick = lambda n, now_s: (b"", [])


OVERLOAD = "Failsafe: thrust_N 100.* against limit 30; motors stopped"
LOST = r"ArduPilot acknowledged no command for 0\.\d s and output 3 shows 1000 us"
ENDS: dict[str, tuple[Callable[[Bench], None], type[BenchError], str]] = {
    "a restart": (restart, BenchError, r"the autopilot restarted|sent nothing for 1\.0 s"),
    "a failsafe, with its words": (overload, DeviceStopped, OVERLOAD),
    "disarming": (disarm, DeviceStopped, "the autopilot disarmed"),
    "orders that get lost, which are no disarming": (lose_orders, DeviceStopped, LOST),
    "missing heartbeats though streams go on": (
        *(lambda made: setattr(made.autopilot, "_beat_s", 1e9), LinkLost),
        r"sends, but no heartbeat came for 5\.\d s, limit 5\.5 s",
    ),
    "silence": (hush, LinkLost, r"sent nothing for 1\.0 s, limit 1 s"),
}


@pytest.mark.parametrize("cause", ENDS)
def test_what_ends_a_run_leaves_motors_at_zero(cause):
    break_it, kind, said = ENDS[cause]
    made = Bench(motor_map=PLUS)
    made.link.pass_time(5.0)
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        made.read(0.9)
        break_it(made)
        with pytest.raises(kind, match=said):
            made.read(8.0)
        VirtualAutopilot.tick(made.autopilot, 1, made.link.now_s + 0.3)
        assert max(made.autopilot.outputs_us) in (0, 1000)


class LossyLink(LoopbackLink):
    """Lose a share of the frames of both directions."""

    def __init__(self, device: VirtualAutopilot, share: float, rng: np.random.Generator) -> None:
        super().__init__(device, lambda: 100.0)
        self.share, self._rng = share, rng

    def write(self, data: bytes) -> None:
        if self._rng.random() >= self.share:
            super().write(data)

    def read(self, timeout_s: float) -> bytes:
        data, kept = super().read(timeout_s), b""
        while data:
            size = 12 + data[1]
            if self._rng.random() >= self.share:
                kept += data[:size]
            data = data[size:]
        return kept


def test_a_link_that_loses_every_tenth_frame_ends_no_run(rng):
    made = Bench(motor_map=PLUS)
    made.link = LossyLink(made.autopilot, 0.0, rng)
    made.bench = MavlinkBench(
        made.link, "mavlink:lossy", MavlinkSettings(motor_map=PLUS), clock=made.link.clock
    )
    with made.bench as bench:
        made.link.share = 0.1
        lost = 0
        for pulse_us in (1300.0, 1000.0, 1400.0):
            bench.set_pwm(pulses(pulse_us, 1000.0))
            until_s = bench.now_s() + 10.0
            while bench.now_s() < until_s:
                lost += bench.read(0.05).lost
                assert made.autopilot.outputs_us[2] == pulse_us
        assert lost > 100
        assert made.autopilot.outputs_us[2] == 1400


def test_another_motor_waits_until_the_outputs_show_the_stop_of_the_first():
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        made.read(0.5)
        bench.set_pwm(pulses(1000.0, 1400.0))
        made.read(0.5)
        assert made.autopilot.outputs_us[:4] == (1400, 1000, 1000, 1000)
        # A stop that is acknowledged and not carried out lets nothing else turn.
        order = made.autopilot._orders.order
        made.autopilot._orders.order = lambda command, given, now_s: (
            0 if given[3] == 0.0 else order(command, given, now_s)
        )
        made.autopilot._orders.end = lambda: None
        with pytest.raises(DeviceStopped, match="outputs do not show it after 1 s; no motor was"):
            bench.set_pwm(pulses(1300.0, 1000.0))
        assert made.autopilot.outputs_us[2] == 1000


def answer_late(made: Bench, delay_s: float) -> None:
    """Let every answer come so much later than the order is carried out."""
    receive, tick = made.autopilot.receive, made.autopilot.tick
    waiting: list[tuple[float, bytes]] = []

    def late_receive(data: bytes, now_s: float) -> bytes:
        waiting.append((now_s + delay_s, receive(data, now_s)))
        return b""

    def late_tick(n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        ready = [answer for due_s, answer in waiting if due_s <= now_s]
        waiting[:] = [one for one in waiting if one[0] > now_s]
        news, samples = tick(n, now_s)
        return b"".join(ready) + news, samples

    made.autopilot.receive, made.autopilot.tick = late_receive, late_tick


@pytest.mark.parametrize("delay_s", [0.7, 2.5])
def test_a_late_acknowledgement_alone_ends_nothing(delay_s):
    made = Bench(rotors=1)
    with GuardedBench(made.bench, load_rig_by_name("pquad_single")) as guard:
        assert guard.identity.longest_delay_s == pytest.approx(0.3)
        answer_late(made, delay_s)
        guard.set_pwm(pulses(1000.0))
        assert guard.identity.longest_delay_s == pytest.approx(delay_s, abs=0.1)
        made.bench.set_pwm(pulses(1300.0))
        made.read(2.0)
        assert made.autopilot.outputs_us[2] == 1300


@pytest.mark.parametrize("mode", ["plate", "pitch"])
def test_only_orders_that_lapse_end_by_a_short_silence(mode):
    made = Bench(rotors=1, mode=mode, arm="host")
    made.autopilot._hover_us = 1300.0
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0))
        made.read(1.0)
        tick = made.autopilot.tick
        begun_s = made.link.now_s

        def silent(n: int, now_s: float) -> tuple[bytes, list[bytes]]:
            said = tick(n, now_s)
            return said if now_s - begun_s > 0.6 else (b"", [])

        receive = made.autopilot.receive

        def deaf(data: bytes, now_s: float) -> bytes:
            said = receive(data, now_s)
            return said if now_s - begun_s > 0.6 else b""

        made.autopilot.tick, made.autopilot.receive = silent, deaf
        if mode == "plate":
            with pytest.raises(DeviceStopped, match=r"autopilot sent nothing for 0\.\d s while a"):
                made.read(0.9)
        else:
            made.read(0.9)
