"""What GRBL 1.1 says and what it takes: lines and settings to values and back, pure.

Texts of alarms and errors after the tables of the Grbl 1.1 documentation (gnea/grbl, doc/csv), in
our words; numbers that forks add are shown as they come. Settings and their defaults after
doc/markdown/settings.md there.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from benchtool.core.errors import StageError

RESET, STATUS, HOLD, RESUME = b"\x18", b"?", b"!", b"~"
UNLOCK, HOME, SETTINGS = b"$X\n", b"$H\n", b"$$\n"

ALARMS: dict[int, str] = {
    1: "a limit switch was hit and the position is lost; free the stage and home it",
    2: "the target lies outside of the stage's soft limits; correct the distance or $130 to $132",
    3: "it was reset while moving and the position is lost; home it",
    4: "the probe was not in its initial state",
    5: "the probe touched nothing within its travel",
    6: "homing was reset before it was done; home it again",
    7: "the safety door was opened while homing; close it and home again",
    8: "the limit switch did not release at the end of homing; check it or raise $27",
    9: "no limit switch was found while homing; check the switches and $23, $25, $130 to $132 "
    "(unmodified Grbl homes X and Y too: a single axis needs switches or links there, or a "
    "firmware that homes Z alone)",
}

ERRORS: dict[int, str] = {
    1: "a letter is missing",
    2: "a number cannot be read",
    3: "an unknown $ command",
    4: "a negative number where none may be",
    5: "homing is switched off; set $22=1 and fit limit switches",
    6: "a step pulse is too short",
    7: "its stored settings could not be read",
    8: "a $ command while the stage is not idle",
    9: "G-code is locked out after an alarm; home the stage",
    10: "soft limits need homing; set $22=1",
    11: "the line is too long",
    12: "a setting exceeds the fastest step rate",
    13: "the safety door is open",
    14: "the start-up line is too long",
    15: "a jog outside of the travel",
    16: "a jog command without its equals sign",
    17: "laser mode needs a PWM output",
    20: "an unknown G-code",
    21: "two G-codes of one group in one line",
    22: "no feed rate was set",
    23: "a whole number is needed",
    24: "two commands that both need axis words",
    33: "the target cannot be reached",
}


@dataclass(frozen=True, slots=True)
class Ok:
    """The line was taken."""


@dataclass(frozen=True, slots=True)
class Error:
    """The line was refused."""

    number: int

    def __str__(self) -> str:
        return f"error:{self.number}, {ERRORS.get(self.number, 'which its manual explains')}"


@dataclass(frozen=True, slots=True)
class Alarm:
    """The stage has locked itself."""

    number: int

    def __str__(self) -> str:
        return f"ALARM:{self.number}, {ALARMS.get(self.number, 'which its manual explains')}"

    @property
    def loses_position(self) -> bool:
        """Whether the stage has to be homed; a soft limit stops before anything moves."""
        return self.number not in (2, 4, 5)


@dataclass(frozen=True, slots=True)
class Banner:
    """It has started anew."""

    version: str


@dataclass(frozen=True, slots=True)
class Note:
    """A bracketed message, such as `[MSG:Caution: Unlocked]`."""

    text: str

    @property
    def locked(self) -> bool:
        """Whether it says that the stage takes no G-code before `$H` or `$X`."""
        return "to unlock" in self.text


@dataclass(frozen=True, slots=True)
class GrblSetting:
    """One numbered setting, such as `$132=1500.000`."""

    number: int
    value: float


@dataclass(frozen=True, slots=True)
class StatusReport:
    """One status report as it stands: positions in mm, those that it does not carry None."""

    state: str
    substate: int | None
    machine_mm: tuple[float, ...] | None
    work_mm: tuple[float, ...] | None
    offset_mm: tuple[float, ...] | None

    @property
    def words(self) -> str:
        """The state as the stage says it, `Hold:0`."""
        return self.state + ("" if self.substate is None else f":{self.substate}")


@dataclass(frozen=True, slots=True)
class Other:
    """Anything else: parameters, noise."""

    text: str


GrblLine = Ok | Error | Alarm | Banner | Note | GrblSetting | StatusReport | Other
_NUMBERED = re.compile(r"(error|ALARM):(\d{1,9})")
_SETTING = re.compile(r"\$(\d{1,9})=(\d{1,15}(?:\.\d*)?)(?: .*)?")
_BANNER = re.compile(r"Grbl(?:HAL)? (\S+) \[", re.IGNORECASE)
_REPORT = re.compile(r"<([A-Za-z]+)(?::(\d{1,9}))?((?:\|[^|>]*)*)>")


def parse_line(line: str) -> GrblLine:
    """Return what one line means."""
    line = line.strip()
    if line == "ok":
        return Ok()
    if found := _NUMBERED.fullmatch(line):
        number = int(found[2])
        return Error(number) if found[1] == "error" else Alarm(number)
    if found := _SETTING.fullmatch(line):
        return GrblSetting(int(found[1]), float(found[2]))
    if found := _REPORT.fullmatch(line):
        return _report(found) or Other(line)
    if found := _BANNER.match(line):
        return Banner(found[1])
    if line.startswith("[") and line.endswith("]"):
        return Note(line[1:-1])
    return Other(line)


def _report(found: re.Match[str]) -> StatusReport | None:
    fields: dict[str, str] = {}
    for field in found[3].split("|")[1:]:
        name, _, value = field.partition(":")
        fields[name] = value
    try:
        places = {
            name: tuple(float(number) for number in fields[name].split(","))
            for name in ("MPos", "WPos", "WCO")
            if name in fields
        }
    except ValueError:
        return None
    if not all(math.isfinite(value) for place in places.values() for value in place):
        return None
    substate = int(found[2]) if found[2] else None
    return StatusReport(
        found[1], substate, places.get("MPos"), places.get("WPos"), places.get("WCO")
    )


class GrblDecoder:
    """Put pieces of bytes together to lines, and remember the work offset between reports."""

    def __init__(self) -> None:
        self._rest = b""
        self._offset_mm: tuple[float, ...] | None = None

    def feed(self, data: bytes) -> list[GrblLine]:
        """Return what the complete lines so far mean; half a line waits for the rest."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        words = [parse_line(line.decode("ascii", "replace")) for line in lines if line.strip()]
        for word in words:
            if isinstance(word, StatusReport) and word.offset_mm is not None:
                self._offset_mm = word.offset_mm
            elif isinstance(word, Banner):
                self._offset_mm = None
        return words

    def machine_mm(self, report: StatusReport) -> tuple[float, ...] | None:
        """Return the machine position of a report (axes,): mm; None while it cannot be known.

        A report carries either machine or work position, and the offset between only sometimes.
        """
        if report.machine_mm is not None:
            return report.machine_mm
        work_mm, offset_mm = report.work_mm, self._offset_mm
        if work_mm is None or offset_mm is None or len(work_mm) != len(offset_mm):
            return None
        return tuple(a + b for a, b in zip(work_mm, offset_mm, strict=True))


