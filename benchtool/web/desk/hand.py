"""The hand on the throttle: it must say again and again that it holds on. Pure."""

from __future__ import annotations

from benchtool.web.desk.asks import Hold

PATIENCE_S = 0.2
"""A hand that was not heard of for so long has let go. The page says it every 50 ms; with what the
loop and the wire need, motors are at zero within 0.3 s."""


class Hand:
    """Remember the last word of the hand; called from two threads, each call replaces one value.

    Attributes:
        fell_silent: the last press ended because nothing was heard of it any more.
        cuts: presses that have ended, but not by the hand itself.
    """

    def __init__(self, patience_s: float = PATIENCE_S) -> None:
        self._patience_s = patience_s
        self._last: tuple[Hold, float] | None = None
        self._over = ""
        self.fell_silent = False
        self.cuts = 0

    def hold(self, hold: Hold, now_s: float) -> None:
        """Hear that the hand holds on. A press that was ended does not come back by being late."""
        if hold.press != self._over:
            self._last = (hold, now_s)

    def release(self) -> None:
        """End the present press."""
        last, self._last = self._last, None
        if last is not None:
            self._over = last[0].press

    def cut(self) -> None:
        """End the present press although the hand may still hold on."""
        if self._last is not None:
            self.cuts += 1
        self.release()

    def wanted(self, now_s: float) -> Hold | None:
        """Return what the hand wants; None when there is no hand, or it fell silent."""
        last = self._last
        if last is None:
            return None
        if now_s - last[1] > self._patience_s:
            self.cut()
            self.fell_silent = True
            return None
        return last[0]
