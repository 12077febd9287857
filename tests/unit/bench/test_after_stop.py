"""After a stop a bench is listened to for a moment, whatever state it is in."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.bench.after_stop import after_stop
from benchtool.bench.bench import Readings
from benchtool.bench.guard import GuardedBench
from benchtool.bench.simulated import SimulatedBench
from benchtool.errors import DeviceStopped, LimitExceeded
from benchtool.library import load_model, rig_named

RIG = rig_named("pquad_single")


def bench_of() -> SimulatedBench:
    return SimulatedBench("sim:pquad_single", RIG, load_model("single").model)


def test_the_rotor_is_seen_slowing_down() -> None:
    with bench_of() as bench:
        bench.set_pwm(np.array([1500.0]))
        bench.read(2.0)
        bench.stop()
        parts = list(after_stop(bench, 0.5))
        column = [channel.name for channel in bench.identity.channels].index("rpm1")
    rpm = np.concatenate([part.values[:, column] for part in parts])
    assert len(rpm) == 100
    assert rpm[0] > 1000.0 > 100.0 > rpm[-1]


def test_a_device_that_stopped_by_itself_is_heard_on() -> None:
    with bench_of() as bench:
        bench.tare()
        bench.set_limit("thrust_N", 1.0)
        bench.set_pwm(np.array([1500.0]))
        assert len(bench.read(1.0)) == 200
        # Not told yet: the first of its reads would raise, and that ends nothing.
        assert sum(map(len, after_stop(bench, 0.5))) >= 90
        with pytest.raises(DeviceStopped):
            bench.set_pwm(np.array([1500.0]))


def test_what_arrived_during_a_move_is_not_lost() -> None:
    with bench_of() as bench:
        before_s = bench.now_s()
        bench.move_plate(1.0)
        moved_s = bench.now_s() - before_s
        heard = sum(map(len, after_stop(bench, 0.1)))
    assert heard == pytest.approx((moved_s + 0.1) * 200.0, abs=1)


def test_a_closed_link_gives_nothing_and_raises_nothing() -> None:
    bench = bench_of()
    assert list(after_stop(bench, 0.5)) == []


def test_a_guard_that_listens_keeps_every_sample() -> None:
    with GuardedBench(bench_of(), RIG) as guard:
        for _ in range(10):
            guard.listen(0.05)
        assert len(guard.read(0.05)) == 110


def test_the_sample_that_broke_a_limit_is_kept_with_those_before_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = bench_of()
    truth = bench.read

    def spoiled(timeout_s: float) -> Readings:
        readings = truth(timeout_s)
        column = [channel.name for channel in bench.identity.channels].index("rpm1")
        readings.values[-1, column] = 1e6
        return readings

    with GuardedBench(bench, RIG) as guard:
        guard.listen(0.5)
        monkeypatch.setattr(bench, "read", spoiled)
        with pytest.raises(LimitExceeded):
            guard.read(0.1)
        kept = guard.take_kept()
    assert kept is not None
    assert len(kept) == 120
    assert kept.values[-1].max() == 1e6
