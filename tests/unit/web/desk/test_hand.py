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
    hand = Hand()
    hand.hold(FIRST, 0.0)
    assert hand.wanted(0.99 * PATIENCE_S) is FIRST
    assert not hand.fell_silent
    assert hand.wanted(1.01 * PATIENCE_S) is None
    assert hand.fell_silent
    assert hand.cuts == 1
    hand.hold(FIRST, 0.3)
    assert hand.wanted(0.3) is None
    hand.hold(SECOND, 0.4)
    assert hand.wanted(0.4) is SECOND


def test_a_stop_ends_the_press_that_is_still_held() -> None:
    hand = Hand()
    hand.hold(FIRST, 0.0)
    hand.cut()
    hand.cut()
    assert hand.cuts == 1
    hand.hold(FIRST, 0.05)
    assert hand.wanted(0.06) is None
    assert not hand.fell_silent


def test_a_hand_that_lets_go_by_itself_is_not_cut() -> None:
    hand = Hand()
    hand.hold(FIRST, 0.0)
    hand.release()
    assert hand.wanted(0.01) is None
    assert hand.cuts == 0
