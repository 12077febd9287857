"""Every way out of a guarded bench ends at zero, once, with the reason kept and the link closed."""

# ruff: noqa: PT012 -- what happens on the way out needs the whole body inside `raises`

import os
import signal
from dataclasses import replace

import numpy as np
import pytest

from benchtool.bench.bench import Identity, Readings
from benchtool.bench.guard import GuardedBench
from benchtool.core.channel import Channel
from benchtool.errors import (
    CommandRefused,
    DeviceStopped,
    InputError,
    LimitExceeded,
    LinkLost,
    RunStopped,
    StageError,
)
from benchtool.library import rig_named

RIG = rig_named("pquad_single")
NAMES = ("thrust_N", "rpm1", "voltage_V", "current_A", "temperature_degC")
UNITS = ("N", "rpm", "V", "A", "degC")
K = RIG.propulsion.thrust_coefficient_N_s2


class FakeBench:
    """Write every command down; rotors follow at once; `spoil` changes what is read."""

    def __init__(self):
        self.did = []
        self.clock_s = 0.0
        self.pwm_us = np.array([1000.0])
        self.spoil = lambda time_s, row: row
        self.failing = {}
        self.tail_rpm = 0.0

    identity = Identity(
        address="fake:",
        device_id="fake",
        firmware="",
        protocol="fake",
        channels=tuple(Channel(name, unit) for name, unit in zip(NAMES, UNITS, strict=True)),
        rate_Hz=100.0,
        n_rotors=1,
        simulated=True,
        moves_plate=True,
    )

    def _do(self, what):
        self.did.append(what)
        if error := self.failing.get(what.split()[0]):
            raise error

    def now_s(self):
        return self.clock_s

    def open(self):
        self._do("open")

    def close(self):
        self._do("close")

    def set_pwm(self, pwm_us):
        self._do(f"pwm {pwm_us[0]:.0f}")
        self.pwm_us = pwm_us

    def stop(self):
        self._do("stop")
        self.pwm_us = np.array([1000.0])

    def move_plate(self, z_m, x_m=0.0, tilt_rad=0.0):
        self._do(f"plate {z_m:g}")

    def tare(self):
        self._do("tare")

    def set_rate(self, rate_Hz):
        self._do(f"rate {rate_Hz:g}")

    def read(self, timeout_s):
        if error := self.failing.get("read"):
            raise error
        n = round(timeout_s * 100.0)
        rows = []
        for _ in range(n):
            self.clock_s += 0.01
            pulse = RIG.propulsion
            rad_s = max(self.pwm_us[0] - pulse.pwm_start_us, 0.0) * pulse.speed_per_us_rad_s
            rpm = rad_s * 30.0 / np.pi + self.tail_rpm
            wobble = 0.003 * np.sin(700.0 * self.clock_s)
            row = {"thrust_N": K * rad_s**2 + wobble, "rpm1": rpm + 1000.0 * wobble * (rpm > 0)}
            row |= {"voltage_V": 11.0, "current_A": 1.0, "temperature_degC": 30.0}
            rows.append((self.clock_s, *self.spoil(self.clock_s, row).values()))
        table = np.array(rows).reshape(n, 6)
        return Readings(table[:, 0], table[:, 0] * 1e6, table[:, 1:])


@pytest.fixture
def fake():
    return FakeBench()


def zeroes_once_then_closes(fake):
    assert fake.did.count("stop") == 1
    assert fake.did[-2:] == ["stop", "close"]


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
    zeroes_once_then_closes(fake)
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
    zeroes_once_then_closes(fake)


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
    zeroes_once_then_closes(fake)
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
    zeroes_once_then_closes(fake)
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


def test_another_rig_than_the_device_has_is_refused(fake):
    with pytest.raises(InputError, match="has 4 rotors, but the bench fake: drives 1"):
        GuardedBench(fake, rig_named("pquad")).__enter__()
    assert fake.did == ["open", "close"]


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
    zeroes_once_then_closes(fake)
    kept = guard.take_kept()
    assert kept is not None
    assert len(kept) == 100


def test_after_a_stop_nothing_turns_the_motors_again(fake):
    with pytest.raises(RunStopped, match="open it anew"), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
        fake.spoil = lambda time_s, row: row | {"current_A": 500.0}
        with pytest.raises(LimitExceeded):
            guard.read(0.1)
        guard.set_pwm(np.array([1200.0]))
    assert fake.did == ["open", "pwm 1500", "stop", "close"]


def test_thrust_that_rpm_does_not_explain_stops_after_a_while(fake):
    fake.spoil = lambda time_s, row: row | ({"rpm1": 0.0} if time_s > 1.0 else {})
    said = "not plausible for 0 rpm"
    with pytest.raises(LimitExceeded, match=said), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1900.0]))
        guard.read(1.5)
        guard.read(0.5)
    assert fake.clock_s == pytest.approx(2.0)


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
    assert fake.clock_s == pytest.approx(2.0 + after_s, abs=0.21)


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
    assert fake.clock_s == pytest.approx(4.0, abs=0.21)


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
    with pytest.raises(StageError, match="still turns at 90"), GuardedBench(fake, RIG) as guard:
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


def test_a_motor_that_does_not_follow_its_pulse_stops_the_run(fake):
    fake.spoil = lambda time_s, row: row | {"rpm1": 40.0, "thrust_N": 0.01 * (time_s % 0.02)}
    said = "rpm1 read 40, .* does not fit a pulse of 1500 us after 2"
    with pytest.raises(LimitExceeded, match=said), GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
        for _ in range(100):
            guard.read(0.1)
    assert fake.clock_s == pytest.approx(2.0, abs=0.11)


def test_a_motor_that_turns_without_a_command_stops_the_run(fake):
    fake.tail_rpm = 900.0
    fake.spoil = lambda time_s, row: row | {"thrust_N": 0.05 * np.sin(time_s * 99.0)}
    said = "rpm1 read 9.*, limit 300; .* a pulse of 1000 us"
    with pytest.raises(LimitExceeded, match=said), GuardedBench(fake, RIG) as guard:
        for _ in range(100):
            guard.read(0.1)
    assert fake.clock_s == pytest.approx(5.0, abs=0.21)
