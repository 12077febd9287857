"""Every sample of a guarded bench is held against its limits before anything else happens."""

# ruff: noqa: PT012 -- what happens on the way out needs the whole body inside `raises`

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from benchtool.bench.guard import GuardedBench
from benchtool.core.channel import Channel
from benchtool.core.errors import LimitExceeded, StandstillNotSeen
from tests.unit.bench.guarded_fake import RIG, check_zeroed_once_then_closed


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("thrust_N", 99.0, "limits.thrust_N"),
        ("thrust_N", -99.0, "limits.thrust_N"),
        ("rpm1", 99_000.0, "limits.rpm"),
        ("current_A", 500.0, "limits.current_A"),
        ("voltage_V", 2.0, "charge the battery"),
        ("temperature_degC", 200.0, "cool down"),
    ],
)
def test_one_sample_beyond_a_limit_stops_before_it_is_raised(fake, name, value, said):
    at_s = 0.37
    fake.spoil = lambda time_s, row: row | ({name: value} if abs(time_s - at_s) < 1e-6 else {})
    with pytest.raises(LimitExceeded, match=said) as caught, GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
        try:
            guard.read(1.0)
        finally:
            assert fake.did[-1] == "stop"
    assert caught.value.channel == name
    assert caught.value.value == value
    check_zeroed_once_then_closed(fake)
    kept = guard.take_unread()
    assert kept is not None
    assert len(kept) == 100


def test_thrust_that_rpm_does_not_explain_stops_after_a_while(fake):
    fake.spoil = lambda time_s, row: row | ({"rpm1": 0.0} if time_s > 1.0 else {})
    said = "not plausible for 0 rpm"
    with pytest.raises(StandstillNotSeen, match=said), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1900.0]))
        guard.read(1.5)
        guard.read(0.5)
    assert fake.stopped_s == pytest.approx(2.0)


def test_thrust_that_lags_behind_rpm_for_a_moment_is_no_fault(fake):
    late = {"thrust_N": 7.0}
    fake.spoil = lambda time_s, row: row | (late if 1.0 < time_s < 1.4 else {})
    with GuardedBench(fake, RIG) as guard:
        guard.read(3.0)
    assert guard.reason is None


@pytest.mark.parametrize(
    ("name", "after_s"), [("thrust_N", 1.0), ("rpm1", 1.0), ("voltage_V", 10.0)]
)
def test_a_channel_without_new_values_is_dead(fake, name, after_s):
    fake.spoil = lambda time_s, row: row | ({name: np.nan} if time_s > 2.0 else {})
    with pytest.raises(LimitExceeded, match=f"silence of {name}"), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
        for _ in range(200):
            guard.read(0.1)
    assert fake.stopped_s == pytest.approx(2.0 + after_s, abs=0.21)


def test_a_slow_channel_is_not_dead(fake):
    fake.spoil = lambda time_s, row: row | ({"thrust_N": np.nan} if time_s % 0.5 > 0.011 else {})
    with GuardedBench(fake, RIG) as guard:
        for _ in range(100):
            guard.read(0.1)
    assert guard.reason is None


def test_silence_while_nobody_read_is_no_fault_of_a_channel(fake):
    with GuardedBench(fake, RIG) as guard:
        guard.read(1.0)
        fake.clock_s += 60.0
        fake.spoil = lambda time_s, row: row | {"temperature_degC": np.nan}
        guard.read(1.0)
    assert guard.reason is None


def test_a_load_cell_that_repeats_itself_is_stuck(fake):
    fake.spoil = lambda time_s, row: row | ({"thrust_N": 2.0} if time_s > 1.0 else {})
    said = "shows 2 N all the time"
    with pytest.raises(LimitExceeded, match=said), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
        for _ in range(100):
            guard.read(0.1)
    assert fake.stopped_s == pytest.approx(4.0, abs=0.21)


def test_a_motor_that_does_not_follow_its_pulse_stops_the_run(fake):
    fake.spoil = lambda time_s, row: row | {"rpm1": 40.0, "thrust_N": 0.01 * (time_s % 0.02)}
    said = "rpm1 read 40, .* does not fit a pulse of 1500 us after 2"
    with pytest.raises(StandstillNotSeen, match=said), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
        for _ in range(100):
            guard.read(0.1)
    assert fake.stopped_s == pytest.approx(2.0, abs=0.11)


def test_a_motor_that_turns_without_a_command_stops_the_run(fake):
    fake.tail_rpm = 900.0
    fake.spoil = lambda time_s, row: row | {"thrust_N": 0.05 * np.sin(time_s * 99.0)}
    said = "rpm1 read 9.*, limit 300; .* a pulse of 1000 us"
    with pytest.raises(StandstillNotSeen, match=said), GuardedBench(fake, RIG) as guard:
        for _ in range(100):
            guard.read(0.1)
    assert fake.stopped_s == pytest.approx(5.0, abs=0.21)


@pytest.mark.parametrize(("has_loop", "facts"), [(True, {}), (False, {"mode": "pitch"})])
def test_only_the_typed_field_says_that_a_loop_makes_the_pulses(fake, has_loop, facts):
    columns = (*fake.identity.channels, Channel("pwm1_us", "us"))
    fake.identity = replace(fake.identity, channels=columns, has_loop=has_loop, facts=facts)
    # The bench reports the stop pulse and the motor stands: a fault only if the host drives it.
    fake.spoil = lambda time_s, row: (
        row
        | {
            "rpm1": 40.0,
            "thrust_N": 0.01 * (time_s % 0.02),
            "pwm1_us": 1000.0,
        }
    )
    judged = (
        nullcontext() if has_loop else pytest.raises(StandstillNotSeen, match="1500 us after 2")
    )
    with judged, GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
        for _ in range(40):
            guard.read(0.1)
