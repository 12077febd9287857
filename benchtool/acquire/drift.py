"""Anchors against each other: has the load cell drifted since the first one?"""

from __future__ import annotations

from benchtool.data.run.points import Point


class DriftWatch:
    """Compare every anchor with the first.

    Thrust is brought to the first anchor's summed squared speed before, so that a battery that
    sags is not taken for a load cell that drifts.

    Args:
        limit_N: change that asks for another tare; None never asks.
    """

    def __init__(self, limit_N: float | None) -> None:
        self._limit_N = limit_N
        self._first: Point | None = None

    def asks_for_tare(self, anchor: Point) -> str:
        """Return why a tare is due after this anchor; empty when none is."""
        if self._limit_N is None:
            return ""
        if self._first is None:
            self._first = anchor
            return ""
        scale = 1.0
        if self._first.sum_rpm2 > 0.0 and anchor.sum_rpm2 > 0.0:
            scale = self._first.sum_rpm2 / anchor.sum_rpm2
        change_N = anchor.thrust_N * scale - self._first.thrust_N
        if abs(change_N) <= self._limit_N:
            return ""
        return (
            f"anchor {anchor.repeat} has moved by {change_N:+.4g} N since the first, limit "
            f"{self._limit_N:g} N; the load cell is tared again"
        )
