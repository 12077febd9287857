"""Which rotors were seen to stand: pure judgement of commands and readings."""

from __future__ import annotations

from dataclasses import replace
from math import nan, pi
from pathlib import Path

import numpy as np
import pytest

from benchtool.bench.bench import DeviceInfo
from benchtool.bench.standstill import StandstillMonitor, format_unmeasured_rotors, standstill_rpm
from benchtool.core.channel import Channel
from benchtool.core.rig_file import load_rig_by_name, rig_names

RIG = load_rig_by_name("pquad")
STOP = np.full(4, 1000.0)
RPM = tuple(f"rpm{rotor}" for rotor in range(1, 5))
PWM = tuple(f"pwm{rotor}_us" for rotor in range(1, 5))


def bench(names: tuple[str, ...], **more: object) -> DeviceInfo:
    return DeviceInfo(
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


def test_the_threshold_comes_from_the_rig():
    for name in rig_names():
        rig = load_rig_by_name(name)
        tip_m_s = standstill_rpm(rig) * pi / 30.0 * rig.propulsion.radius_m
        assert tip_m_s == pytest.approx(1.0)
        assert standstill_rpm(rig) > 3.0 * rig.sensors["rpm"].noise


BENCHES = {
    "rpm": bench(RPM),
    "two": bench(("rpm1", "rpm2")),
    "none": bench(()),
    "pwm": bench(PWM),
    "outputs": bench(PWM, outputs_measured=True, pwm_stop_us=1000.0),
    "both": bench((*RPM, *PWM), outputs_measured=True),
    "loop": bench((*RPM, *PWM), has_loop=True),
}
SEEN = Path(__file__).with_name("standstill_rows.txt").read_text("utf-8").splitlines()
"""What a bench measures; spans of commanded pulses, seconds, and what its channels then show; what
is seen of the rotors by then, and some words of it."""


def watched(identity: DeviceInfo, text: str) -> StandstillMonitor:
    """Return a watch after spans as they stand in `SEEN`."""
    watch, now_s = StandstillMonitor(identity, RIG, 0.0), 0.0
    for span in text.split("; "):
        us, seconds, *words = span.split()
        pulses_us = np.broadcast_to(np.array(us.split(","), float), 4)
        pairs = (word.partition("*") for word in words)
        shown = [float(value) for value, _, count in pairs for _ in range(int(count or 1))]
        watch.record_command(pulses_us, now_s)
        time_s = now_s + np.arange(1, round(100.0 * float(seconds)) + 1) / 100.0
        for block in np.array_split(time_s, max(1, len(time_s) // 5)):
            watch.update(block, np.tile(np.array(shown, float), (len(block), 1)))
        now_s += float(seconds)
    return watch


@pytest.mark.parametrize("row", SEEN)
def test_what_is_seen_of_the_rotors(row):
    measured, spans, verdict, words = f"{row} ".split(" | ")
    words = words.strip()
    state = watched(BENCHES[measured], spans).state()
    assert (state.is_confirmed, state.is_only_unmeasured) == (
        verdict == "seen",
        verdict == "unmeasured",
    )
    assert words in state.text
    assert bool(state.text) == bool(words)
    assert state.rpm == 4479.0 or "4479" not in row


@pytest.mark.parametrize("shown", [nan, 4500.0])
def test_readings_from_before_the_command_count_for_nothing(shown):
    watch = watched(bench(RPM), "1500 1 4500*4")
    watch.record_command(STOP, 1.0)
    late_s = np.linspace(0.9, 1.0, 11)
    watch.update(late_s, np.zeros((11, 4)))
    assert not watch.state().is_confirmed
    assert "no reading came after zero was commanded" in watch.state().text


def test_the_time_that_is_told_is_that_of_the_reading_that_shows_it_not_of_the_question():
    watch = watched(bench(RPM), "1500 1 4500*4; 1000 .3 0*4")
    watch.update(np.array([60.0]), np.full((1, 4), nan))
    assert "seen to stand 0.1 s after zero was commanded" in watch.state().text
    watch = watched(bench(RPM), "1500 1 4500*4; 1000 .2 900*4")
    watch.update(np.array([60.0]), np.full((1, 4), nan))
    assert "rpm4 900, 0.2 s after zero was commanded" in watch.state().text


def test_rotors_without_a_measurement_are_named_before_arming():
    assert format_unmeasured_rotors(bench(RPM), RIG) == ""
    assert "rotors 1, 2, 3 and 4 will not be seen to stand" in format_unmeasured_rotors(
        bench(PWM), RIG
    )
    assert format_unmeasured_rotors(replace(bench(PWM), outputs_measured=True), RIG) == ""
    assert format_unmeasured_rotors(bench(RPM[:3]), RIG).startswith("rotor 4 will not be")
