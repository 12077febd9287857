"""The numbered settings of a virtual stage. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from benchtool.virtual.grbl_lines import Refused

AXES = "XYZ"

SETTINGS: dict[int, float] = {
    0: 5, 1: 25, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 10: 1, 11: 0.010, 12: 0.002, 13: 0, 20: 1, 21: 0,
    22: 1, 23: 0, 24: 300, 25: 3000, 26: 25, 27: 1, 30: 1000, 31: 0, 32: 0, 100: 100, 101: 100,
    102: 100, 110: 9000, 111: 9000, 112: 9000, 120: 500, 121: 500, 122: 500, 130: 20, 131: 20,
    132: 1500,
}  # fmt: skip
"""Of the stage whose conversations were recorded."""

STEPS, FASTEST, ACCELERATION, TRAVEL = 100, 110, 120, 130
_WITH_DECIMALS = frozenset((11, 12, 24, 25, 27, *range(100, 140)))
_MM_PER_INCH = 25.4


class VirtualSettings:
    """Hold settings by number, and what follows from them.

    Attributes:
        values: by number.
    """

    def __init__(self, changed: Mapping[int, float]) -> None:
        self.values = SETTINGS | dict(changed)

    def __getitem__(self, number: int) -> float:
        return self.values[number]

    def of(self, first: int, axis: str) -> float:
        """Return the setting of an axis in a group that begins at `first`."""
        return self.values[first + AXES.index(axis)]

    def on_a_step(self, axis: str, mm: float) -> float:
        """Return the step of an axis that is nearest to a position: mm."""
        return round(mm * self.of(STEPS, axis)) / self.of(STEPS, axis)

    def is_beyond(self, target_mm: Mapping[str, float]) -> bool:
        """Return whether a target lies outside of the soft limits."""
        outside = (not -self.of(TRAVEL, axis) <= mm <= 0.0 for axis, mm in target_mm.items())
        return bool(self.values[20]) and any(outside)

    def length(self, mm: float) -> str:
        """Return a length as reports show it, in mm or inches."""
        mm += 0.0  # no minus zero
        return f"{mm / _MM_PER_INCH:.4f}" if self.values[13] else f"{mm:.3f}"

    def feed(self, mm_min: float) -> str:
        """Return a feed as reports show it."""
        return f"{mm_min / _MM_PER_INCH:.1f}" if self.values[13] else f"{mm_min:.0f}"

    def places(self, place_mm: Mapping[str, float]) -> str:
        """Return positions of all axes as reports show them."""
        return ",".join(self.length(place_mm[axis]) for axis in AXES)

    def lines(self) -> list[str]:
        """Return what `$$` says."""
        return [
            f"${number}={value:.3f}" if number in _WITH_DECIMALS else f"${number}={value:.0f}"
            for number, value in sorted(self.values.items())
        ]

    def change(self, text: str) -> int:
        """Take a line such as `$132=1400` and return the number that it changed.

        Raises:
            Refused: which error it is answered by.
        """
        name, equals, value_text = text[1:].partition("=")
        if not name.isdigit():
            raise Refused(3 if name == "RST" else 2)
        if not equals or int(name) not in self.values:
            raise Refused(3)
        number, value = int(name), float(value_text)
        if value < 0.0:
            raise Refused(4)
        if number == 0 and value < 3:
            raise Refused(6)
        if number == 20 and value and not self.values[22]:
            raise Refused(10)
        self.values[number] = value
        if number == 22 and not value:
            self.values[20] = 0
        return number
