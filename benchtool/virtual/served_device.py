"""The seam between a virtual device and the link that it is served on: bytes in, bytes out."""

from __future__ import annotations

from typing import Protocol


class ServedDevice(Protocol):
    """Be a device without a port; wall time is handed in."""

    @property
    def speed(self) -> float:
        """Device seconds per wall second."""
        ...

    @property
    def greeted_s(self) -> float | None:
        """Wall time at which the present host came, None before any."""
        ...

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Take what arrived and return the answers."""
        ...

    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        """Run n ticks; return what must get through, and frames that may be dropped."""
        ...

    def tell_dropped(self, count: int) -> bytes:
        """Return the news that so many frames were dropped since the host came."""
        ...
