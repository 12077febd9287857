"""From which side each visit of a sweep approached its load."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAME_PLACE = 5e-4
"""A plate that moved by less (m, or rad of tilt) stood still; a choice, above a stage's quantum."""

SAME_LOAD = 0.01
"""A summed squared speed that changed by less than this share did not change; a choice."""


def load_directions(time_s: Array, elapsed_s: Array, place: Array, load: Array) -> Array:
    """Return +1 for visits that came from a smaller load, -1 from a greater one (m,).

    Motors stand still while the plate moves, and during a tare, so that the first visit after
    either comes from below; levels at one place follow each other without a stop. A visit that
    repeats the level before it keeps that one's direction.

    Args:
        time_s: (m,) time since the run began; visits may stand in any order.
        elapsed_s: (m,) time since the last tare.
        place: (3, m) distance, lateral position (m) and tilt (rad) of the plate.
        load: (m,) what thrust goes with: summed squared speeds; 0 with every rotor still.
    """
    directions = np.zeros(len(time_s))
    before = -1
    for here in np.argsort(time_s, kind="stable"):
        if load[here] == 0.0:
            directions[here] = -1.0
        elif (
            before < 0
            or load[before] == 0.0
            or elapsed_s[here] < elapsed_s[before]
            or np.any(np.abs(place[:, here] - place[:, before]) > SAME_PLACE)
        ):
            directions[here] = 1.0
        elif abs(load[here] - load[before]) < SAME_LOAD * load[here]:
            directions[here] = directions[before]
        else:
            directions[here] = np.sign(load[here] - load[before])
        before = int(here)
    return directions
