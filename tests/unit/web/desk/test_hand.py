from __future__ import annotations

from benchtool.web.desk.asks import Hold
from benchtool.web.desk.hand import PATIENCE_S, Hand

FIRST, SECOND = Hold("a 1", 1300.0, (1, 2)), Hold("a 2", 1400.0, (1,))


def test_a_hand_that_is_heard_of_holds_on() -> None:
    hand = Hand()
    assert hand.wanted(0.0) is None
    for beat in range(20):
        hand.hold(FIRST, 0.05 * beat)
        assert hand.wanted(0.05 * beat + 0.04) is FIRST


def test_silence_lets_go_and_a_late_beat_of_that_press_does_not_come_back() -> None:
    ended: list[tuple[str, str]] = []
    hand = Hand(lambda press, reason: ended.append((press, reason)))
    hand.hold(FIRST, 0.0)
    assert hand.wanted(0.99 * PATIENCE_S) is FIRST
    assert ended == []
    assert hand.wanted(1.5 * PATIENCE_S) is None
    hand.hold(FIRST, 2.0 * PATIENCE_S)
    assert hand.wanted(2.0 * PATIENCE_S) is None
    ((press, reason),) = ended
    assert press == "a 1"
    assert f"for {1500.0 * PATIENCE_S:.0f} ms" in reason
    hand.hold(SECOND, 3.0 * PATIENCE_S)
    assert hand.wanted(3.0 * PATIENCE_S) is SECOND


def test_a_stop_ends_the_press_that_is_still_held() -> None:
    ended: list[tuple[str, str]] = []
    hand = Hand(lambda press, reason: ended.append((press, reason)))
    hand.hold(FIRST, 0.0)
    hand.cut("stopped from the page")
    hand.cut("stopped from the page")
    hand.hold(FIRST, 0.05)
    assert hand.wanted(0.06) is None
    assert ended == [("a 1", "stopped from the page")]


def test_a_hand_that_lets_go_by_itself_is_not_cut() -> None:
    ended: list[tuple[str, str]] = []
    hand = Hand(lambda press, reason: ended.append((press, reason)))
    hand.hold(FIRST, 0.0)
    hand.release()
    assert hand.wanted(0.01) is None
    assert ended == []
