"""What the bridge script stops the motor for, on a virtual clock: no sleep, no socket."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from benchtool.bench.rcbenchmark.lines import RAMP_MS, SILENCE_MS, bridge_text
from benchtool.virtual.bridge import VIRTUAL_1580
from tests.rcb.stand import GUI, RIG, needs_node

pytestmark = needs_node
LOWEST_US, TICK_MS, BLIND_MS = 1000.0, 20, 1000


class Clocked:
    """The script in a GUI whose time passes step by step."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self.now_ms = 0
        self.outputs: list[tuple[int, float]] = []  # time of the step's end, pulse
        self.answers: list[dict[str, Any]] = []
        self.ended = False

    def say(self, **what: object) -> None:
        """Send a line to the GUI."""
        assert self._process.stdin is not None
        print(json.dumps(what), file=self._process.stdin, flush=True)

    def step(self, *, word: str = "", thrust_N: float | None = 1.0) -> None:
        """Let a millisecond pass after a word of the host and a reading of the stand."""
        if word:
            self.say(word=word)
        if thrust_N is not None:
            reading = {"workingValue": thrust_N, "workingUnit": "n"}
            self.say(result={"thrust": reading})
        self.say(pass_ms=1)
        assert self._process.stdout is not None
        for line in self._process.stdout:
            told = json.loads(line)
            if "now_ms" in told:
                self.now_ms = told["now_ms"]
                return
            if "us" in told:
                self.outputs.append((self.now_ms, float(told["us"])))
            elif "sent" in told:
                self.answers.append(json.loads(told["sent"])["benchtool"])
            self.ended = self.ended or "ended" in told
        raise AssertionError("the script ended")

    def turn(self, pulse_us: float, for_ms: int) -> None:
        """Be a host that renews its pulse every 100 ms."""
        for ms in range(for_ms):
            self.step(word="" if ms % 100 else f"{pulse_us:g}")

    def steps(self, count: int, **what: Any) -> None:
        for _ in range(count):
            self.step(**what)

    @property
    def us(self) -> float:
        """The pulse that the output holds."""
        return self.outputs[-1][1]


@pytest.fixture
def script(tmp_path: Path) -> Iterator[Clocked]:
    path = tmp_path / "bridge.js"
    path.write_text(bridge_text(RIG, listen_port=1, host_port=2), encoding="utf-8")
    words = ["node", str(GUI), str(path), VIRTUAL_1580, "virtual"]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        yield Clocked(process)
        process.kill()


def test_a_host_that_falls_silent_has_its_motor_brought_down(script: Clocked) -> None:
    script.turn(1500.0, 1000)
    assert script.us == 1500.0
    spoken_ms = script.now_ms - 100  # the last word was said at the begin of the last 100 ms
    script.steps(SILENCE_MS + RAMP_MS + TICK_MS)
    falling = [(at, us) for at, us in script.outputs if at > spoken_ms]
    begun_ms, stood_ms = falling[0][0] - spoken_ms, falling[-1][0] - spoken_ms
    assert SILENCE_MS <= begun_ms <= SILENCE_MS + 2 * TICK_MS
    assert SILENCE_MS + RAMP_MS <= stood_ms <= SILENCE_MS + RAMP_MS + TICK_MS
    pulses = [us for _, us in falling]
    assert pulses == sorted(pulses, reverse=True)
    assert len(pulses) > 8
    assert script.us == LOWEST_US
    assert script.answers[-1]["why"].startswith("watchdog: no word for")
    # No pulse is taken until the host has said that it knows.
    script.step(word="1300")
    assert "send clear first" in script.answers[-2]["refused"]
    script.step(word="clear")
    script.step(word="1300")
    assert script.us == 1300.0


def test_words_of_nobody_are_no_heartbeat(script: Clocked) -> None:
    script.step(word="1300")
    for _ in range((SILENCE_MS + RAMP_MS) // 10 + 5):
        script.step(word="what is this")
        script.steps(9)
    assert script.us == LOWEST_US
    assert script.answers[-1]["why"].startswith("watchdog")


def test_a_stand_that_falls_silent_has_its_motor_brought_down(script: Clocked) -> None:
    script.turn(1300.0, 300)
    silent_ms = script.now_ms
    for ms in range(BLIND_MS + RAMP_MS + TICK_MS):
        script.step(word="" if ms % 100 or ms > BLIND_MS - 100 else "1300", thrust_N=None)
    assert script.us == LOWEST_US
    assert script.outputs[-1][0] - silent_ms <= BLIND_MS + RAMP_MS + TICK_MS
    script.step()
    assert script.answers[-1]["why"].startswith("silence: no reading for")


def test_a_limit_stops_at_once(script: Clocked) -> None:
    script.turn(1900.0, 150)
    broken_ms = script.now_ms
    script.step(thrust_N=99.0)
    assert script.outputs[-1] == (broken_ms, LOWEST_US)
    assert script.answers[-1]["why"].startswith("limit: thrust_N 99.00 against limit")


def test_a_stop_is_at_once_and_a_script_that_ends_puts_nothing_out(script: Clocked) -> None:
    script.turn(1300.0, 150)
    stopped_ms = script.now_ms
    script.step(word="stop")
    assert script.outputs[-1] == (stopped_ms, LOWEST_US)
    script.step(word="1200")
    script.say(stop=True)
    script.step(word="1300")
    assert script.ended
    script.steps(SILENCE_MS)
    assert script.us == 1200.0  # switched off since: nothing was put out again
