"""An address taken apart: its scheme, its place, its options as numbers within their ranges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from benchtool.core.errors import InputError


@dataclass(frozen=True, slots=True)
class Address:
    """Hold an address in its parts: `serial:COM12?baud=2000000` has place COM12, one option."""

    text: str
    scheme: str
    place: str
    options: Mapping[str, str] = field(default_factory=dict)

    def number(self, name: str, default: float, low: float, high: float) -> float:
        """Return an option as a number within its range, or its default."""
        if name not in self.options:
            return default
        given = self.options[name]
        try:
            value = float(given)
        except ValueError:
            raise InputError(
                f"option {name} of address {self.text!r} is {given!r}, not a number; "
                f"write {name}={default:g}"
            ) from None
        if not low <= value <= high:
            raise InputError(
                f"option {name} of address {self.text!r} is {given}, outside {low:g} to {high:g}; "
                f"write {name}={default:g}"
            )
        return value

    def whole(self, name: str, default: int, low: int, high: int) -> int:
        """Return an option as a whole number within its range, or its default."""
        value = self.number(name, default, low, high)
        if value != int(value):
            raise InputError(
                f"option {name} of address {self.text!r} is {value:g}, not a whole number; "
                f"write {name}={default}"
            )
        return int(value)
