"""The hand on the throttle: it must say again and again that it holds on. Pure."""

from __future__ import annotations

from collections.abc import Callable

from benchtool.web.desk.asks import Hold

PATIENCE_S = 0.2
"""A hand that was not heard of for so long has let go. The page says it every 50 ms; with what the
loop and the wire need, motors are at zero within 0.3 s."""


class Hand:
    """Remember the last word of the hand; called from two threads, each call replaces one value.

    Args:
        ended: called with the name of a press and the reason when it ends, but not by the hand.
        patience_s: dead-man time.
    """

    def __init__(
        self,
        ended: Callable[[str, str], object] = lambda press, reason: None,
        patience_s: float = PATIENCE_S,
    ) -> None:
        self._ended, self._patience_s = ended, patience_s
        self._last: tuple[Hold, float] | None = None
        self._over = ""

    def hold(self, hold: Hold, now_s: float) -> None:
        """Hear that the hand holds on. A press that was ended does not come back by being late."""
        if hold.press != self._over:
            self._last = (hold, now_s)

    def release(self) -> None:
        """End the present press."""
        last, self._last = self._last, None
        if last is not None:
            self._over = last[0].press

    def cut(self, reason: str) -> None:
        """End the present press although the hand may still hold on."""
        if (last := self._last) is not None:
            self.release()
            self._ended(last[0].press, reason)

    def wanted(self, now_s: float) -> Hold | None:
        """Return what the hand wants; None when there is no hand, or it fell silent."""
        last = self._last
        if last is None:
            return None
        silent_s = now_s - last[1]
        if silent_s > self._patience_s:
            self.cut(
                f"nothing was heard of the button for {1e3 * silent_s:.0f} ms, allowed are "
                f"{1e3 * self._patience_s:.0f} ms; the browser or the line to it is too slow"
            )
            return None
        return last[0]
