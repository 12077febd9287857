"""What ends a run by itself on an autopilot, one cause at a time."""

from __future__ import annotations

import pytest

from benchtool.bench.mavlink.health import ARMED, Health, silence_of
from benchtool.bench.mavlink.messages import Message, dialect

WORDS = dialect()


def beat(armed: bool) -> Message:
    return WORDS.MAVLink_heartbeat_message(2, 3, 1 | (ARMED if armed else 0), 0, 3, 3)


def text(said: str, number: int = 0, chunk: int = 0) -> Message:
    message = WORDS.MAVLink_statustext_message(4, said.encode(), number, chunk)
    message.text = said
    return message


def driven(arms: bool = True) -> Health:
    health = Health(arms)
    health.drive(True, 10.0)
    return health


def test_disarming_ends_it() -> None:
    health = driven()
    health.beat(beat(armed=True), 10.5)
    assert health.take_fault() is None
    health.beat(beat(armed=False), 11.5)
    assert health.take_fault() == "the autopilot disarmed"
    assert health.take_fault() is None


def test_an_autopilot_that_never_arms_ends_it_after_a_while() -> None:
    health = driven()
    health.beat(beat(armed=False), 10.9)
    assert health.take_fault() is None
    health.beat(beat(armed=False), 11.9)
    assert health.take_fault() == "the autopilot stayed disarmed while a motor was commanded"


def test_one_that_tests_motors_disarmed_does_not() -> None:
    health = driven(arms=False)
    health.beat(beat(armed=False), 20.0)
    assert health.take_fault() is None


def test_nothing_ends_what_does_not_turn() -> None:
    health = Health(arms=True)
    health.beat(beat(armed=False), 20.0)
    health.text(text("Battery failsafe"))
    assert health.take_fault() is None
    assert health.texts == ["Battery failsafe"]


@pytest.mark.parametrize(
    "said",
    ["Battery 1 is low 9.1V used 20 mAh: failsafe", "Crash: Disarming", "Motor Test: Stopped",
     "Potential Thrust Loss (1)", "Emergency stop"],
)  # fmt: skip
def test_words_of_a_failsafe_end_it_in_the_autopilots_words(said: str) -> None:
    health = driven()
    health.text(text(said))
    assert health.take_fault() == said


@pytest.mark.parametrize("said", ["PreArm: Radio failsafe on", "EKF2 IMU0 is using GPS",
                                  "Radio failsafe cleared"])  # fmt: skip
def test_other_words_do_not(said: str) -> None:
    health = driven()
    health.text(text(said))
    assert health.take_fault() is None


def test_a_long_text_is_one() -> None:
    health = driven()
    health.text(text("x" * 44 + " fails", number=7, chunk=0))
    assert health.texts == []
    health.text(text("afe: battery", number=7, chunk=1))
    assert health.take_fault() == "x" * 44 + " failsafe: battery"


def test_a_restart_ends_it() -> None:
    health = driven()
    health.restarted()
    assert health.take_fault() == "the autopilot restarted"


def test_our_own_pause_is_nobodys_fault() -> None:
    health = driven()
    health.beat(beat(armed=True), 10.0)
    health.skip(5.0)
    assert health.silence_s(15.5) == 0.5


def test_silence_and_missing_heartbeats_are_told_apart() -> None:
    assert silence_of("mavlink:x", 0.5, 5.4) is None
    assert "sent nothing for 1.2 s, limit 1 s" in str(silence_of("mavlink:x", 1.2, 1.2))
    assert "no heartbeat came for 5.6 s, limit 5.5 s" in str(silence_of("mavlink:x", 0.1, 5.6))
