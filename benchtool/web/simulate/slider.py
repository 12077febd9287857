"""A number that the tab offers to change, with its range."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Slider:
    """Describe one slider.

    Attributes:
        name: as `--set` takes it, or an option's own name.
        label: for people, with the unit.
        low, high, step: what can be chosen; choices of the page, the command takes more.
        start: the simulation's own value; a number that stands there is not in the command.
        first: where the slider stands when it is first shown; at `start` when None.
    """

    name: str
    label: str
    low: float
    high: float
    step: float
    start: float
    first: float | None = None

    @property
    def decimals(self) -> int:
        """How many digits behind the point a value is shown with."""
        text = f"{self.step:.10f}".rstrip("0")
        return len(text.partition(".")[2])
