"""Every way out of a guarded bench ends at zero, once, with the reason kept and the link closed."""

# ruff: noqa: PT012 -- what happens on the way out needs the whole body inside `raises`

import os
import signal
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from benchtool.bench.guard import GuardedBench
from benchtool.bench.motor_state import FAILURES, SPIN_DOWN_S, STANDSTILL_TIMEOUT_S
from benchtool.bench.serial.command_channel import MAX_ATTEMPTS
from benchtool.bench.serial.command_channel import REPLY_TIMEOUT_S as TRY_S
from benchtool.core.errors import (
    DeviceStopped,
    HostSuspended,
    InputError,
    LimitExceeded,
    LinkLost,
    RunInterrupted,
    StandstillNotConfirmed,
)
from benchtool.core.rig_file import load_rig_by_name
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


def test_what_was_seen_of_rotors_is_said_before_the_guard_is_left(fake):
    with GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        guard.read(1.0)
        assert guard.standstill is None
        guard.stop()
        guard.read(0.5)
        assert guard.standstill.is_confirmed
        guard.set_pwm(np.array([1600.0]))
        assert guard.standstill is None


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"])
def test_a_signal_commands_zero_at_once_and_handlers_come_back(fake, name):
    if not hasattr(signal, name):
        pytest.skip(f"this system has no {name}")
    number = getattr(signal, name)
    if signal.getsignal(number) is signal.SIG_IGN:  # as under nohup, where a run goes on
        signal.signal(number, signal.SIG_DFL)
    before = signal.getsignal(number)
    with (
        pytest.raises(RunInterrupted, match="zero was commanded"),
        GuardedBench(fake, RIG) as guard,
    ):
        guard.set_pwm(np.array([1600.0]))
        signal.raise_signal(number)
        guard.read(60.0)
    assert fake.did == ["open", "pwm 1600", "stop", "close"]
    assert guard.reason.startswith("stopped b")
    assert signal.getsignal(number) is before


def test_a_signal_that_somebody_swallows_ends_the_run_at_the_next_call(fake):
    with pytest.raises(RunInterrupted), GuardedBench(fake, RIG) as guard:
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
    assert guard.cleanup_errors == []


def test_a_signal_during_the_final_ramp_ends_it_at_zero(fake):
    def read(timeout_s, plain=fake.read):
        if fake.did[-1] == "pwm 1480":
            signal.raise_signal(signal.SIGTERM)
        return plain(timeout_s)

    fake.read = read
    with pytest.raises(RunInterrupted), GuardedBench(fake, RIG) as guard:
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


def test_a_run_in_the_background_is_stopped_by_the_other_signals(fake):
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a shell leaves it behind `&`
    try:
        with pytest.raises(RunInterrupted, match="SIGTERM"), GuardedBench(fake, RIG) as guard:
            guard.set_pwm(np.array([1600.0]))
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGTERM)
            guard.read(1.0)
    finally:
        signal.signal(signal.SIGINT, before)
    check_zeroed_once_then_closed(fake)


def test_a_motor_that_ignores_the_end_is_said_and_commanded_again(fake):
    fake.tail_rpm = 0.0

    def ignored(pwm_us=None):
        fake.did.append("ignored")

    with pytest.raises(StandstillNotConfirmed) as ended, GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        guard.read(1.0)
        fake.set_pwm = fake.stop = ignored
        before_s = fake.clock_s
    assert str(ended.value).startswith("MOTORS MAY STILL TURN: rpm1 55")
    assert "cut the power" in str(ended.value)
    assert ended.value.rpm == pytest.approx(5515.0, abs=5.0)
    assert ended.value.exit_code == 8
    # The ramp of 0.9 s, its stop, one each second of the spin-down time, and one at its end.
    assert fake.did.count("ignored") == 10 + 1 + 3 + 1
    assert SPIN_DOWN_S <= fake.clock_s - before_s <= SPIN_DOWN_S + 1.0
    assert fake.did[-1] == "close"


