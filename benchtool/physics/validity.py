"""Where the image formulae hold, and what a simulator does below."""

from __future__ import annotations

import numpy as np

from benchtool.physics.expression import Quantity, expression


@expression
def clamped_height(z_m: Quantity, least_m: Quantity) -> Quantity:
    """Return the height, or the least at which a law is trusted where it is lower: m.

    For simulators only, which count where it acts. A fit never clamps: it leaves such points out
    by default and says how many they are.
    """
    return np.maximum(z_m, least_m)
