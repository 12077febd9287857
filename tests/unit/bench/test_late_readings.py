"""Readings that are old when they are read, or stamped ahead: no rotor is judged by them."""

from dataclasses import replace

import numpy as np
import pytest

from benchtool.bench.guard import GuardedBench
from benchtool.core.errors import ReadingsLate, StandstillNotConfirmed
from tests.unit.bench.guarded_fake import RIG


def drive(fake, *steps):
    """Command pulses one after another, each for so many seconds; return the guard."""
    with GuardedBench(fake, RIG) as guard:
        for pulse_us, seconds in steps:
            guard.set_pwm(np.array([pulse_us]))
            for _ in range(round(10.0 * seconds)):
                guard.read(0.1)
    return guard


def stamp(fake, ahead_s):
    """Let readings bear other times: by so many seconds later, a function of the present time."""
    read = fake.read

    def stamped(timeout_s):
        readings = read(timeout_s)
        return replace(readings, time_s=readings.time_s + ahead_s(fake.clock_s))

    fake.read = stamped


@pytest.mark.parametrize(
    ("ahead_s", "said", "stopped_s"),
    [
        (lambda now_s: -0.5 * now_s, r"newest reading is 1\.\d s old", 3.15),
        (lambda now_s: 19.0 * now_s, r"is 2\d.\d s ahead of .*reported 1 ", 1.2),
    ],
)
def test_readings_that_stay_late_end_the_run_by_that_name(fake, ahead_s, said, stopped_s):
    stamp(fake, ahead_s)
    with pytest.raises(ReadingsLate, match=said):
        drive(fake, (1500.0, 10.0))
    assert fake.stopped_s == pytest.approx(stopped_s, abs=0.11)
    assert fake.did[-1] == "close"


def test_one_old_block_that_waited_while_nobody_read_ends_nothing(fake):
    stamp(fake, lambda now_s: -30.0 if 1.0 < now_s <= 1.11 else 0.0)
    assert drive(fake, (1500.0, 4.0)).reason is None


def test_no_rotor_is_judged_by_readings_whose_time_is_wrong(fake):
    # A rotor that slows down, on a clock that runs twenty times as fast as it states.
    stamp(fake, lambda now_s: 19.0 * now_s)
    fake.spoil = lambda time_s, row: (
        row | ({"rpm1": 900.0, "thrust_N": 0.1 * (time_s % 0.02)} if time_s > 0.5 else {})
    )
    with pytest.raises(ReadingsLate):
        drive(fake, (1500.0, 0.5), (1000.0, 2.0))


def test_a_dead_motor_behind_a_wrong_clock_ends_the_run_by_the_clock(fake):
    fake.spoil = lambda time_s, row: row | {"rpm1": 40.0, "thrust_N": 0.01 * (time_s % 0.02)}
    stamp(fake, lambda now_s: 5.0 if now_s > 1.95 else 0.0)
    said = "the run ended because: the newest reading is 5.0 s ahead"
    with pytest.raises(StandstillNotConfirmed, match=said):
        drive(fake, (1500.0, 10.0))
    assert fake.stopped_s == pytest.approx(2.0, abs=0.11)
