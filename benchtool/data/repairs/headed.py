"""Split a header cell into its name and its unit: "Thrust (gf)", "weight[g]", "thrust_N"."""

from __future__ import annotations

import re
from dataclasses import dataclass

_WITH_UNIT = re.compile(r"(?P<name>.*?)\s*[(\[](?P<unit>[^()\[\]]*)[)\]]")


@dataclass(frozen=True, slots=True)
class Head:
    """Hold a column's name and unit as the header writes them; the unit may be missing."""

    name: str
    unit: str | None

    @property
    def text(self) -> str:
        """Both together."""
        return self.name if self.unit is None else f"{self.name} [{self.unit}]"


def head_of(cell: str) -> Head:
    """Return what a header cell says."""
    cell = cell.strip()
    found = _WITH_UNIT.fullmatch(cell)
    if found is None or not found["name"]:
        return Head(cell, None)
    return Head(found["name"].strip(), found["unit"].strip())
