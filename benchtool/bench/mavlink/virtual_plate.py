"""The plate of a virtual autopilot's world, which named values move; a real autopilot has none."""

from __future__ import annotations

from collections.abc import Callable

from benchtool.bench.mavlink.link import MavlinkLink
from benchtool.core.errors import StageError

AGAIN_S = 0.5  # a plate order that was not acknowledged is sent again after so long

ARRIVE_S = 120.0

MOVING, THERE, REFUSED = 1.0, 0.0, -1.0  # values of `plate_mov`


class VirtualPlate:
    """Send the plate somewhere and wait until it reports that it stands there.

    Attributes:
        states: values of `plate_mov` that have come, oldest first.
    """

    def __init__(self, link: MavlinkLink, now_s: Callable[[], float]) -> None:
        self.states: list[float] = []
        self._link, self._now_s = link, now_s

    def move(
        self,
        place: tuple[float, float, float],
        listen: Callable[[], None],
        refusal: Callable[[], str],
    ) -> None:
        """Move it to a distance m, lateral position m and tilt rad, listening all the while."""
        made = self._link.words.MAVLink_named_value_float_message
        begun_s, sent_s, moving = self._now_s(), -1e9, False
        while (now_s := self._now_s()) - begun_s < ARRIVE_S:
            if not moving and now_s - sent_s >= AGAIN_S:
                sent_s = now_s
                z_m, x_m, tilt_rad = place
                for axis, value in (("x", x_m), ("tilt", tilt_rad), ("z", z_m)):
                    self._link.send(made(0, f"plate_{axis}".encode(), value))
            listen()
            states, self.states = self.states, []
            for state in states:
                if state == REFUSED:
                    text = refusal() or "it does not say why"
                    raise StageError(f"the plate stays where it is: {text}")
                moving = moving or state == MOVING
                if moving and state == THERE:
                    return
        self._link.send(made(0, b"plate_halt", 1.0))
        raise StageError(
            f"the plate did not reach {place[0]:g} m within {ARRIVE_S:g} s and was halted; look at "
            f"the virtual bench"
        )
