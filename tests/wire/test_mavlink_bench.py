"""A bench behind a virtual autopilot: what it proves, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.bench.mavlink.autopilots import ArduPilot
from benchtool.bench.mavlink.frames import MavCommand, MavlinkFrames
from benchtool.bench.mavlink.settings import MotorMap
from benchtool.core.errors import (
    CommandRefused,
    InputError,
    ProtocolError,
    StageError,
)
from tests.wire.autopilot_bench import KEY, PLUS, Bench, make_real, pulses
from tests.wire.still_plant import StillPlant


def test_the_map_says_which_output_is_which_rotor():
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        bench.set_pwm(pulses(1000.0, 1300.0))
        values, messages = made.read(0.5)
        assert made.autopilot.outputs_us[:4] == (1300, 1000, 1000, 1000)
        assert made.last(values, "pwm2_us") == 1300.0
        assert made.last(values, "pwm1_us") == 1000.0
        assert not [text for text in messages if "is driven by" in text]


def test_a_rotor_that_turns_alone_shows_its_output():
    made = Bench()
    with made.bench as bench:
        assert bench.identity.n_rotors == 4
    made = Bench(rotors=2)
    with made.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        values, messages = made.read(0.5)
        assert "rotor 1 is driven by output 3" in messages
        assert made.last(values, "pwm1_us") == 1300.0
        assert made.last(values, "pwm2_us") == 1000.0


def test_one_host_after_another_learns_how_fast_time_runs():
    made = Bench(rotors=2)
    made.autopilot.speed = 20.0
    for _ in range(3):
        with made.bench as bench:
            assert bench.identity.speed == 20.0


def test_readings_are_as_old_as_they_are_however_long_nobody_looked():
    made = Bench(rotors=2)
    with made.bench as bench:
        made.link.pass_time(0.4)
        made.read(0.2)
        assert 0.0 <= bench.now_s() - bench.read(0.1).time_s[-1] < 0.03


def test_ardupilot_turns_one_motor_at_a_time_and_says_so():
    made = Bench(motor_map=PLUS)
    with made.bench as bench, pytest.raises(InputError, match="motors 1, 2 cannot turn together"):
        bench.set_pwm(pulses(1300.0, 1300.0))


def test_px4_turns_several_together():
    straight = MotorMap(rig="two", autopilot="PX4", motors=(1, 2), outputs=(1, 2), escs=(1, 2))
    made = Bench("px4", motor_map=straight)
    with made.bench as bench:
        assert bench.identity.firmware.startswith("PX4")
        bench.set_pwm(pulses(1300.0, 1500.0))
        made.read(0.5)
        assert made.autopilot.outputs_us[:2] == (1300, 1500)
        bench.set_pwm(pulses(1300.0, 1000.0))
        made.read(0.5)
        assert made.autopilot.outputs_us[:2] == (1300, 1000)
        bench.stop()
        made.read(0.2)
        assert made.autopilot.outputs_us[:2] == (1000, 1000)


def test_messages_that_do_not_come_are_told():
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        facts = bench.identity.facts
        _, messages = made.read(0.2)
    assert facts["messages denied"] == "ESC_STATUS RAW_RPM"
    assert facts["messages accepted, but nothing comes"] == "RPM"
    assert facts["messages comes unasked"] == "NAMED_VALUE_FLOAT"
    assert "RPM: accepted, but nothing comes" in messages
    assert "RAW_RPM: denied" in messages
    assert not [text for text in messages if "No ap_message" in text]


def test_a_refused_order_carries_mavlinks_word():
    made = Bench("px4", motor_map=PLUS)
    made.autopilot._orders.order = lambda *_: 1
    with made.bench as bench, pytest.raises(CommandRefused, match="TEMPORARILY_REJECTED"):
        bench.set_pwm(pulses(1300.0, 1000.0))
    assert max(made.autopilot.outputs_us) == 1000


def test_a_tare_is_the_hosts():
    plant = StillPlant()
    plant.zero_N = -0.7
    made = Bench(motor_map=PLUS, plant=plant)
    with made.bench as bench:
        assert made.last(made.read(0.5)[0], "thrust_N") == pytest.approx(0.7)
        bench.tare()
        values, _ = made.read(2.0)
        assert made.last(values, "thrust_N") == pytest.approx(0.0, abs=1e-6)
        assert made.last(values, "thrust_raw") == pytest.approx(0.7)


def test_a_slow_line_carries_less_and_says_so():
    made = Bench(motor_map=PLUS, baud=38400)
    make_real(made)
    with made.bench as bench:
        assert bench.identity.rate_Hz == 25.0
        _, messages = made.read(0.3)
        assert "outputs come at 25 Hz instead of 50: the link runs at 38,400 baud" in messages
        with pytest.raises(InputError, match=r"bytes/s x 10 bits = 1\d\d,\d{3} baud, but the link"):
            bench.set_rate(200.0)
    made = Bench(motor_map=PLUS, baud=9600)
    make_real(made)
    with pytest.raises(InputError, match="outputs at 10 Hz and the other streams are"):
        made.bench.open()


def test_the_plate_of_a_real_autopilot_needs_a_stage():
    made = Bench(motor_map=PLUS)
    make_real(made)
    with made.bench as bench:
        assert not bench.identity.simulated
        assert not bench.identity.moves_plate
        with pytest.raises(StageError, match="use --stage hand or --stage grbl:PORT"):
            bench.move_plate(0.2)


def test_signed_frames_are_taken_and_others_refused():
    signed = Bench(motor_map=PLUS, key=KEY, device_key=KEY)
    with signed.bench as bench:
        bench.set_pwm(pulses(1300.0, 1000.0))
        values, _ = signed.read(0.5)
        assert signed.last(values, "pwm1_us") == 1300.0
    for theirs in (None, bytes(32)):
        other = Bench(motor_map=PLUS, key=KEY, device_key=theirs)
        with pytest.raises(ProtocolError, match="no frame has a signature of this key"):
            other.bench.open()


def test_an_unsigned_order_turns_nothing_on_a_signed_autopilot():
    made = Bench(motor_map=PLUS, device_key=KEY)
    with pytest.raises(ProtocolError, match=r"signs its frames .* give its key as key=FILE"):
        made.bench.open()
    host = MavlinkFrames()
    order = host._mav.command_long_encode(1, 1, 209, 0, 1, 1, 1300, 3.0, 1, 0, 0)
    made.autopilot.receive(host.pack(order), 0.0)
    made.link.pass_time(0.2)
    assert max(made.autopilot.outputs_us) == 1000


def test_link_quality_counts_messages_and_losses():
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        made.read(1.0)
        tick = made.autopilot.tick
        made.autopilot.tick = lambda n, now_s: (tick(n, now_s)[0], [])
        made.link.pass_time(0.1)
        made.autopilot.tick = tick
        made.link.pass_time(0.1)
        readings = [bench.read(0.05) for _ in range(5)]
        lost = sum(part.lost for part in readings)
        facts = bench.identity.facts
    assert 10 < lost < 30
    assert facts["link_lost"].startswith(f"{lost} of ")
    assert float(facts["link_jitter_ms"]) > 0.0


def test_losses_that_show_before_any_sample_come_with_the_next_samples():
    made = Bench(motor_map=PLUS)
    with made.bench as bench:
        made.read(0.5)
        tick, frames = made.autopilot.tick, made.autopilot._frames
        made.autopilot.tick = lambda n, now_s: (b"", [])
        frames._mav.seq = (frames._mav.seq + 7) % 256
        made.link._answer += frames.pack(made.autopilot._heartbeat())
        lost = bench.read(0.05).lost
        made.autopilot.tick = tick
        lost += sum(bench.read(0.05).lost for _ in range(5))
    assert lost == 7


def test_a_load_cell_beside_the_autopilot_is_laid_on_its_time():
    made = Bench(motor_map=PLUS, cell=("/dev/cell", 57600), thrust_scale_N=0.1)
    with made.bench as bench:
        names = [channel.name for channel in bench.identity.channels]
        parts = [bench.read(0.05) for _ in range(100)]
    time_s = np.concatenate([part.time_s for part in parts])
    device_us = np.concatenate([part.device_time_us for part in parts])
    raw = np.concatenate([part.values[:, names.index("thrust_raw")] for part in parts])
    thrust_N = np.concatenate([part.values[:, names.index("thrust_N")] for part in parts])
    assert np.all(np.diff(device_us) > 0)
    told = np.isfinite(raw)
    assert told.sum() > 40
    # The count says when it was read: whole tenths of a second.
    assert np.all(np.abs(time_s[told] - raw[told] / 10.0) < 0.11)
    np.testing.assert_allclose(thrust_N[told], 0.1 * raw[told])


def test_an_autopilot_that_does_not_tell_its_outputs_is_refused():
    made = Bench(motor_map=PLUS)
    made.autopilot._orders.lacks = made.autopilot._orders.lacks | {36}
    said = r"sends no servo outputs \(SERVO_OUTPUT_RAW denied, ACTUATOR_OUTPUT_STATUS denied\)"
    with pytest.raises(ProtocolError, match=said):
        made.bench.open()


def test_streams_that_nobody_here_asks_for_are_switched_off_on_a_serial_line():
    made = Bench(motor_map=PLUS, baud=57600)
    make_real(made)
    made.autopilot._every_us = {30: 20_000.0}  # ATTITUDE, of a host that has left
    made.autopilot._due_us = {30: 0.0}
    with made.bench:
        _, messages = made.read(0.5)
        assert "disabled streams that this bench does not need: ATTITUDE" in messages
        assert 30 not in made.autopilot._every_us


@pytest.mark.parametrize("timeout_s", [-1.0, 0.3, float("nan"), float("inf")])
def test_no_order_to_turn_can_last(timeout_s):
    with pytest.raises(InputError, match=r"out of range; allowed: 0 to 0\.25 s"):
        MavCommand(209, (1.0, 1.0, 1300.0, timeout_s, 1.0, 0.0, 0.0))


@pytest.mark.parametrize("pulse_us", [999.0, 1901.0, 2200.0, float("nan")])
def test_pulses_outside_of_the_autopilots_range_are_refused(pulse_us):
    range_us = ArduPilot().pulses({"MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 1900.0})
    with pytest.raises(InputError, match=r"allowed: 1000 to 1900 us \(MOT_PWM_MIN to MOT_PWM_MAX"):
        ArduPilot().turn({1: pulse_us}, range_us)
    made = Bench(motor_map=PLUS)
    with made.bench as bench, pytest.raises(InputError, match="command not sent"):
        bench.set_pwm(pulses(pulse_us, 1000.0))
