"""The hand on the throttle: it must say again and again that it holds on. Pure."""

from __future__ import annotations

import threading
from collections.abc import Callable

from benchtool.web.desk.asks import Hold, Release

SILENCE_S = 0.5
"""Dead-man time: motors go to zero so long after the page's last word that the button is held."""


class Hand:
    """Remember the last word of the hand; called from two threads.

    Args:
        ended: called with a tab and the reason when its press ends, but not by the hand.
        silence_s: dead-man time.
    """

    def __init__(
        self,
        ended: Callable[[str, str], object] = lambda tab, reason: None,
        silence_s: float = SILENCE_S,
    ) -> None:
        self._ended, self._silence_s = ended, silence_s
        self._last: tuple[Hold, float] | None = None
        self._over: dict[str, int] = {}
        self._lock = threading.Lock()

    def hold(self, hold: Hold, now_s: float) -> None:
        """Hear that the hand holds on. A press that was ended does not come back by being late."""
        with self._lock:
            if hold.press > self._over.get(hold.tab, -1):
                self._last = (hold, now_s)

    def release(self, release: Release) -> None:
        """End a press, also one whose first word is still on its way."""
        with self._lock:
            held = self._last[0] if self._last is not None else None
            ours = held is not None and held.tab == release.tab
            if held is not None and ours and held.press <= (release.press or held.press):
                self._last = None
                self._end(held.tab, held.press)
            if release.press is not None:
                self._end(release.tab, release.press)

    def _end(self, tab: str, press: int) -> None:
        self._over[tab] = max(press, self._over.get(tab, -1))

    def cut(self, reason: str) -> None:
        """End the present press although the hand may still hold on."""
        if (last := self._last) is not None:
            self.release(Release(last[0].tab, last[0].press))
            self._ended(last[0].tab, reason)

    def wanted(self, now_s: float) -> Hold | None:
        """Return what the hand wants; None when there is no hand, or it fell silent."""
        last = self._last
        if last is None:
            return None
        hold, heard_s = last
        line_s = now_s - heard_s
        silent_s = line_s + hold.age_s
        if silent_s <= self._silence_s:
            return hold
        where = "the page is too busy" if hold.age_s > line_s else "no beat came from the browser"
        self.cut(
            f"the button was not heard of for {1e3 * silent_s:.0f} ms, allowed are "
            f"{1e3 * self._silence_s:.0f} ms: {where}"
        )
        return None
