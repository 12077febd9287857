"""G-code, settings and reports of a virtual stage: lines to words, modes, moves. Pure.

As much of G-code as a stage needs: straight moves, dwells, offsets, units, distances.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass, field

_WORD = re.compile(r"([A-Z])([-+]?(?:\d+\.?\d*|\.\d+))")

LONGEST = 80
"""Characters of a line without blanks and comments."""

GROUPS = {
    "motion": "G0 G1 G2 G3 G38.2 G80",
    "once": "G4 G10 G28.1 G92 G92.1",
    "units": "G20 G21",
    "distance": "G90 G91",
    "plane": "G17",
    "feed": "G93 G94",
    "length": "G43.1 G49",
    "system": "G54",
    "override": "G53",
    "path": "G61",
    "spindle": "M3 M5",
    "coolant": "M9",
}
"""Codes of one group exclude each other in a line."""

_GROUP_OF = {code: group for group, codes in GROUPS.items() for code in codes.split()}


class Refused(Exception):
    """Carry the number of an error."""

    def __init__(self, number: int) -> None:
        self.number = number
        super().__init__(f"error:{number}")


@dataclass(frozen=True, slots=True)
class CodeBlock:
    """One line of G-code: codes by group, and the words with numbers."""

    codes: Mapping[str, str] = field(default_factory=dict)
    words: Mapping[str, float] = field(default_factory=dict)


def cleaned(line: bytes) -> str:
    """Return a line without blanks and comments, in capitals; refuse one that is too long."""
    text = re.sub(r"\([^)]*\)?|;.*", "", line.decode("ascii", "replace"))
    text = re.sub(r"[\s/\0]", "", text).upper()
    if len(text) > LONGEST:
        raise Refused(11)
    return text


def block_of(text: str) -> CodeBlock:
    """Return the codes and words of a cleaned line, or refuse it."""
    codes: dict[str, str] = {}
    words: dict[str, float] = {}
    at = 0
    while at < len(text):
        if not text[at].isalpha():
            raise Refused(1)
        found = _WORD.match(text, at)
        if found is None:
            raise Refused(2)
        letter, number = found[1], float(found[2])
        at = found.end()
        if letter in "GM":
            code, whole = f"{letter}{number:g}", f"{letter}{int(number)}"
            if code not in _GROUP_OF:
                raise Refused(23 if number % 1.0 and whole in _GROUP_OF and whole != "G61" else 20)
            if _GROUP_OF[code] in codes:
                raise Refused(21)
            codes[_GROUP_OF[code]] = code
        elif letter not in "FIJKLNPRSTXYZ":
            raise Refused(20)
        elif letter in words:
            raise Refused(25)
        else:
            words[letter] = number
            if letter in "FNPST" and number < 0.0:
                raise Refused(4)
            if letter == "N" and number > 9999999:
                raise Refused(27)
            if letter == "T" and number > 255:
                raise Refused(38)
    return CodeBlock(codes, words)


AXES = "XYZ"

SETTINGS: dict[int, float] = {
    0: 5, 1: 25, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 10: 1, 11: 0.010, 12: 0.002, 13: 0, 20: 1, 21: 0,
    22: 1, 23: 0, 24: 300, 25: 3000, 26: 25, 27: 1, 30: 1000, 31: 0, 32: 0, 100: 100, 101: 100,
    102: 100, 110: 9000, 111: 9000, 112: 9000, 120: 500, 121: 500, 122: 500, 130: 20, 131: 20,
    132: 1500,
}  # fmt: skip
"""Of the stage whose conversations were recorded."""

STEPS, FASTEST, ACCELERATION, TRAVEL = 100, 110, 120, 130

_WITH_DECIMALS = frozenset((11, 12, 24, 25, 27, *range(100, 140)))

_MM_PER_INCH = 25.4


class VirtualSettings:
    """Hold settings by number, and what follows from them."""

    def __init__(self, changed: Mapping[int, float]) -> None:
        self.values = SETTINGS | dict(changed)

    def __getitem__(self, number: int) -> float:
        return self.values[number]

    def of(self, first: int, axis: str) -> float:
        """Return the setting of an axis in a group that begins at `first`."""
        return self.values[first + AXES.index(axis)]

    def pace(self, axes: Iterable[str]) -> tuple[float, float]:
        """Return highest feed (mm/min) and acceleration (mm/s2) of axes that move together."""
        slowest = (min(self.of(group, axis) for axis in axes) for group in (FASTEST, ACCELERATION))
        return next(slowest), next(slowest)

    def on_a_step(self, axis: str, mm: float) -> float:
        """Return the step of an axis that is nearest to a position: mm."""
        return round(mm * self.of(STEPS, axis)) / self.of(STEPS, axis)

    def is_beyond(self, target_mm: Mapping[str, float]) -> bool:
        """Return whether a target lies outside of the soft limits."""
        outside = (not -self.of(TRAVEL, axis) <= mm <= 0.0 for axis, mm in target_mm.items())
        return bool(self.values[20]) and any(outside)

    def length(self, mm: float) -> str:
        mm += 0.0  # no minus zero
        return f"{mm / _MM_PER_INCH:.4f}" if self.values[13] else f"{mm:.3f}"

    def feed(self, mm_min: float) -> str:
        return f"{mm_min / _MM_PER_INCH:.1f}" if self.values[13] else f"{mm_min:.0f}"

    def places(self, place_mm: Mapping[str, float]) -> str:
        return ",".join(self.length(place_mm[axis]) for axis in AXES)

    def lines(self) -> list[str]:
        """Return the answer to `$$`."""
        return [
            f"${number}={value:.3f}" if number in _WITH_DECIMALS else f"${number}={value:.0f}"
            for number, value in sorted(self.values.items())
        ]

    def change(self, text: str) -> int:
        """Take a line such as `$132=1400` and return the number that it changed, or refuse it."""
        name, equals, value_text = text[1:].partition("=")
        if not name.isdigit():
            raise Refused(3 if name == "RST" else 2)
        if not equals or int(name) not in self.values:
            raise Refused(3)
        number, value = int(name), float(value_text)
        if value < 0.0:
            raise Refused(4)
        if number == 0 and value < 3:
            raise Refused(6)
        if number == 20 and value and not self.values[22]:
            raise Refused(10)
        self.values[number] = value
        if number == 22 and not value:
            self.values[20] = 0
        return number


_SYSTEMS = ("G54", "G55", "G56", "G57", "G58", "G59", "G28", "G30", "G92")

_ONCE_WITH_AXES = ("G10", "G92")


class CodeState:
    """Hold modes, offsets by name (G54, G28, G92) of each axis: mm, and the tool's length."""

    def __init__(self, settings: VirtualSettings) -> None:
        self.offsets = {name: dict.fromkeys(AXES, 0.0) for name in _SYSTEMS}
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        self.offsets["G92"] = dict.fromkeys(AXES, 0.0)
        self.tool_mm = 0.0
        self._modal = {"motion": "G0", "distance": "G90", "units": "G21"}
        self._feed_mm_min = 0.0

    @property
    def offset_mm(self) -> dict[str, float]:
        """Work offset of each axis: what is added to work coordinates."""
        tool, system, shift = {"Z": self.tool_mm}, self.offsets["G54"], self.offsets["G92"]
        return {axis: system[axis] + shift[axis] + tool.get(axis, 0.0) for axis in AXES}

    def move(
        self, block: CodeBlock, present_mm: Mapping[str, float]
    ) -> tuple[dict[str, float], float] | None:
        """Take a block and return target of each axis and feed of its move, None without one.

        Args:
            present_mm: where the moves before it end.
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

    def jog(
        self, block: CodeBlock, present_mm: Mapping[str, float]
    ) -> tuple[dict[str, float], float]:
        """Return target and feed of a jog, or refuse it; it changes no modes."""
        if "once" in block.codes or "motion" in block.codes:
            raise Refused(28 if block.codes.get("once") == "G4" and "P" not in block.words else 16)
        if not block.words.get("F"):
            raise Refused(22)
        modal = {"distance": "G90", "units": "G21"} | dict(block.codes)
        return self._target(block, modal, present_mm), block.words["F"]

    def lines(self) -> list[str]:
        """Return the answer to `$#`."""
        settings = self._settings
        shown = [f"[{name}:{settings.places(self.offsets[name])}]" for name in _SYSTEMS]
        probe = settings.places(dict.fromkeys(AXES, 0.0))
        return [*shown, f"[TLO:{settings.length(self.tool_mm)}]", f"[PRB:{probe}:0]"]

    def modes(self) -> str:
        """Return the answer to `$G`."""
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
        self, block: CodeBlock, modal: Mapping[str, str], present_mm: Mapping[str, float]
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


WCO_REST, WCO_BUSY, OV_REST, OV_BUSY = 10, 30, 10, 20
"""The work offset comes in every so-manyth report, the overrides in the one after (recorded)."""

BUSY = ("Home", "Run", "Hold", "Jog")
PINS = "XYZRHS"


class Reports:
    """Make reports as settings say (`$10`, `$13`); count when the seldom fields are due."""

    def __init__(self, settings: VirtualSettings) -> None:
        self.override = 100  # of the feed, percent
        self._settings = settings
        self._wco = self._ov = 0

    def show_offset(self) -> None:
        """Let the next report carry the work offset."""
        self._wco = 0

    def change_override(self, change: int | None) -> None:
        """Change the override of the feed, None back to 100 %; the next report carries it."""
        self.override = 100 if change is None else min(max(self.override + change, 10), 200)
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
        """Return a report; `pins` are the switches and buttons that are closed."""
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
