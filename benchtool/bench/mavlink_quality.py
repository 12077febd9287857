"""How good a link is: messages, losses, jitter of their arrival. Pure."""

from __future__ import annotations

from math import sqrt

from benchtool.bench.mavlink_frames import LinkCounts


class LinkQuality:
    """Count messages and measure how unevenly they arrive.

    Jitter is the standard deviation of arrival time minus the autopilot's own time, over steps from
    one message to the next (RFC 3550 smooths the same quantity).
    """

    def __init__(self) -> None:
        self.messages = self.lost = self.corrupt = self.duplicates = self.reordered = 0
        self._steps = 0
        self._squares_s2 = 0.0
        self._before: tuple[float, float] | None = None

    def count(self, counts: LinkCounts) -> None:
        """Add what came, what the sequence numbers miss, and what was thrown away."""
        self.messages += counts.messages
        self.lost += counts.lost
        self.corrupt += counts.corrupt
        self.duplicates += counts.duplicates
        self.reordered += counts.reordered

    def arrived(self, arrived_s: float, device_s: float) -> None:
        """Note when a message came and when it was made, each on its own clock."""
        if self._before is not None and device_s > self._before[1]:
            step_s = (arrived_s - self._before[0]) - (device_s - self._before[1])
            self._steps += 1
            self._squares_s2 += step_s**2
        self._before = (arrived_s, device_s)

    @property
    def jitter_s(self) -> float:
        """Standard deviation of the steps, 0 without any."""
        return sqrt(self._squares_s2 / self._steps) if self._steps else 0.0

    @property
    def lost_share(self) -> float:
        """Lost messages over all that were sent."""
        sent = self.messages + self.lost
        return self.lost / sent if sent else 0.0

    def facts(self) -> dict[str, str]:
        """Return it in words, for a run's facts."""
        return {
            "link_lost": f"{self.lost} of {self.messages + self.lost} messages",
            "link_duplicates": str(self.duplicates),
            "link_reordered": str(self.reordered),
            "link_jitter_ms": f"{1e3 * self.jitter_s:.2f}",
        }
