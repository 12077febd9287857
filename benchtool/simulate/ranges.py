"""Range checks of numerical inputs of simulations."""

from __future__ import annotations

from benchtool.core.errors import InputError


def check_range(name: str, value: float, low: float, high: float) -> None:
    """Raise InputError if a number is outside its range or NaN."""
    if not low <= value <= high:
        raise InputError(f"{name} is {value:g}; allowed: {low:g} to {high:g}")
