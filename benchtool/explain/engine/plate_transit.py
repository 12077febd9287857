"""Where a plate is on its way in or out, and nothing tells how much of each disc it covers.

A reading of distance jumps from parked to near in one row while the plate takes half a second to
slide in. Taken for all in or all out meanwhile, ground effect is wrong by its whole size, twenty
times the noise of an encoder, and no effect explains it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from benchtool.simulate.pitch.replay import PARKED_FROM_M

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

READ_S = 0.1
"""Two readings of a sensor that reads twenty times a second; a guess where nothing says."""

TRANSIT_S = 0.5 + READ_S
"""How long before and after its distance jumps a plate may cover a part of a disc, where nobody
says how fast it is: plates of shipped schedules take half a second. Before as well, because a plate
on its way out is still read. A choice."""

BLINK_S = 0.2
"""A distance that comes and goes within half of this is a missed echo, no plate that moves."""


def on_its_way(plate_m: Array, rate_Hz: float, reach_s: float = TRANSIT_S) -> tuple[Mask, int]:
    """Return the rows (n,) in which a plate slides in or out, and how often it does.

    Args:
        plate_m: (n,) distance, held between readings: m.
        rate_Hz: rows per second.
        reach_s: how long before and after a jump the plate may be on its way.
    """
    width = 2 * round(0.5 * BLINK_S * rate_Hz) + 1
    under = median_filter((plate_m < PARKED_FROM_M).astype(np.uint8), size=width, mode="nearest")
    jumps = np.flatnonzero(np.diff(under.astype(np.int8))) + 1
    reach = round(reach_s * rate_Hz)
    mask = np.zeros(len(plate_m), bool)
    for row in jumps:
        mask[max(row - reach, 0) : row + reach] = True
    return mask, len(jumps)
