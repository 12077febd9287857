"""What the bench process tells the page: whole snapshots, so that a page that comes late misses
nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from benchtool.bench.bench import Identity
from benchtool.core.rig import Rig


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """Say whether a bench is there.

    Attributes:
        status: "off", "opening" or "on".
        address: as it was asked for.
        session: counts connections; a new number means other channels and a new clock.
        identity, rig: who answers and what stands on it; None when off.
        reason: why there is none, empty when that was asked for.
    """

    status: Literal["off", "opening", "on"] = "off"
    address: str = ""
    session: int = 0
    identity: Identity | None = None
    rig: Rig | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """Tell people something once."""

    text: str
    is_error: bool = False


News = Connection | Said
