"""What the user says beside the file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from benchtool.data.repairs.imported import Window


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Hold what an import is told.

    Attributes:
        columns: column map for a CSV; None lets the header speak.
        flip: channels whose sign is turned.
        tare: channels whose reading at rest is taken off.
        scale: factors as CHANNEL=FACTOR.
        air_density_kg_m3: for files that hold coefficients.
        over: windows in which a rotor is over a surface.
        near_m: a distance sensor that reads less says that the vehicle is over a surface; None
            lets it say nothing.
    """

    columns: Path | None = None
    flip: tuple[str, ...] = ()
    tare: tuple[str, ...] = ()
    scale: tuple[str, ...] = ()
    air_density_kg_m3: float | None = None
    over: tuple[Window, ...] = ()
    near_m: float | None = None
