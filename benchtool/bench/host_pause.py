"""Whether the host ran: after a pause its readings are late and its orders old. Pure."""

from __future__ import annotations

from benchtool.bench.bench import Identity
from benchtool.core.errors import HostPaused

LONGEST_S = 1.0
"""A pause above this ends a run whatever the device's watchdog allows; a choice."""


class Gaps:
    """Notice how long a loop that waits only briefly did not run.

    A command may take long because the line loses answers; its host ran all the while.

    Attributes:
        longest_s: longest time between two rounds since `begin`.
    """

    def __init__(self) -> None:
        self.begin(0.0)

    def begin(self, now_s: float) -> None:
        """Begin anew."""
        self._last_s, self.longest_s = now_s, 0.0

    def note(self, now_s: float) -> None:
        """Note that the loop runs."""
        self.longest_s = max(self.longest_s, now_s - self._last_s)
        self._last_s = now_s


class HostPause:
    """Compare when the host came back from waiting with when it had to.

    A host that is late by more than the device's watchdog has let its orders lapse.

    Args:
        identity: watchdog in wall time, speed of the bench's clock.
        now_s: on that clock.
    """

    def __init__(self, identity: Identity, now_s: float) -> None:
        self._limit_s = min(identity.watchdog_s, LONGEST_S)
        self._speed = identity.speed
        self._due_s = now_s

    def expect(self, now_s: float, wall_s: float = 0.0, bench_s: float = 0.0) -> None:
        """Expect the host back after a wait, given in wall time or on the bench's clock."""
        self._due_s = now_s + wall_s * self._speed + bench_s

    def late(self, now_s: float) -> HostPaused | None:
        """Return the error of a host that comes back too late, None otherwise."""
        late_s = (now_s - self._due_s) / self._speed
        return HostPaused(late_s, self._limit_s) if late_s > self._limit_s else None
