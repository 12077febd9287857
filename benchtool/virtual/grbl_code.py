"""Modes, feed and offsets of a virtual stage, and the move that a block of G-code makes. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from benchtool.virtual.grbl_lines import Block, Refused
from benchtool.virtual.grbl_settings import AXES, FASTEST, VirtualSettings

_MM_PER_INCH = 25.4
_SYSTEMS = ("G54", "G55", "G56", "G57", "G58", "G59", "G28", "G30", "G92")
_ONCE_WITH_AXES = ("G10", "G92")


class CodeState:
    """Hold modes and offsets.

    Attributes:
        offsets: by name (G54, G28, G92), of each axis: mm.
        tool_mm: length of the tool, along Z.

    Args:
        settings: rates, steps and units.
    """

    def __init__(self, settings: VirtualSettings) -> None:
        self.offsets = {name: dict.fromkeys(AXES, 0.0) for name in _SYSTEMS}
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """Forget what a reset forgets."""
        self.offsets["G92"] = dict.fromkeys(AXES, 0.0)
        self.tool_mm = 0.0
        self._modal = {"motion": "G0", "distance": "G90", "units": "G21"}
        self._feed_mm_min = 0.0

    @property
    def offset_mm(self) -> dict[str, float]:
        """Work offset of each axis: what is added to work coordinates."""
        tool = {"Z": self.tool_mm}
        return {
            axis: self.offsets["G54"][axis] + self.offsets["G92"][axis] + tool.get(axis, 0.0)
            for axis in AXES
        }

    def move(
        self, block: Block, present_mm: Mapping[str, float]
    ) -> tuple[dict[str, float], float] | None:
        """Take a block and return target of each axis and feed of its move, None without one.

        Args:
            block: any but a dwell.
            present_mm: where the moves before it end.

        Raises:
            Refused: which error it is answered by; nothing is changed then.
        """
        codes, words = block.codes, block.words
        feed = words.get("F", self._feed_mm_min)
        modal = self._modal | {name: codes[name] for name in self._modal if name in codes}
        axes = [axis for axis in AXES if axis in words]
        once, motion = codes.get("once"), modal["motion"]
        move = None
        if once is not None:
            if axes and "motion" in codes and once in _ONCE_WITH_AXES:
                raise Refused(24)
            self._set_offset(once, words, present_mm)
        elif codes.get("length") == "G43.1":
            if axes != ["Z"]:
                raise Refused(37)
            self.tool_mm = words["Z"]
        elif motion == "G80" and axes:
            raise Refused(31)
        elif "override" in codes and motion not in ("G0", "G1"):
            raise Refused(30)
        elif (axes or "motion" in codes) and motion not in ("G0", "G80") and not feed:
            raise Refused(22)
        elif axes and motion not in ("G0", "G1"):
            raise Refused(35)  # neither arcs nor probes here
        elif axes:
            target_mm = self._target(block, modal, present_mm)
            rapid = min(self._settings.of(FASTEST, axis) for axis in axes)
            move = target_mm, rapid if motion == "G0" else feed
        self._modal, self._feed_mm_min = modal, feed
        return move

    def jog(self, block: Block, present_mm: Mapping[str, float]) -> tuple[dict[str, float], float]:
        """Return target and feed of a jog; it changes no modes.

        Raises:
            Refused: which error it is answered by.
        """
        if "once" in block.codes or "motion" in block.codes:
            raise Refused(28 if block.codes.get("once") == "G4" and "P" not in block.words else 16)
        if not block.words.get("F"):
            raise Refused(22)
        modal = {"distance": "G90", "units": "G21"} | dict(block.codes)
        return self._target(block, modal, present_mm), block.words["F"]

    def lines(self) -> list[str]:
        """Return what `$#` says."""
        settings = self._settings
        shown = [f"[{name}:{settings.places(self.offsets[name])}]" for name in _SYSTEMS]
        probe = settings.places(dict.fromkeys(AXES, 0.0))
        return [*shown, f"[TLO:{settings.length(self.tool_mm)}]", f"[PRB:{probe}:0]"]

    def modes(self) -> str:
        """Return what `$G` says."""
        return (
            f"[GC:{self._modal['motion']} G54 G17 {self._modal['units']} "
            f"{self._modal['distance']} G94 M5 M9 T0 F{self._feed_mm_min:g} S0]"
        )

    def _set_offset(
        self, code: str, words: Mapping[str, float], present_mm: Mapping[str, float]
    ) -> None:
        given = {axis: words[axis] for axis in AXES if axis in words}
        if code == "G10":
            if words.get("L") not in (2.0, 20.0):
                raise Refused(26)
            if not 0 <= words.get("P", 0.0) <= 6:
                raise Refused(29)
            self.offsets["G54"] |= given
        elif code == "G28.1":
            self.offsets["G28"] = dict(present_mm)
        elif code == "G92.1":
            self.offsets["G92"] = dict.fromkeys(AXES, 0.0)
        else:
            system = self.offsets["G54"]
            self.offsets["G92"] |= {a: present_mm[a] - system[a] - mm for a, mm in given.items()}

    def _target(
        self, block: Block, modal: Mapping[str, str], present_mm: Mapping[str, float]
    ) -> dict[str, float]:
        scale = _MM_PER_INCH if modal["units"] == "G20" else 1.0
        target_mm = {}
        for axis in AXES:
            if axis in block.words:
                mm = scale * block.words[axis]
                if "override" not in block.codes:
                    relative = modal["distance"] == "G91"
                    mm += present_mm[axis] if relative else self.offset_mm[axis]
                target_mm[axis] = self._settings.on_a_step(axis, mm)
        return target_mm