def move_line(targets_mm: Mapping[str, float], feed_mm_min: float) -> bytes:
    """Return a straight move in machine coordinates: absolute, millimetres, at a stated feed."""
    words = "".join(f" {letter}{value:.3f}" for letter, value in targets_mm.items())
    return f"G21 G90 G53 G1{words} F{feed_mm_min:.1f}\n".encode("ascii")


INCHES, SOFT_LIMITS, HOMING = 13, 20, 22
HOMING_FEED, HOMING_SEEK, HOMING_PAUSE_MS, PULL_OFF = 24, 25, 26, 27
STEPS_PER_MM, FASTEST, ACCELERATION, TRAVEL = 100, 110, 120, 130

AXES = "XYZ"
SEARCH = 1.5  # Grbl seeks a switch over this many times the travel (HOMING_AXIS_SEARCH_SCALAR)
LOCATE = 5.0  # Grbl seeks again over so many pull-offs at the slow feed (HOMING_AXIS_LOCATE_SCALAR)

HOMING_SPARE_S = 10.0

NEEDED = {  # settings that every stage lists and that are used here
    *(INCHES, SOFT_LIMITS, HOMING, HOMING_FEED, HOMING_SEEK, HOMING_PAUSE_MS, PULL_OFF),
    *range(STEPS_PER_MM, STEPS_PER_MM + 3),
    *range(FASTEST, FASTEST + 3),
    *range(ACCELERATION, ACCELERATION + 3),
    *range(TRAVEL, TRAVEL + 3),
}


