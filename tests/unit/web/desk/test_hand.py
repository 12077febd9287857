from __future__ import annotations

from benchtool.web.desk.asks import Hold, Release
from benchtool.web.desk.hand import SILENCE_S, Hand

FIRST, SECOND = Hold("a", 1, 1300.0, (1, 2)), Hold("a", 2, 1400.0, (1,))


def test_a_hand_that_is_heard_of_holds_on() -> None:
    hand = Hand()
    assert hand.wanted(0.0) is None
    for beat in range(20):
        hand.hold(FIRST, 0.05 * beat)
        assert hand.wanted(0.05 * beat + 0.04) is FIRST


def test_silence_lets_go_and_a_late_beat_of_that_press_does_not_come_back() -> None:
    ended: list[tuple[str, str]] = []
    hand = Hand(lambda tab, reason: ended.append((tab, reason)))
    hand.hold(FIRST, 0.0)
    assert hand.wanted(0.99 * SILENCE_S) is FIRST
    assert ended == []
    assert hand.wanted(1.5 * SILENCE_S) is None
    hand.hold(FIRST, 2.0 * SILENCE_S)
    assert hand.wanted(2.0 * SILENCE_S) is None
    ((tab, reason),) = ended
    assert tab == "a"
    assert f"for {1500.0 * SILENCE_S:.0f} ms" in reason
    assert "no beat came from the browser" in reason
    hand.hold(SECOND, 3.0 * SILENCE_S)
    assert hand.wanted(3.0 * SILENCE_S) is SECOND


def test_a_stop_ends_the_press_that_is_still_held() -> None:
    ended: list[tuple[str, str]] = []
    hand = Hand(lambda tab, reason: ended.append((tab, reason)))
    hand.hold(FIRST, 0.0)
    hand.cut("stopped from the page")
    hand.cut("stopped from the page")
    hand.hold(FIRST, 0.05)
    assert hand.wanted(0.06) is None
    assert ended == [("a", "stopped from the page")]


def test_a_hand_that_lets_go_by_itself_is_not_cut() -> None:
    ended: list[tuple[str, str]] = []
    hand = Hand(lambda tab, reason: ended.append((tab, reason)))
    hand.hold(FIRST, 0.0)
    hand.release(Release("a", 1))
    assert hand.wanted(0.01) is None
    assert ended == []


def test_a_beat_is_as_old_as_the_page_says() -> None:
    reasons: list[str] = []
    hand = Hand(lambda tab, reason: reasons.append(reason), silence_s=0.5)
    hand.hold(Hold("a", 1, 1300.0, (1,), age_s=0.4), 10.0)
    assert hand.wanted(10.09) is not None
    assert hand.wanted(10.11) is None
    assert "for 510 ms, allowed are 500 ms: the page is too busy" in reasons[0]


def test_a_press_that_was_let_go_never_turns_a_motor_however_late_its_beats_come() -> None:
    hand = Hand()
    hand.release(Release("a", 1))
    hand.hold(FIRST, 0.0)
    assert hand.wanted(0.0) is None
    hand.hold(SECOND, 0.1)
    # The word of the first release comes again, by the other line.
    hand.release(Release("a", 1))
    assert hand.wanted(0.1) is SECOND
    hand.release(Release("a", 2))
    hand.release(Release("a", 1))
    hand.hold(SECOND, 0.2)
    hand.hold(FIRST, 0.2)
    assert hand.wanted(0.2) is None


def test_a_page_that_is_gone_ends_its_own_press_only() -> None:
    hand = Hand()
    hand.hold(FIRST, 0.0)
    hand.release(Release("b"))
    assert hand.wanted(0.0) is FIRST
    hand.release(Release("a"))
    assert hand.wanted(0.0) is None
    hand.hold(FIRST, 0.1)
    assert hand.wanted(0.1) is None
