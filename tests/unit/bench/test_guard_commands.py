"""What a guarded bench sends and refuses: pulses, plate, tare, orders from before a pause."""

# ruff: noqa: PT012 -- what happens on the way out needs the whole body inside `raises`

from dataclasses import replace

import numpy as np
import pytest

from benchtool.bench.guard import GuardedBench
from benchtool.bench.serial.conversation import ANSWER_S as TRY_S
from benchtool.bench.serial.conversation import TRIES
from benchtool.core.errors import (
    CommandRefused,
    DeviceStopped,
    HostPaused,
    InputError,
    StageError,
    StandstillNotSeen,
)
from benchtool.core.rig_file import rig_named
from tests.unit.bench.guarded_fake import RIG


def test_another_rig_than_the_device_has_is_refused(fake):
    with pytest.raises(InputError, match="has 4 rotors, but the bench fake: drives 1"):
        GuardedBench(fake, rig_named("pquad")).__enter__()
    assert fake.did == ["open", "close"]


def test_a_pulse_above_the_limit_is_never_sent(fake):
    limits = replace(RIG.limits, pwm_us=1500.0)
    with GuardedBench(fake, RIG, limits) as guard:
        for pulses in ([1501.0], [np.nan], [1200.0, 1200.0]):
            with pytest.raises(InputError, match="sent"):
                guard.set_pwm(np.array(pulses))
    assert not any(item.startswith("pwm") for item in fake.did)


def test_a_refusal_of_the_device_leaves_the_run_alive(fake):
    with GuardedBench(fake, RIG) as guard:
        fake.failing = {"pwm": CommandRefused("pwm", "no")}
        with pytest.raises(CommandRefused):
            guard.set_pwm(np.array([1200.0]))
        fake.failing = {}
        assert guard.pwm_us[0] == 1000.0
        guard.set_pwm(np.array([1300.0]))
    assert guard.reason is None


def test_the_plate_moves_only_at_idle_and_never_inside_the_minimum_gap(fake):
    with GuardedBench(fake, RIG) as guard:
        with pytest.raises(StageError, match="outside"):
            guard.move_plate(RIG.plate.z_min_m - 0.001)
        guard.set_pwm(np.array([1400.0]))
        with pytest.raises(StageError, match="motor 1 is commanded 1400 us, above idle"):
            guard.move_plate(0.5)
        guard.set_pwm(np.array([1000.0]))
        guard.move_plate(0.5)
    assert [item for item in fake.did if item.startswith("plate")] == ["plate 0.5"]


def test_a_separate_stage_asks_the_same_questions(fake):
    with GuardedBench(fake, RIG) as guard:
        with pytest.raises(StageError, match="outside"):
            guard.ready_for_move(RIG.plate.z_min_m - 0.001)
        with pytest.raises(StageError, match=r"sideways to -50 m, limit 0\.72 m"):
            guard.ready_for_move(0.5, -50.0)
        for place in ((0.5, np.nan), (0.5, 0.0, np.nan), (np.nan,)):
            with pytest.raises(StageError):
                guard.ready_for_move(*place)
        guard.ready_for_move(0.5, 0.72)
        guard.set_pwm(np.array([1400.0]))
        with pytest.raises(StageError, match="above idle"):
            guard.ready_for_move(0.5)
    assert not any(item.startswith("plate") for item in fake.did)


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


def test_the_plate_is_refused_when_a_rotor_does_not_stop(fake):
    fake.tail_rpm = 900.0
    fake.spoil = lambda time_s, row: row | {"thrust_N": 0.05 * np.sin(time_s * 99.0)}
    with (
        pytest.raises(StandstillNotSeen, match="still turns at 90"),
        GuardedBench(fake, RIG) as guard,
    ):
        guard.move_plate(0.5)
    assert "plate 0.5" not in fake.did


def test_no_tare_under_thrust(fake):
    with GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1400.0]))
        with pytest.raises(InputError, match="no tare"):
            guard.tare()
        guard.set_pwm(np.array([1000.0]))
        guard.tare()
    assert fake.did.count("tare") == 1


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
