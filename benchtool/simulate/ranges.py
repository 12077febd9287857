"""Ranges that numbers of a simulation must lie in."""

from __future__ import annotations

from benchtool.core.errors import InputError


def refuse_outside(name: str, value: float, low: float, high: float) -> None:
    """Refuse a number outside its range, or none at all.

    Raises:
        InputError: it names number, value and range.
    """
    if not low <= value <= high:
        raise InputError(f"{name} is {value:g}; give {low:g} to {high:g}")
