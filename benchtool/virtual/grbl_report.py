"""The status reports of a virtual stage: what each carries, and how often. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Set

from benchtool.virtual.grbl_settings import AXES, VirtualSettings

WCO_REST, WCO_BUSY, OV_REST, OV_BUSY = 10, 30, 10, 20
"""The work offset comes in every so-manyth report, the overrides in the one after (recorded)."""

BUSY = ("Home", "Run", "Hold", "Jog")
PINS = "XYZRHS"


class Reports:
    """Make reports; count when the seldom fields are due.

    Attributes:
        override: of the feed, percent.

    Args:
        settings: say what a report carries (`$10`) and in which unit (`$13`).
    """

    def __init__(self, settings: VirtualSettings) -> None:
        self.override = 100
        self._settings = settings
        self._wco = self._ov = 0

    def show_offset(self) -> None:
        """Let the next report carry the work offset."""
        self._wco = 0

    def change_override(self, percent: int) -> None:
        """Take another override of the feed; the next report carries it."""
        self.override = min(max(percent, 10), 200)
        self._ov = 0

    def text(
        self,
        state: str,
        place_mm: Mapping[str, float],
        offset_mm: Mapping[str, float],
        feed_mm_min: float,
        free: tuple[int, int],
        pins: Set[str],
    ) -> str:
        """Return a report.

        Args:
            state: as the stage says it.
            place_mm: machine position of each axis.
            offset_mm: of work coordinates.
            feed_mm_min: at present.
            free: places left for moves, and for bytes.
            pins: switches and buttons that are closed.
        """
        settings, mask = self._settings, int(self._settings[10])
        place_mm = {axis: settings.on_a_step(axis, mm) for axis, mm in place_mm.items()}
        if not mask & 1:
            place_mm = {axis: place_mm[axis] - offset_mm[axis] for axis in AXES}
        parts = [state, f"{'MPos' if mask & 1 else 'WPos'}:{settings.places(place_mm)}"]
        if mask & 2:
            parts.append(f"Bf:{free[0]},{free[1]}")
        parts.append(f"FS:{settings.feed(feed_mm_min)},0")
        if closed := "".join(pin for pin in PINS if pin in pins):
            parts.append(f"Pn:{closed}")
        busy = state.partition(":")[0] in BUSY
        if self._wco > 0:
            self._wco -= 1
        else:
            self._wco = (WCO_BUSY if busy else WCO_REST) - 1
            self._ov = self._ov or 1
            parts.append(f"WCO:{settings.places(offset_mm)}")
        if self._ov > 0:
            self._ov -= 1
        else:
            self._ov = (OV_BUSY if busy else OV_REST) - 1
            parts.append(f"Ov:{self.override},100,100")
        return f"<{'|'.join(parts)}>"
