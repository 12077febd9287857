"""Faults that `bench serve --fault` puts into a device end a sweep safely, and it says why."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.data.columns import word_to_code
from benchtool.data.run.append import read_events
from benchtool.data.run.read import read_samples
from tests.faults.dialects import framed
from tests.faults.loop import ADDRESS, World, command, plan, sweep

SMALL = ["--rig", "pquad_single", "--repeats", "2", "--z-over-r", "0.5,1", "--sample-s", "1"]


@pytest.mark.parametrize(
    ("fault", "code", "told"),
    [
        ("over_thrust:at_s=25", 4, "limit 12"),
        ("refuse_move:at_s=0", 3, "stage alarm; remove the obstruction, then home the stage"),
        ("stuck:channel=thrust_N,at_s=20,for_s=99", 4, "all the time"),
        # While the plate makes its first move of 13 s.
        ("over_thrust:at_s=8", 4, "limit 12"),
        # In the middle of a visit that lasts 10 s: nothing shows that the rotor stands.
        ("silence:at_s=4,for_s=30", 8, "the device should stop its motors by its watchdog"),
        ("unplug:at_s=4", 8, "look at its power and cable"),
    ],
)
def test_a_fault_ends_it_safely_and_says_why(tmp_path, fault, code, told):
    long = ["--sample-s", "200"] if code == 8 else []
    words = ["sweep", ADDRESS, *SMALL, *long, "--yes", "--out", "run"]
    ended = command(words, tmp_path, World([], speed=20.0, device_faults=[fault]))
    assert ended.code == code
    complaints = [line for line in ended.said.splitlines() if line.startswith("benchtool: ")]
    assert complaints == [f"benchtool: {ended.last_line}"]
    assert told in ended.last_line
    assert "benchtool sweep --resume run" in ended.said
    assert "20 times real time" in ended.said
    events = read_events(tmp_path / "run/events.jsonl")
    assert events[-1].event == "stopped"
    assert told in ended.metadata["reason"]
    if code == 8:
        unseen = "rotor 1 was not seen to stand: no reading came after zero was commanded"
        assert ended.last_line.startswith(f"{unseen}; cut the power; the run ended because: ")
        assert ended.metadata["reason"].startswith(unseen)
        assert "not_seen_to_stand" in [event.event for event in events]
    # The host's last order, or its own watchdog: the device stands.
    standing_s = ended.standing_at()
    assert standing_s is not None
    assert standing_s < ended.left_s + 0.3
    samples = read_samples(tmp_path / "run")
    assert ended.metadata["link"]["samples"] == len(samples)
    if fault.startswith("over_thrust"):
        # The reading that stopped it, and what came after it, are on the disk.
        assert np.nanmax(samples.column("thrust_N")) > 900.0
        assert samples.column("phase")[-1] == word_to_code("phase", "end")
        assert samples.column("pwm1_us")[-1] == 1000.0


EVIL = "\x1b]0;owned\x07\x9b2J<script>x</script>"
"""Sets a terminal's title, clears it (in 8 bits), and is an element of a page."""


@pytest.mark.parametrize("line", ["E,limit,{}", "N,{{number}},{}"])
def test_what_a_device_says_is_printed_as_text(tmp_path, line):
    said: list[float] = []

    def say(world: World) -> None:
        if not said and "ramping" in world.proxy.seen.phases:
            said.append(world.now_s)
            for number in range(200) if "number" in line else [0]:
                words = line.format(EVIL).format(number=number)
                world.proxy.near.write(framed(words))

    outcome = sweep(tmp_path, plan(), [], hooks=[say])
    assert said
    assert not any(letter in outcome.said for letter in "\x1b\x07\x9b")
    events = (tmp_path / "run/events.jsonl").read_text()
    assert not any(letter in events for letter in "\x1b\x07\x9b")
    if line.startswith("E"):
        assert "owned" in outcome.said
