"""Words of a hostile device reach no terminal as commands and no page as elements."""

from __future__ import annotations

import pytest

from tests.faults.dialects import framed
from tests.faults.loop import World, plan, sweep

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