def test_whoever_reads_on_after_a_stop_hears_of_a_rotor_that_goes_on(fake):
    def ignored():
        fake.did.append("ignored")

    turning = pytest.raises(
        StandstillNotConfirmed, match=r"MOTORS MAY STILL TURN: rpm1 55.* 4\.[01] s"
    )
    with turning as ended, GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        guard.read(1.0)
        guard.check_standstill()
        fake.stop = ignored
        guard.stop()
        for _ in range(60):
            guard.read(0.1)
            guard.check_standstill()
    assert ended.value.__cause__ is None
    # Said at once, and not looked for a second time.
    assert fake.did.count("ignored") == 2
    assert fake.clock_s == pytest.approx(5.1, abs=0.11)


@pytest.mark.parametrize("delay_s", [0.3, 2.5])
def test_where_orders_may_come_late_rotors_are_watched_for_longer_than_that(fake, delay_s):
    fake.identity = replace(fake.identity, longest_delay_s=delay_s)
    with GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        guard.read(0.5)
        guard.stop()
        stopped_s = fake.clock_s
    assert fake.clock_s - stopped_s == pytest.approx(delay_s + STANDSTILL_TIMEOUT_S, abs=0.01)


def test_an_order_that_comes_after_the_stop_is_seen_and_stopped(fake):
    fake.identity = replace(fake.identity, longest_delay_s=1.0)
    stop, read = fake.stop, fake.read

    def late(timeout_s):
        if fake.did.count("stop") == 1 and fake.clock_s > fake.stopped_s + 0.7:
            fake.tail_rpm = 3000.0
        return read(timeout_s)

    def stopping():
        fake.tail_rpm = 0.0
        stop()

    with GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        guard.read(0.5)
        fake.read, fake.stop = late, stopping
    assert fake.did.count("stop") == 2
    assert guard.standstill.is_confirmed


def test_a_driver_that_breaks_while_it_is_looked_hides_no_reason(fake):
    read = fake.read

    def breaking(timeout_s):
        if "stop" in fake.did:
            raise ValueError("a bug of a driver")
        return read(timeout_s)

    said = "no reading came after zero .* the run ended because: current_A read 500, limit"
    with (
        pytest.raises(StandstillNotConfirmed, match=said) as ended,
        GuardedBench(fake, RIG) as guard,
    ):
        guard.set_pwm(np.array([1600.0]))
        guard.read(1.0)
        fake.read = breaking
        fake.spoil = lambda time_s, row: row | {"current_A": 500.0}
        guard.read(0.1)
    assert isinstance(ended.value.__cause__, LimitExceeded)
    assert fake.did[-1] == "close"


def test_another_rig_than_the_device_has_is_refused(fake):
    with pytest.raises(InputError, match="has 4, bench fake: has 1"):
        GuardedBench(fake, load_rig_by_name("pquad")).__enter__()
    assert fake.did == ["open", "close"]


def test_the_plate_waits_for_rotors_that_still_turn_and_keeps_what_is_read(fake):
    fake.tail_rpm = 3000.0

    def slowing(time_s, row):
        fake.tail_rpm = max(0.0, 3000.0 - 2000.0 * time_s)
        return row

    fake.spoil = slowing
    with GuardedBench(fake, RIG) as guard:
        guard.move_plate(0.5)
        waited_s = fake.clock_s
        readings = guard.read(0.1)
    assert 1.3 < waited_s < 1.6
    assert len(readings) == round(waited_s * 100) + 10


SAID = "was not running for 2.0 s, limit 0.25 s"


def test_what_a_pause_made_the_device_say_is_its_cause_and_no_more(fake):
    read = fake.read

    def late(timeout_s):
        fake.clock_s += timeout_s + 2.0
        fake.read = read
        raise DeviceStopped("watchdog: no line")

    with pytest.raises(HostSuspended, match=SAID) as ended, GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
        guard.read(1.0)
        fake.read = late
        guard.read(0.1)
    assert isinstance(ended.value.__cause__, DeviceStopped)


def test_late_readings_are_kept_and_blame_no_motor(fake):
    read = fake.read

    def late(timeout_s):
        fake.clock_s += 2.0
        return read(timeout_s)

    with pytest.raises(HostSuspended, match=SAID), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
        guard.read(1.0)
        fake.spoil = lambda time_s, row: row | {"rpm1": 0.0}
        fake.read = late
        guard.read(0.1)
    assert len(guard.pop_unread()) == 10


