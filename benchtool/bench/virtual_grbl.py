"""A virtual G-code stage: what Grbl 1.1h answers, and what it does not, on a clock handed in. Pure.

After unmodified Grbl 1.1h: silent while homing, silent after a soft limit until it is reset, `ok`
for what is queued, `~` ignored until a hold stands. It knows as much G-code as a stage needs.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

BANNER = "\r\nGrbl 1.1h ['$' for help]"
LOCKED = "[MSG:'$H'|'$X' to unlock]"

PULL_OFF_MM = 1.0
HOMING_S = 4.0
SLOWING_S = 0.1
"""From `!` to standstill; a guess, a stage at 100 mm/s with 1000 mm/s2."""

SETTINGS: dict[int, float] = {
    10: 1, 13: 0, 20: 1, 21: 0, 22: 1, 23: 0, 24: 300, 25: 3000, 26: 25, 27: PULL_OFF_MM,
    100: 100, 101: 100, 102: 100, 110: 9000, 111: 9000, 112: 9000, 120: 500, 121: 500, 122: 500,
}  # fmt: skip
"""Of the stage whose conversations were recorded."""

OFFSET_EVERY = 10
"""Every so many reports the work offset is told."""

_WORD = re.compile(r"([A-Z])([-+]?(?:\d+\.?\d*|\.\d+))")
_KNOWN = {"G0", "G1", "G4", "G21", "G53", "G90"}


@dataclass(frozen=True, slots=True)
class _Step:
    """One thing that is queued: a move, or a dwell that answers when all before it is done."""

    target_mm: Mapping[str, float] | None = None
    feed_mm_s: float = 0.0


class VirtualGrbl:
    """Be a stage with axes X, Y and Z, whose machine positions go from minus their travel to 0.

    Attributes:
        position_mm: of each axis.

    Args:
        travel_mm: of each axis.
        at_mm: where Z stands when the power comes on.
    """

    def __init__(self, travel_mm: Mapping[str, float], at_mm: float = -PULL_OFF_MM) -> None:
        self.position_mm = dict.fromkeys("XYZ", -PULL_OFF_MM) | {"Z": at_mm}
        self._travel_mm = dict(travel_mm)
        self._now_s = 0.0
        self._queue: list[_Step] = []
        self._home_until_s: float | None = None
        self._hold_since_s: float | None = None
        self._locked = True
        self._deaf = False
        self._feed_mm_s = 0.0
        self._reports = 0
        self._line = b""
        self._said: list[str] = [BANNER, LOCKED]

    def step(self, data: bytes, now_s: float) -> bytes:
        """Let time pass until `now_s`, take what arrived, and return what is said."""
        self._advance(max(now_s - self._now_s, 0.0))
        self._now_s = max(now_s, self._now_s)
        for byte in data:
            self._take(bytes([byte]))
        self._finish()
        said, self._said = self._said, []
        return "".join(f"{line}\r\n" for line in said).encode("ascii")

    @property
    def state(self) -> str:
        """Idle, Run, Hold:1 (slowing down), Hold:0, Home or Alarm."""
        if self._home_until_s is not None:
            return "Home"
        if self._locked or self._deaf:
            return "Alarm"
        if self._hold_since_s is not None:
            return f"Hold:{int(self._now_s - self._hold_since_s < SLOWING_S)}"
        return "Run" if self._queue else "Idle"

    def _take(self, byte: bytes) -> None:
        if byte == b"\x18":
            self._reset()
        elif self._deaf or self._home_until_s is not None:
            pass  # Neither a question nor a line has an answer now.
        elif byte == b"?":
            self._said.append(self._report())
        elif byte == b"!":
            if self.state == "Run":
                self._hold_since_s = self._now_s
        elif byte == b"~":
            if self.state == "Hold:0":
                self._hold_since_s = None
        elif byte in (b"\n", b"\r"):
            line, self._line = self._line.decode("ascii", "replace").strip(), b""
            if line:
                self._obey(line.upper().replace(" ", ""))
        else:
            self._line += byte

    def _reset(self) -> None:
        homing, moving = self._home_until_s is not None, self.state in ("Run", "Hold:1")
        if homing or moving:
            self._said.append("ALARM:6" if homing else "ALARM:3")
            self._locked = True
        elif self._deaf:
            self._locked = True
        self._queue.clear()
        self._home_until_s = self._hold_since_s = None
        self._deaf, self._line, self._feed_mm_s = False, b"", 0.0
        self._said += [BANNER, *([LOCKED] if self._locked else [])]

    def _obey(self, line: str) -> None:
        if line == "$H":
            if self._queue:
                self._said.append("error:8")
            else:
                self._home_until_s = self._now_s + HOMING_S
        elif line == "$X":
            self._said += ["[MSG:Caution: Unlocked]", "ok"] if self._locked else ["ok"]
            self._locked = False
        elif line == "$I":
            self._said += ["[VER:1.1h.20190830:virtual]", "[OPT:V,15,128]", "ok"]
        elif line == "$$" and not self._queue:
            settings = SETTINGS | {130 + i: mm for i, mm in enumerate(self._travel_mm.values())}
            self._said += [*(f"${number}={value:g}" for number, value in settings.items()), "ok"]
        elif line.startswith("$"):
            self._said.append("error:8" if self._queue else "ok")
        elif self._locked:
            self._said.append("error:9")
        else:
            self._move(line)

    def _move(self, line: str) -> None:
        words = _WORD.findall(line)
        if "".join(letter + number for letter, number in words) != line:
            self._said.append("error:2" if line[:1].isalpha() else "error:1")
            return
        codes = {f"G{float(number):g}" for letter, number in words if letter == "G"}
        if codes - _KNOWN:
            self._said.append("error:20")
            return
        target_mm = {a: float(number) for a, number in words if a in self.position_mm}
        self._feed_mm_s = next((float(n) / 60.0 for a, n in words if a == "F"), self._feed_mm_s)
        if "G4" in codes:
            self._queue.append(_Step())
            return
        if target_mm and not self._feed_mm_s:
            self._said.append("error:22")
            return
        if any(not -self._travel_mm[axis] <= mm <= 0.0 for axis, mm in target_mm.items()):
            self._said += ["ALARM:2", "[MSG:Reset to continue]"]
            self._queue.clear()
            self._deaf = True
            return
        if target_mm:
            self._queue.append(_Step(target_mm, self._feed_mm_s))
        self._said.append("ok")

    def _advance(self, left_s: float) -> None:
        if self._hold_since_s is not None or self._home_until_s is not None:
            return
        while self._queue and left_s > 0.0:
            step = self._queue[0]
            if step.target_mm is None:
                self._finish()
                continue
            ways = {axis: mm - self.position_mm[axis] for axis, mm in step.target_mm.items()}
            whole_s = max(abs(way) for way in ways.values()) / step.feed_mm_s
            share = min(left_s / whole_s, 1.0) if whole_s else 1.0
            for axis, way in ways.items():
                self.position_mm[axis] += share * way
            left_s -= whole_s
            if share == 1.0:
                self.position_mm |= step.target_mm
                self._queue.pop(0)

    def _finish(self) -> None:
        """Answer what has come to its end: a dwell whose turn it is, a homing."""
        while self._queue and self._queue[0].target_mm is None and self._hold_since_s is None:
            self._queue.pop(0)
            self._said.append("ok")
        if self._home_until_s is not None and self._now_s >= self._home_until_s:
            self.position_mm = dict.fromkeys(self.position_mm, -PULL_OFF_MM)
            self._home_until_s, self._locked = None, False
            self._said.append("ok")

    def _report(self) -> str:
        place = ",".join(f"{mm:.3f}" for mm in self.position_mm.values())
        moving = self.state == "Run" and self._queue and self._queue[0].target_mm
        feed = 60.0 * self._queue[0].feed_mm_s if moving else 0.0
        self._reports += 1
        more = "|WCO:0.000,0.000,0.000" if self._reports % OFFSET_EVERY == 1 else ""
        return f"<{self.state}|MPos:{place}|FS:{feed:.0f},0{more}>"
