"""Move the plate of a virtual autopilot's world; a real autopilot has no plate to move."""

from __future__ import annotations

from typing import Protocol

from benchtool.bench.mavlink.talk import MavlinkTalk
from benchtool.core.errors import StageError

AGAIN_S = 0.5
"""A place that was not taken note of is told again after so long (wall time)."""

ARRIVE_S = 120.0

ON_ITS_WAY, THERE, REFUSED = 1.0, 0.0, -1.0
"""What `plate_mov` says."""


class Listener(Protocol):
    """Be a bench that reads on while something else is waited for."""

    def now_s(self) -> float:
        """Return the bench's clock."""
        ...

    def listen(self, timeout_s: float) -> list[float]:
        """Read on and return what `plate_mov` said meanwhile."""
        ...

    def last_text(self) -> str:
        """Return what the autopilot said last."""
        ...


def move_virtual_plate(
    bench: Listener, talk: MavlinkTalk, place: tuple[float, float, float]
) -> None:
    """Tell the virtual world where the plate shall stand, and wait until it does.

    Args:
        bench: listens meanwhile.
        talk: sends.
        place: distance m, lateral position m, tilt rad.

    Raises:
        StageError: refused, or not there in time.
    """
    made = talk.words.MAVLink_named_value_float_message
    begun_s, sent_s, moving = bench.now_s(), -1e9, False
    while bench.now_s() - begun_s < ARRIVE_S:
        if not moving and bench.now_s() - sent_s >= AGAIN_S:
            sent_s = bench.now_s()
            z_m, x_m, tilt_rad = place
            for name, value in (("plate_x", x_m), ("plate_tilt", tilt_rad), ("plate_z", z_m)):
                talk.send(made(0, name.encode(), value))
        for state in bench.listen(0.05):
            if state == REFUSED:
                raise StageError(f"the plate stays where it is: {bench.last_text()}")
            moving = moving or state == ON_ITS_WAY
            if moving and state == THERE:
                return
    talk.send(made(0, b"plate_halt", 1.0))
    raise StageError(
        f"the plate did not reach {place[0]:g} m within {ARRIVE_S:g} s and was halted; look at the "
        f"virtual bench"
    )
