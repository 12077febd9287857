"""Every way out of a guarded bench ends at zero, once, with the reason kept and the link closed."""

# ruff: noqa: PT012 -- what happens on the way out needs the whole body inside `raises`

import os
import signal

import numpy as np
import pytest

from benchtool.bench.guard import GuardedBench
from benchtool.errors import DeviceStopped, LimitExceeded, LinkLost, RunStopped
from tests.unit.bench.guarded_fake import RIG, check_zeroed_once_then_closed


def test_a_normal_end_ramps_down_within_a_second(fake):
    with GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        guard.read(1.0)
        before_s = fake.clock_s
    pulses = [float(item.split()[1]) for item in fake.did if item.startswith("pwm")]
    assert pulses[0] == 1600.0
    assert pulses[-1] == 1000.0
    assert np.all(np.diff(pulses) < 0.0)
    assert len(pulses) > 8
    assert 0.5 < fake.clock_s - before_s <= 1.0
    check_zeroed_once_then_closed(fake)
    assert guard.reason is None


def test_the_samples_of_a_ramp_can_be_had(fake):
    taken = []
    with GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        guard.ramp_down(taken.append)
    assert sum(map(len, taken)) == 90


def test_an_error_in_the_body_commands_zero_at_once(fake):
    with pytest.raises(ZeroDivisionError), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        guard.read(0.5)
        _ = 1 / 0
    assert fake.did == ["open", "pwm 1600", "stop", "close"]
    assert guard.reason == "division by zero"


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"])
def test_a_signal_commands_zero_at_once_and_handlers_come_back(fake, name):
    if not hasattr(signal, name):
        pytest.skip(f"this system has no {name}")
    number = getattr(signal, name)
    if signal.getsignal(number) is signal.SIG_IGN:  # as under nohup, where a run goes on
        signal.signal(number, signal.SIG_DFL)
    before = signal.getsignal(number)
    with pytest.raises(RunStopped, match="zero was commanded"), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        signal.raise_signal(number)
        guard.read(60.0)
    assert fake.did == ["open", "pwm 1600", "stop", "close"]
    assert guard.reason.startswith("stopped b")
    assert signal.getsignal(number) is before


def test_a_signal_that_somebody_swallows_ends_the_run_at_the_next_call(fake):
    with pytest.raises(RunStopped), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        try:
            os.kill(os.getpid(), signal.SIGTERM)
        except Exception:  # noqa: BLE001
            pass
        guard.set_pwm(np.array([1700.0]))
    assert "pwm 1700" not in fake.did
    check_zeroed_once_then_closed(fake)


def test_a_signal_while_zero_is_being_commanded_cannot_interrupt_it(fake):
    plain_stop, plain_close = fake.stop, fake.close

    def stop():
        signal.raise_signal(signal.SIGINT)
        plain_stop()

    def close():
        signal.raise_signal(signal.SIGTERM)
        plain_close()

    fake.stop, fake.close = stop, close
    with pytest.raises(LimitExceeded), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        fake.spoil = lambda time_s, row: row | {"current_A": 500.0}
        guard.read(0.1)
    check_zeroed_once_then_closed(fake)
    assert guard.troubles == []


def test_a_signal_during_the_final_ramp_ends_it_at_zero(fake):
    def read(timeout_s, plain=fake.read):
        if fake.did[-1] == "pwm 1480":
            signal.raise_signal(signal.SIGTERM)
        return plain(timeout_s)

    fake.read = read
    with pytest.raises(RunStopped), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
    assert fake.did == ["open", "pwm 1600", "pwm 1540", "pwm 1480", "stop", "close"]
    assert guard.reason == "stopped by SIGTERM"


def test_an_ignored_signal_stays_ignored(fake):
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with GuardedBench(fake, RIG):
            assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
            assert signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize("error", [LinkLost("gone"), DeviceStopped("watchdog: no line")])
def test_a_lost_link_closes_and_keeps_the_reason(fake, error):
    with pytest.raises(type(error)), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        fake.failing = {"read": error, "stop": LinkLost("no answer"), "close": LinkLost("dead")}
        guard.read(0.1)
    check_zeroed_once_then_closed(fake)
    assert guard.reason == str(error)
    assert guard.troubles == [
        "commanding zero failed: no answer",
        "closing the link failed: dead",
    ]


def test_a_link_lost_on_a_command_counts_as_sent(fake):
    with pytest.raises(LinkLost), GuardedBench(fake, RIG) as guard:
        fake.failing = {"pwm": LinkLost("no acknowledgement")}
        guard.set_pwm(np.array([1600.0]))
    assert fake.did == ["open", "pwm 1600", "stop", "close"]


def test_a_bench_that_cannot_be_opened_is_closed_and_signals_come_back(fake):
    before = signal.getsignal(signal.SIGTERM)
    fake.failing = {"open": LinkLost("no")}
    with pytest.raises(LinkLost), GuardedBench(fake, RIG):
        pytest.fail("the body must not run")
    assert fake.did == ["open", "close"]
    assert signal.getsignal(signal.SIGTERM) is before


def test_after_a_stop_nothing_turns_the_motors_again(fake):
    with pytest.raises(RunStopped, match="open it anew"), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
        fake.spoil = lambda time_s, row: row | {"current_A": 500.0}
        with pytest.raises(LimitExceeded):
            guard.read(0.1)
        guard.set_pwm(np.array([1200.0]))
    assert fake.did == ["open", "pwm 1500", "stop", "close"]
