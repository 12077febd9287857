"""The array type of the whole package."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]  # floats of 64 bits; a docstring gives the shape and the unit
