"""Refuse arrays that do not belong together before matplotlib fails on them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import InputError

Array = NDArray[np.float64]


def refuse_unequal(what: str, **arrays: Array | None) -> None:
    """Refuse one-dimensional arrays of different length; None stands for "not given"."""
    shapes = {name: np.shape(array) for name, array in arrays.items() if array is not None}
    if len(set(shapes.values())) > 1 or any(len(shape) != 1 for shape in shapes.values()):
        listed = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise InputError(
            f"{what} needs one-dimensional arrays of equal length, got {listed}; "
            f"give one value of each per point"
        )