@dataclass(frozen=True, slots=True)
class GrblSettings:
    """Hold the numbered settings of a stage."""

    values: Mapping[int, float]

    def of(self, number: int) -> float:
        """Return a setting; refuse a stage that did not list it."""
        try:
            return self.values[number]
        except KeyError:
            raise StageError(
                f"the stage never listed ${number} when its settings were requested: a line was "
                f"lost on the way (look at cable and grounding) or its firmware does not speak "
                f"Grbl 1.1"
            ) from None

    def steps_mm(self, letter: str) -> float:
        return 1.0 / self._of_axis(STEPS_PER_MM, letter)

    def fastest_mm_min(self, letters: Iterable[str]) -> float:
        return min(self._of_axis(FASTEST, letter) for letter in letters)

    def stopping_s(self, letters: Iterable[str], feed_mm_min: float) -> float:
        return feed_mm_min / 60.0 / self._slowest_mm_s2(letters)

    def feed_that_stops_mm_min(
        self, letters: Iterable[str], within_mm: float, reaction_s: float
    ) -> float:
        """Return the feed from which a stage stops within v t + v^2 / (2 a); a: $120 to $122."""
        slowest_mm_s2 = self._slowest_mm_s2(letters)
        root_s = math.sqrt(reaction_s**2 + 2.0 * max(within_mm, 0.0) / slowest_mm_s2)
        return 60.0 * slowest_mm_s2 * (root_s - reaction_s)

    def _slowest_mm_s2(self, letters: Iterable[str]) -> float:
        return min(self._of_axis(ACCELERATION, letter) for letter in letters)

    @property
    def homing_s(self) -> float:
        """Longest homing: one axis after the other seeks over its travel, locates, pulls off: s."""
        pull_off_mm = self.of(PULL_OFF)
        longest_s = HOMING_SPARE_S
        for letter in AXES:
            seek_mm = SEARCH * self._of_axis(TRAVEL, letter) + pull_off_mm
            longest_s += 60.0 * seek_mm / self.of(HOMING_SEEK)
            longest_s += 60.0 * (LOCATE + 2.0) * pull_off_mm / self.of(HOMING_FEED)
            longest_s += 6.0 * 1e-3 * self.of(HOMING_PAUSE_MS)
        return longest_s

    def check(self, name: str, letters: Iterable[str]) -> None:
        """Refuse a stage that cannot be moved safely, before anything moves."""
        for letter in letters:
            if letter not in AXES:
                raise StageError(
                    f"{name} has axes {' '.join(AXES)}, not {letter}; name one of those"
                )
        if not int(self.of(HOMING)) & 1:
            raise StageError(
                f"{name} has homing switched off (${HOMING}=0), so it does not know where it "
                f"stands; set ${HOMING}=1 and fit limit switches"
            )
        if not self.of(SOFT_LIMITS):
            raise StageError(
                f"{name} has no soft limits (${SOFT_LIMITS}=0), so a wrong digit on the line could "
                f"move the plate anywhere; set ${SOFT_LIMITS}=1 and the travel in $130 to $132"
            )
        if self.of(INCHES):
            raise StageError(
                f"{name} reports inches (${INCHES}=1), and positions here are millimetres; set "
                f"${INCHES}=0"
            )
        for number in (HOMING_FEED, HOMING_SEEK):
            self._positive(name, number)
        for first in (STEPS_PER_MM, FASTEST, ACCELERATION, TRAVEL):
            for letter in letters:
                self._positive(name, first + AXES.index(letter))

    def remarks(self, letters: str, feed_mm_min: float, step_mm: float) -> str:
        """Return what a person should know of a stage that may be used: slow axes, coarse steps."""
        remarks = []
        for letter in letters:
            index = AXES.index(letter)
            if (fastest := self.of(FASTEST + index)) < feed_mm_min:
                remarks.append(
                    f"${FASTEST + index} allows {fastest:g} mm/min where the rig's "
                    f"plate.speed_m_s asks for {feed_mm_min:g}, so moves take longer"
                )
            if (step := self.steps_mm(letter)) > step_mm:
                remarks.append(
                    f"{letter} stands only on multiples of {step:g} mm "
                    f"(${STEPS_PER_MM + index}={1.0 / step:g})"
                )
        return "; ".join(remarks)

    def _of_axis(self, first: int, letter: str) -> float:
        return self.of(first + AXES.index(letter))

    def _positive(self, name: str, number: int) -> None:
        if not self.of(number) > 0.0:
            raise StageError(f"{name} has ${number}={self.of(number):g}; set it above 0")
