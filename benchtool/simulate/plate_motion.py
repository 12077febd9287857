"""A plate on its way: constant feed towards the commanded place, with play in the distance axis."""

from __future__ import annotations

import numpy as np

from benchtool.core.array import Array

TILT_FEED_RAD_S = 0.2
"""Feed of the tilt axis; an assumption, since a rig states only the linear feed."""


class Axis:
    """Move one axis at constant feed.

    Attributes:
        target: where it was sent.
        shown: what the stage counts.
        true: where the plate stands, within half the play of what is shown.
    """

    def __init__(self, feed: float, start: float, play: float = 0.0) -> None:
        self.target = self.shown = self.true = start
        self._feed = feed
        self._half_play = 0.5 * play

    @property
    def moving(self) -> bool:
        """Whether the stage has not reached its target yet."""
        return self.shown != self.target

    def advance(self, elapsed_s: Array) -> tuple[Array, Array]:
        """Return counted and true positions (m,) at times since now, and stay at the last.

        The target does not change meanwhile, so the motion is monotonic and the true position
        follows it through the play exactly.
        """
        if not self.moving:
            still = np.ones_like(elapsed_s)
            return self.shown * still, self.true * still
        way = self.target - self.shown
        travelled = np.minimum(self._feed * elapsed_s, abs(way))
        shown = np.where(
            travelled >= abs(way), self.target, self.shown + np.copysign(travelled, way)
        )
        true = np.clip(self.true, shown - self._half_play, shown + self._half_play)
        self.shown, self.true = float(shown[-1]), float(true[-1])
        return shown, true
