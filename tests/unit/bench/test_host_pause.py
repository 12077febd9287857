"""Commands and reads of a host that did not run meanwhile."""

# ruff: noqa: PT012 -- what happens on the way out needs the whole body inside `raises`

import numpy as np
import pytest

from benchtool.bench.guard import GuardedBench
from benchtool.bench.serial.conversation import ANSWER_S as TRY_S
from benchtool.bench.serial.conversation import TRIES
from benchtool.core.errors import DeviceStopped, HostPaused
from tests.unit.bench.guarded_fake import RIG

SAID = "did not run benchtool for 2.0 s, limit 0.25 s"


def test_no_order_from_before_a_pause_is_sent(fake):
    with pytest.raises(HostPaused, match=SAID), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
        guard.read(1.0)
        fake.clock_s += 2.0
        guard.set_pwm(np.array([1600.0]))
    assert "pwm 1600" not in fake.did
    assert guard.reason.startswith("this computer did not run")
    assert guard.reason.endswith("keep the computer awake and free for the run")


def test_what_a_pause_made_the_device_say_is_its_cause_and_no_more(fake):
    read = fake.read

    def late(timeout_s):
        fake.clock_s += timeout_s + 2.0
        fake.read = read
        raise DeviceStopped("watchdog: no line")

    with pytest.raises(HostPaused, match=SAID) as ended, GuardedBench(fake, RIG) as guard:
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

    with pytest.raises(HostPaused, match=SAID), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
        guard.read(1.0)
        fake.spoil = lambda time_s, row: row | {"rpm1": 0.0}
        fake.read = late
        guard.read(0.1)
    assert len(guard.take_unread()) == 10


def test_a_short_delay_and_motors_at_zero_are_no_pause(fake):
    with GuardedBench(fake, RIG) as guard:
        fake.clock_s += 60.0
        guard.set_pwm(np.array([1500.0]))
        fake.clock_s += 0.2
        guard.read(1.0)
    assert guard.reason is None


def test_a_command_whose_answers_get_lost_is_no_pause(fake):
    set_pwm = fake.set_pwm

    def slow(pwm_us):
        # `where`, `arm` and `pwm`, each answered at its last try.
        fake.clock_s += 3.0 * TRIES * TRY_S
        set_pwm(pwm_us)

    fake.set_pwm = slow
    with GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
        guard.read(1.0)
    assert guard.reason is None