@pytest.mark.parametrize(
    ("given", "lasts_s", "paused"),
    [
        # `where`, `arm` and `pwm`, each answered at its last try.
        ({}, 3.0 * MAX_ATTEMPTS * TRY_S, False),
        ({}, 1.74, False),
        ({}, 1.76, True),
        ({"longest_delay_s": 0.1}, 6.24, False),
        ({"longest_delay_s": 0.1}, 6.26, True),
        ({"has_loop": True}, 6.24, False),
    ],
)
def test_a_command_may_take_as_long_as_its_answers(fake, given, lasts_s, paused):
    fake.identity = replace(fake.identity, **given)
    set_pwm = fake.set_pwm

    def slow(pwm_us):
        fake.set_pwm = set_pwm
        fake.clock_s += lasts_s
        set_pwm(pwm_us)

    fake.set_pwm = slow
    ends = pytest.raises(HostSuspended) if paused else nullcontext()
    with ends, GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
    assert fake.did[:3] == ["open", "pwm 1500", "stop" if paused else "pwm 1450"]


@pytest.mark.parametrize("reads", [False, True])
def test_a_host_with_an_early_answer_may_not_pause_for_the_rest(fake, reads):
    read = fake.read
    with (
        pytest.raises(HostSuspended, match=r"0\.3 s, limit 0\.25 s"),
        GuardedBench(fake, RIG) as guard,
    ):
        guard.set_pwm(np.array([1500.0]))
        if reads:
            fake.read = lambda timeout_s: read(0.01)
            guard.read(1.0)
        fake.clock_s += 0.3
        guard.read(0.01)
    check_zeroed_once_then_closed(fake)


def test_a_read_that_fails_once_does_not_end_the_look_at_the_rotors(fake):
    read = fake.read

    def once(timeout_s):
        fake.read = read
        raise LinkLost("gone for a moment")

    with GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        guard.read(0.5)
        guard.stop()
        fake.read = once
    assert guard.standstill.is_confirmed


@pytest.mark.parametrize("good", [0, 2])
def test_reads_that_fail_in_a_row_end_the_look_and_each_commands_zero(fake, good):
    read, left = fake.read, [good]

    def failing(timeout_s):
        if not left[0]:
            raise LinkLost("gone")
        left[0] -= 1
        return read(timeout_s)

    with pytest.raises(StandstillNotConfirmed), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        guard.read(0.5)
        guard.stop()
        fake.tail_rpm, fake.read = 3000.0, failing
    assert fake.did.count("stop") == 2 + FAILURES + 1  # at the end, and that nothing was seen


def test_rotors_that_are_driven_are_commanded_zero_before_they_are_looked_at(fake):
    with GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        guard.read(0.5)
        assert guard.stop_and_check_standstill().is_confirmed
        assert guard.pwm_us.tolist() == [RIG.propulsion.pwm_stop_us]
        assert fake.did == ["open", "pwm 1600", "stop"]


def test_a_rotor_that_runs_out_while_the_bench_is_opened_is_no_fault(fake):
    fake.clock_s, fake.tail_rpm = 1000.0, 3000.0
    with GuardedBench(fake, RIG) as guard:
        guard.read(0.5)
        fake.tail_rpm = 0.0
        guard.read(0.5)
    assert guard.reason is None


def test_limits_are_tightened_and_widened_again_up_to_the_rigs(fake):
    stated = RIG.limits
    with GuardedBench(fake, RIG) as guard:
        for looser in (
            replace(stated, rpm=stated.rpm + 1.0),
            replace(stated, voltage_min_V=stated.voltage_min_V - 0.1),
        ):
            with pytest.raises(InputError, match="is looser than the rig's"):
                guard.tighten_limits(looser)
        guard.tighten_limits(replace(stated, pwm_us=1500.0))
        with pytest.raises(InputError, match="limit of 1500 us"):
            guard.set_pwm(np.array([1600.0]))
        guard.tighten_limits(stated)
        guard.set_pwm(np.array([1600.0]))
        guard.read(1.0)


def test_a_reading_beyond_a_tightened_limit_stops_the_motors(fake):
    with pytest.raises(LimitExceeded, match="rpm1"), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1600.0]))
        guard.read(1.0)
        guard.tighten_limits(replace(RIG.limits, rpm=10.0))
        guard.read(1.0)
    check_zeroed_once_then_closed(fake)
