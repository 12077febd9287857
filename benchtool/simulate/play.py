"""A play: the side from which a load was last approached, followed reading by reading."""

from __future__ import annotations

import numpy as np

from benchtool.core.array import Array


class Play:
    """Follow the side of a load behind a play of constant width, as dry friction makes it.

    It begins as after an unloading: a cell that has been loaded before.
    """

    def __init__(self, half_width_N: float) -> None:
        self._half_N = half_width_N
        self._shown_N = half_width_N

    def follow(self, load_N: Array) -> Array:
        """Return the side (m,) after each load in turn: +1 from below, -1 from above, or between.

        The load less side times half the width is what a cell behind the play shows.
        """
        shown_N, half_N = self._shown_N, self._half_N
        side = np.empty(len(load_N))
        for row, load in enumerate(load_N.tolist()):
            shown_N = min(max(shown_N, load - half_N), load + half_N)
            side[row] = (load - shown_N) / half_N
        self._shown_N = shown_N
        return side
