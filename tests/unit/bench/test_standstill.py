"""Which rotors were seen to stand: pure judgement of commands and readings."""

from __future__ import annotations

from dataclasses import replace
from math import nan, pi

import numpy as np
import pytest

from benchtool.bench.bench import Identity
from benchtool.bench.standstill import HOLD_S, StandstillWatch, standstill_rpm, unmeasured_rotors
from benchtool.core.channel import Channel
from benchtool.core.rig_file import rig_named, rig_names

RIG = rig_named("pquad")
STOP, DRIVEN = np.full(4, 1000.0), np.full(4, 1500.0)
RPM = tuple(f"rpm{rotor}" for rotor in range(1, 5))
PWM = tuple(f"pwm{rotor}_us" for rotor in range(1, 5))


def bench(names: tuple[str, ...], **more: object) -> Identity:
    return Identity(
        address="fake:",
        device_id="fake",
        firmware="",
        protocol="fake",
        channels=tuple(Channel(name, "us" if name.startswith("pwm") else "rpm") for name in names),
        rate_Hz=100.0,
        n_rotors=4,
        simulated=True,
        moves_plate=False,
        **more,  # type: ignore[arg-type]
    )


def watched(identity: Identity, *spans: tuple[np.ndarray, float, list[float]]) -> StandstillWatch:
    """Return a watch after spans of (commanded pulses, seconds, what every channel then shows)."""
    watch, now_s = StandstillWatch(identity, RIG, 0.0), 0.0
    for pulses_us, seconds, shown in spans:
        watch.commanded(pulses_us, now_s)
        time_s = now_s + np.arange(1, round(100.0 * seconds) + 1) / 100.0
        for block in np.array_split(time_s, max(1, len(time_s) // 5)):
            watch.take(block, np.tile(np.array(shown, float), (len(block), 1)))
        now_s += seconds
    return watch


def test_the_threshold_comes_from_the_rig() -> None:
    for name in rig_names():
        rig = rig_named(name)
        tip_m_s = standstill_rpm(rig) * pi / 30.0 * rig.propulsion.radius_m
        assert tip_m_s == pytest.approx(1.0)
        assert standstill_rpm(rig) > 3.0 * rig.sensors["rpm"].noise


def test_speeds_that_fall_and_stay_low_are_a_standstill() -> None:
    driven = (DRIVEN, 1.0, [4500.0] * 4)
    assert not watched(bench(RPM), driven, (STOP, 0.5, [300.0] * 4)).state().seen
    state = watched(bench(RPM), driven, (STOP, 0.3, [0.0] * 4)).state()
    assert state.seen
    assert state.text == ("rotors 1, 2, 3 and 4 were seen to stand 0.1 s after zero was commanded")


def test_one_low_reading_is_not_enough() -> None:
    watch = watched(bench(RPM), (DRIVEN, 1.0, [4500.0] * 4), (STOP, HOLD_S / 2, [0.0] * 4))
    assert not watch.state().seen


def test_a_speed_that_stays_is_named_with_its_rotor() -> None:
    rpm = [0.0, 4479.0, 0.0, 120.0]
    state = watched(bench(RPM), (DRIVEN, 1.0, [4500.0] * 4), (STOP, 4.0, rpm)).state()
    assert (state.seen, state.rpm) == (False, 4479.0)
    assert state.text.startswith(
        "MOTORS MAY STILL TURN: rpm2 4479, rpm4 120, 4.0 s after zero was commanded"
    )
    assert "cut the power" in state.text


def test_a_rotor_that_turns_again_does_not_stand() -> None:
    driven, stood = (DRIVEN, 1.0, [4500.0] * 4), (STOP, 1.0, [0.0] * 4)
    state = watched(bench(RPM), driven, stood, (STOP, 0.1, [0.0, 0.0, 900.0, 0.0])).state()
    assert "rpm3 900" in state.text


@pytest.mark.parametrize("shown", [nan, 4500.0])
def test_readings_from_before_the_command_count_for_nothing(shown: float) -> None:
    watch = watched(bench(RPM), (DRIVEN, 1.0, [4500.0] * 4))
    watch.commanded(STOP, 1.0)
    late_s = np.linspace(0.9, 1.0, 11)
    watch.take(late_s, np.zeros((11, 4)))
    assert not watch.state().seen
    assert "no reading came after zero was commanded" in watch.state().text


def test_a_channel_that_did_not_show_the_motor_turning_shows_no_standstill() -> None:
    dead = [4500.0, 0.0, 4500.0, 4500.0]
    state = watched(bench(RPM), (DRIVEN, 1.0, dead), (STOP, 1.0, [0.0] * 4)).state()
    assert not state.seen
    assert "rotor 2 was not seen to stand: the speed channel did not show" in state.text


def test_a_motor_turned_for_a_moment_need_not_have_been_seen() -> None:
    state = watched(bench(RPM), (DRIVEN, 0.1, [0.0] * 4), (STOP, 1.0, [0.0] * 4)).state()
    assert state.seen


def test_a_channel_that_never_showed_the_motor_shows_no_standstill_after_a_short_turn() -> None:
    short, stood = (DRIVEN, 0.4, [0.0] * 4), (STOP, 1.0, [0.0] * 4)
    state = watched(bench(RPM), short, stood).state()
    assert not state.seen
    assert "the speed channel did not show the motor turning" in state.text
    # One that showed it before, or shows it while the rotor slows down, is believed.
    before = (DRIVEN, 1.0, [4500.0] * 4)
    assert watched(bench(RPM), before, (STOP, 1.0, [0.0] * 4), short, stood).state().seen
    late = (STOP, 0.2, [300.0] * 4)
    assert watched(bench(RPM), short, late, stood).state().seen


def test_the_time_that_is_told_is_that_of_the_reading_that_shows_it_not_of_the_question() -> None:
    watch = watched(bench(RPM), (DRIVEN, 1.0, [4500.0] * 4), (STOP, 0.3, [0.0] * 4))
    watch.take(np.array([60.0]), np.full((1, 4), nan))
    assert "seen to stand 0.1 s after zero was commanded" in watch.state().text
    # Nor that of the last of many readings that show the same, as while a plate moves.
    watch = watched(bench(RPM), (DRIVEN, 1.0, [4500.0] * 4), (STOP, 50.0, [0.0] * 4))
    assert "seen to stand 0.1 s after zero was commanded" in watch.state().text
    watch = watched(bench(RPM), (DRIVEN, 1.0, [4500.0] * 4), (STOP, 0.2, [900.0] * 4))
    watch.take(np.array([60.0]), np.full((1, 4), nan))
    assert "rpm4 900, 0.2 s after zero was commanded" in watch.state().text


def test_pulses_that_the_device_repeats_are_no_measurement() -> None:
    state = watched(bench(PWM), (DRIVEN, 1.0, [1500.0] * 4), (STOP, 1.0, [1000.0] * 4)).state()
    assert (state.seen, state.only_unmeasured, state.unmeasured) == (False, True, (1, 2, 3, 4))
    assert "not seen to stand: this bench measures no speed there" in state.text
    assert "stopped" not in state.text


def test_outputs_that_are_read_back_are_one() -> None:
    identity = bench(PWM, outputs_measured=True, pwm_stop_us=1000.0)
    driven = (DRIVEN, 1.0, [1500.0] * 4)
    assert watched(identity, driven, (STOP, 0.3, [0.0, 1000.0, 1002.0, 0.0])).state().seen
    state = watched(identity, driven, (STOP, 4.0, [1000.0, 1500.0, 1000.0, 1000.0])).state()
    assert "MOTORS MAY STILL TURN: output of rotor 2 1500 us" in state.text


def test_outputs_stand_in_for_a_speed_that_is_silent() -> None:
    identity = bench((*RPM, *PWM), outputs_measured=True)
    driven = (DRIVEN, 1.0, [nan] * 4 + [1500.0] * 4)
    assert watched(identity, driven, (STOP, 0.3, [nan] * 4 + [1000.0] * 4)).state().seen
    turning = watched(identity, driven, (STOP, 0.3, [900.0] * 4 + [1000.0] * 4)).state()
    assert "rpm1 900" in turning.text


def test_only_rotors_that_were_driven_must_be_seen() -> None:
    one = np.array([1000.0, 1500.0, 1000.0, 1000.0])
    names = ("rpm1", "rpm2")
    assert watched(bench(names), (one, 1.0, [0.0, 4500.0]), (STOP, 1.0, [0.0, 0.0])).state().seen
    state = watched(bench(names), (DRIVEN, 1.0, [4500.0] * 2), (STOP, 1.0, [0.0] * 2)).state()
    assert (state.unmeasured, state.only_unmeasured) == ((3, 4), True)
    assert "rotors 3 and 4 were not seen to stand" in state.text
    assert "rotors 1 and 2 were seen to stand" in state.text


def test_a_loop_is_judged_by_the_pulses_that_it_reports() -> None:
    identity = bench((*RPM, *PWM), has_loop=True)
    idle = (DRIVEN, 1.0, [0.0] * 4 + [1050.0] * 4)
    assert watched(identity, idle, (STOP, 1.0, [0.0] * 4 + [1000.0] * 4)).state().seen
    dead = (DRIVEN, 1.0, [0.0] * 4 + [1500.0] * 4)
    assert not watched(identity, dead, (STOP, 1.0, [0.0] * 4 + [1000.0] * 4)).state().seen


def test_nothing_is_said_where_no_motor_was_driven() -> None:
    assert watched(bench(()), (STOP, 1.0, [])).state().text == ""


def test_rotors_without_a_measurement_are_named_before_arming() -> None:
    assert unmeasured_rotors(bench(RPM), RIG) == ""
    assert "rotors 1, 2, 3 and 4 will not be seen to stand" in unmeasured_rotors(bench(PWM), RIG)
    assert unmeasured_rotors(replace(bench(PWM), outputs_measured=True), RIG) == ""
    assert unmeasured_rotors(bench(RPM[:3]), RIG).startswith("rotor 4 will not be")
