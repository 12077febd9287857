"""The virtual autopilot beside a real ArduCopter 4.6.2: the same orders, the same answers."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np
import pytest

from benchtool.bench.mavlink.frames import Message
from benchtool.virtual.autopilot import VirtualAutopilot
from benchtool.virtual.firmware import Firmware
from tests.wire.recorded_autopilot import (
    Chunk,
    chunks_of,
    facts_of,
    folder_of,
    messages_of,
    names_of,
    parser_of,
)
from tests.wire.still_plant import StillPlant, still_hello

TICK_S = 0.02
WITHIN_S = 0.25
"""Between the recorded and the virtual change of an output or a text: the recorder's machine was
busy, and took up to 0.181 s from an order to its pulse."""


class FourMotors(StillPlant):
    """Four motors, two of which no channel shows."""

    def command_pwm(self, pwm_us: np.ndarray) -> None:
        self.pwm_us = np.array(pwm_us[:2], float)


@dataclass(slots=True)
class Answers:
    """Hold what an autopilot answered, with times."""

    acks: list[tuple[int, int]]
    texts: list[tuple[float, int, str]]
    outputs: list[tuple[float, tuple[int, ...]]]


def answers_of(messages: list[tuple[float, Message]]) -> Answers:
    """Give acknowledgements and texts of messages, in order."""
    acks = [(m.command, m.result) for _, m in messages if m.get_type() == "COMMAND_ACK"]
    texts = [(t, m.severity, m.text) for t, m in messages if m.get_type() == "STATUSTEXT"]
    return Answers(acks, texts, [])


def recorded(chunks: list[Chunk], until_s: float) -> Answers:
    """Give what the real one answered."""
    parser = parser_of()
    found = [
        (chunk.time_s, message)
        for chunk in chunks
        if not chunk.host and chunk.time_s < until_s
        for message in messages_of(chunk.data, parser)
    ]
    return answers_of(found)


def virtual(chunks: list[Chunk], until_s: float) -> Answers:
    """Give what the virtual one answers to the bytes of the recorded host, at their times."""
    limits = {**still_hello().limits, "pwm_us": 2000.0}
    hello = still_hello(n_rotors=4, simulated=True, limits=limits)
    autopilot = VirtualAutopilot(Firmware(FourMotors(), hello), "ardupilot")
    parser, found, outputs = parser_of(), [], []
    now_s = 0.0
    said = b""
    # What a host says with its last breath is answered to nobody.
    heard_s = max(chunk.time_s for chunk in chunks if not chunk.host)
    waiting = [chunk for chunk in chunks if chunk.host and chunk.time_s < min(until_s, heard_s)]
    while now_s < until_s:
        while waiting and waiting[0].time_s <= now_s:
            said += autopilot.receive(waiting.pop(0).data, now_s)
        news, samples = autopilot.tick(1, now_s)
        said += news + b"".join(samples)
        found += [(now_s, message) for message in messages_of(said, parser)]
        said = b""
        shown = autopilot.outputs_us[:4]
        if not outputs or outputs[-1][1] != shown:
            outputs.append((now_s, shown))
        now_s += TICK_S
    answers = answers_of(found)
    answers.outputs = outputs
    return answers


def at(outputs: list[tuple[float, tuple[int, ...]]], time_s: float) -> tuple[int, ...]:
    """Give what outputs showed at a time."""
    before = [shown for changed_s, shown in outputs if changed_s <= time_s]
    return before[-1] if before else (1000,) * 4


OWN = ("PreArm: ", "Radio Failsafe", "Battery", "EKF3", "AHRS", "Barometer", "RC7", "GPS 1",
       "Disarming motors", "Arming motors")  # fmt: skip
"""What the virtual one has no sensors for: its texts come on their own account."""

NAMES = names_of()

NOT_IMITATED = {
    "e3_motor_test_on_an_armed_vehicle": "arming by command, which a plate bench has not",
    "f7_only_autopilot_bytes_lost": "answers that were lost, and are in no recording",
    "h1_autopilot_killed_and_restarted": "a loss of power, which nothing on the wire shows",
    "i1_parameters_and_intervals": "messages that no bench requests",
    "j2_check_safety_switch_on": "a safety switch that was pressed before the recording began",
    "j3_during_boot": "orders during a boot that began before the recording did",
    "k3_57600_all_streams": "messages that no bench requests",
    "k6_57600_uart_all_streams": "messages that no bench requests",
    "l1_through_mavproxy": "a router that answers by itself",
    "l1_through_mavproxy_patched": "a router that answers by itself",
    "q1_two_hosts": "orders that came through another port",
}

UNTIL_S = {"h2_reboot_command": 7.6, "j1_refusals": 11.0, "k1_57600_check": 8.6}
"""Until when they do what a virtual bench can do: what was set over another port (radio, battery)
is unknown to it, and what 57,600 baud had not carried at the end is not in the recording."""

CUT = (
    *("f1_host_killed", "f3_cable_pulled_silent", "f4_connection_closed"),
    *("f5_cable_pulled_benchtool", "k4_57600_uart_check"),
)
UNHEARD = dict.fromkeys(CUT, (6, "finished motor test"))
"""What was said when nobody was there any more."""


def test_no_conversation_is_left_out(reference_data):
    assert len(NAMES) == 59
    assert set(NAMES) == set(facts_of(folder_of(reference_data)))
    assert {*NOT_IMITATED, *UNTIL_S, *UNHEARD} <= set(NAMES)


@pytest.mark.parametrize("name", [name for name in NAMES if name not in NOT_IMITATED] or ["none"])
def test_it_answers_as_the_real_one(reference_data, name):
    folder = folder_of(reference_data)
    chunks = chunks_of(folder, name)
    until_s = min(UNTIL_S.get(name, inf), chunks[-1].time_s + 1.0)
    real, ours = recorded(chunks, until_s), virtual(chunks, until_s)
    assert ours.acks == real.acks
    texts = [(severity, text) for _, severity, text in real.texts if not text.startswith(OWN)]
    if name in UNHEARD:
        texts.append(UNHEARD[name])
    assert [(severity, text) for _, severity, text in ours.texts] == texts
    timeline = [(t, tuple(us)) for t, us in facts_of(folder)[name]["outputs_1_to_4"]]
    changes_s = [changed_s for changed_s, _ in (*timeline, *ours.outputs)]
    for step in range(int(until_s / TICK_S)):
        time_s = TICK_S * step
        if min((abs(time_s - changed_s) for changed_s in changes_s), default=9.0) > WITHIN_S:
            assert at(ours.outputs, time_s) == at(timeline, time_s), f"at {time_s:.2f} s"
