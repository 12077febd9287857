"""What ends a run by itself on an autopilot, one cause at a time."""

from __future__ import annotations

import pytest

from benchtool.bench.mavlink.health import ARMED, Health, silence_of
from benchtool.bench.mavlink.messages import Message, dialect

WORDS = dialect()
LONG = "x" * 44 + " fails"
FAILSAFES = (
    *("Battery 1 is low 9.1V used 20 mAh: failsafe", "Crash: Disarming", "Motor Test: Stopped"),
    *("Potential Thrust Loss (1)", "Emergency stop"),
)


def beat(armed: bool) -> Message:
    return WORDS.MAVLink_heartbeat_message(2, 3, 1 | (ARMED if armed else 0), 0, 3, 3)


def say(health: Health, said: str, number: int = 0, chunk: int = 0) -> None:
    message = WORDS.MAVLink_statustext_message(4, said.encode(), number, chunk)
    message.text = said
    health.text(message)


@pytest.mark.parametrize(
    ("arms", "beats", "texts", "fault"),
    [
        (True, [(10.5, True)], [], None),
        (True, [(10.5, True), (11.5, False)], [], "the autopilot disarmed"),
        (True, [(10.9, False)], [], None),
        (True, [(11.9, False)], [], "the autopilot stayed disarmed while a motor was commanded"),
        (False, [(20.0, False)], [], None),  # one that tests motors disarmed
        *[(True, [], [said], said) for said in FAILSAFES],
        *[(True, [], [said], None) for said in ("PreArm: Radio failsafe on", "EKF2 IMU0 uses GPS")],
        (True, [], ["Radio failsafe cleared"], None),
    ],
)
def test_what_ends_a_run(
    arms: bool, beats: list[tuple[float, bool]], texts: list[str], fault: str | None
) -> None:
    health, at_rest = Health(arms), Health(arms)
    health.drive(True, 10.0)
    for each in (health, at_rest):
        for time_s, armed in beats:
            each.beat(beat(armed), time_s)
        for text in texts:
            say(each, text)
    assert health.take_fault() == fault
    assert health.take_fault() is None
    assert at_rest.take_fault() is None  # nothing ends what does not turn
    assert at_rest.texts == texts


def test_a_long_text_is_one() -> None:
    health = Health(True)
    health.drive(True, 10.0)
    say(health, LONG, number=7, chunk=0)
    assert health.texts == []
    say(health, "afe: battery", number=7, chunk=1)
    assert health.take_fault() == "x" * 44 + " failsafe: battery"


def test_a_restart_ends_it_and_our_own_pause_is_nobodys_fault() -> None:
    health = Health(True)
    health.drive(True, 10.0)
    health.beat(beat(armed=True), 10.0)
    health.skip(5.0)
    assert health.silence_s(15.5) == 0.5
    health.restarted()
    assert health.take_fault() == "the autopilot restarted"


def test_silence_and_missing_heartbeats_are_two_things() -> None:
    assert silence_of("mavlink:x", 0.5, 5.4) is None
    assert "sent nothing for 1.2 s, limit 1 s" in str(silence_of("mavlink:x", 1.2, 1.2))
    assert "no heartbeat came for 5.6 s, limit 5.5 s" in str(silence_of("mavlink:x", 0.1, 5.6))
