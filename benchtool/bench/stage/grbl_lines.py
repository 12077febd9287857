"""Lines and settings of GRBL 1.1, parsed to values and encoded; pure functions.

Texts of alarms and errors are paraphrased from the tables of the Grbl 1.1 documentation (gnea/grbl,
doc/csv); numbers that forks add are shown without text. Settings and their defaults are from
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
    2: "the target is outside the stage's soft limits; correct the distance or $130 to $132",
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
    """The line was accepted."""


@dataclass(frozen=True, slots=True)
class Error:
    """The line was rejected."""

    number: int

    def __str__(self) -> str:
        return f"error:{self.number}, {ERRORS.get(self.number, 'see its manual')}"


@dataclass(frozen=True, slots=True)
class Alarm:
    """The stage has locked itself."""

    number: int

    def __str__(self) -> str:
        return f"ALARM:{self.number}, {ALARMS.get(self.number, 'see its manual')}"

    @property
    def loses_position(self) -> bool:
        """Return whether homing is needed; a soft limit stops before anything moves."""
        return self.number not in (2, 4, 5)


@dataclass(frozen=True, slots=True)
class Banner:
    """The stage has restarted."""

    version: str


@dataclass(frozen=True, slots=True)
class FeedbackMessage:
    """A bracketed message, such as `[MSG:Caution: Unlocked]`."""

    text: str

    @property
    def is_locked_notice(self) -> bool:
        """Return whether the stage reports that G-code is locked until `$H` or `$X`."""
        return "to unlock" in self.text


@dataclass(frozen=True, slots=True)
class GrblSetting:
    """One numbered setting, such as `$132=1500.000`."""

    number: int
    value: float


@dataclass(frozen=True, slots=True)
class StatusReport:
    """One status report: positions in mm, None if it does not contain them."""

    state: str
    substate: int | None
    machine_mm: tuple[float, ...] | None
    work_mm: tuple[float, ...] | None
    offset_mm: tuple[float, ...] | None

    @property
    def state_text(self) -> str:
        """The state as the stage reports it, `Hold:0`."""
        return self.state + ("" if self.substate is None else f":{self.substate}")


@dataclass(frozen=True, slots=True)
class UnknownLine:
    """Any other line, such as parameters or noise."""

    text: str


GrblLine = Ok | Error | Alarm | Banner | FeedbackMessage | GrblSetting | StatusReport | UnknownLine
_NUMBERED = re.compile(r"(error|ALARM):(\d{1,9})")
_SETTING = re.compile(r"\$(\d{1,9})=(\d{1,15}(?:\.\d*)?)(?: .*)?")
_BANNER = re.compile(r"Grbl(?:HAL)? (\S+) \[", re.IGNORECASE)
_REPORT = re.compile(r"<([A-Za-z]+)(?::(\d{1,9}))?((?:\|[^|>]*)*)>")


def parse_line(line: str) -> GrblLine:
    """Return the parsed line."""
    line = line.strip()
    if line == "ok":
        return Ok()
    if match := _NUMBERED.fullmatch(line):
        number = int(match[2])
        return Error(number) if match[1] == "error" else Alarm(number)
    if match := _SETTING.fullmatch(line):
        return GrblSetting(int(match[1]), float(match[2]))
    if match := _REPORT.fullmatch(line):
        return _parse_report(match) or UnknownLine(line)
    if match := _BANNER.match(line):
        return Banner(match[1])
    if line.startswith("[") and line.endswith("]"):
        return FeedbackMessage(line[1:-1])
    return UnknownLine(line)


def _parse_report(match: re.Match[str]) -> StatusReport | None:
    fields: dict[str, str] = {}
    for field in match[3].split("|")[1:]:
        name, _, value = field.partition(":")
        fields[name] = value
    try:
        positions = {
            name: tuple(float(number) for number in fields[name].split(","))
            for name in ("MPos", "WPos", "WCO")
            if name in fields
        }
    except ValueError:
        return None
    if not all(math.isfinite(value) for position in positions.values() for value in position):
        return None
    substate = int(match[2]) if match[2] else None
    return StatusReport(
        match[1], substate, positions.get("MPos"), positions.get("WPos"), positions.get("WCO")
    )


class GrblDecoder:
    """Decoder of received bytes, with the work offset between reports."""

    def __init__(self) -> None:
        self._partial_line = b""
        self._offset_mm: tuple[float, ...] | None = None

    def feed(self, data: bytes) -> list[GrblLine]:
        """Return the complete lines so far, parsed; an incomplete line is buffered."""
        *lines, self._partial_line = (self._partial_line + data).split(b"\n")
        messages = [parse_line(line.decode("ascii", "replace")) for line in lines if line.strip()]
        for message in messages:
            if isinstance(message, StatusReport) and message.offset_mm is not None:
                self._offset_mm = message.offset_mm
            elif isinstance(message, Banner):
                self._offset_mm = None
        return messages

    def machine_mm(self, report: StatusReport) -> tuple[float, ...] | None:
        """Return the machine position of a report (axes,): mm; None if it is unknown.

        A report contains either machine or work position, and only sometimes the offset.
        """
        if report.machine_mm is not None:
            return report.machine_mm
        work_mm, offset_mm = report.work_mm, self._offset_mm
        if work_mm is None or offset_mm is None or len(work_mm) != len(offset_mm):
            return None
        return tuple(a + b for a, b in zip(work_mm, offset_mm, strict=True))


def move_line(targets_mm: Mapping[str, float], feed_mm_min: float) -> bytes:
    """Return a straight move in machine coordinates: absolute, millimetres, with its feed."""
    words = "".join(f" {letter}{value:.3f}" for letter, value in targets_mm.items())
    return f"G21 G90 G53 G1{words} F{feed_mm_min:.1f}\n".encode("ascii")


INCHES, SOFT_LIMITS, HOMING = 13, 20, 22
HOMING_FEED, HOMING_SEEK, HOMING_PAUSE_MS, PULL_OFF = 24, 25, 26, 27
STEPS_PER_MM, MAX_FEED, ACCELERATION, TRAVEL = 100, 110, 120, 130

AXES = "XYZ"
SEEK_FACTOR = 1.5  # travels over which Grbl seeks a switch (HOMING_AXIS_SEARCH_SCALAR)
LOCATE_FACTOR = 5.0  # pull-offs over which it seeks again slowly (HOMING_AXIS_LOCATE_SCALAR)

HOMING_MARGIN_S = 10.0

REQUIRED_SETTINGS = {  # listed by every stage and used here
    *(INCHES, SOFT_LIMITS, HOMING, HOMING_FEED, HOMING_SEEK, HOMING_PAUSE_MS, PULL_OFF),
    *range(STEPS_PER_MM, STEPS_PER_MM + 3),
    *range(MAX_FEED, MAX_FEED + 3),
    *range(ACCELERATION, ACCELERATION + 3),
    *range(TRAVEL, TRAVEL + 3),
}


@dataclass(frozen=True, slots=True)
class GrblSettings:
    """The numbered settings of a stage."""

    values: Mapping[int, float]

    def get(self, number: int) -> float:
        """Return a setting; raise if the stage did not list it."""
        try:
            return self.values[number]
        except KeyError:
            raise StageError(
                f"the stage did not list setting ${number}: a line was lost (check cable and "
                f"grounding), or its firmware does not speak Grbl 1.1"
            ) from None

    def steps_mm(self, letter: str) -> float:
        return 1.0 / self._get_axis(STEPS_PER_MM, letter)

    def max_feed_mm_min(self, letters: Iterable[str]) -> float:
        return min(self._get_axis(MAX_FEED, letter) for letter in letters)

    def braking_time_s(self, letters: Iterable[str], feed_mm_min: float) -> float:
        return feed_mm_min / 60.0 / self._min_acceleration_mm_s2(letters)

    def stoppable_feed_mm_min(
        self, letters: Iterable[str], within_mm: float, reaction_s: float
    ) -> float:
        """Return the feed v with v t + v^2 / (2 a) = `within_mm`; t: reaction, a: $120 to $122."""
        acceleration_mm_s2 = self._min_acceleration_mm_s2(letters)
        root_s = math.sqrt(reaction_s**2 + 2.0 * max(within_mm, 0.0) / acceleration_mm_s2)
        return 60.0 * acceleration_mm_s2 * (root_s - reaction_s)

    def _min_acceleration_mm_s2(self, letters: Iterable[str]) -> float:
        return min(self._get_axis(ACCELERATION, letter) for letter in letters)

    @property
    def homing_timeout_s(self) -> float:
        """Longest homing: each axis in turn seeks over its travel, locates, pulls off: s."""
        pull_off_mm = self.get(PULL_OFF)
        timeout_s = HOMING_MARGIN_S
        for letter in AXES:
            seek_mm = SEEK_FACTOR * self._get_axis(TRAVEL, letter) + pull_off_mm
            timeout_s += 60.0 * seek_mm / self.get(HOMING_SEEK)
            timeout_s += 60.0 * (LOCATE_FACTOR + 2.0) * pull_off_mm / self.get(HOMING_FEED)
            timeout_s += 6.0 * 1e-3 * self.get(HOMING_PAUSE_MS)
        return timeout_s

    def check(self, name: str, letters: Iterable[str]) -> None:
        """Raise if the stage cannot be moved safely, before anything moves."""
        if not int(self.get(HOMING)) & 1:
            raise StageError(
                f"{name} has homing switched off (${HOMING}=0), so its position is unknown; set "
                f"${HOMING}=1 and fit limit switches"
            )
        if not self.get(SOFT_LIMITS):
            raise StageError(
                f"{name} has no soft limits (${SOFT_LIMITS}=0), so a wrong digit on the line could "
                f"move the plate anywhere; set ${SOFT_LIMITS}=1 and the travel in $130 to $132"
            )
        if self.get(INCHES):
            raise StageError(
                f"{name} reports inches (${INCHES}=1), but millimetres are needed; set ${INCHES}=0"
            )
        for number in (HOMING_FEED, HOMING_SEEK):
            self._check_positive(name, number)
        for first in (STEPS_PER_MM, MAX_FEED, ACCELERATION, TRAVEL):
            for letter in letters:
                self._check_positive(name, first + AXES.index(letter))

    def format_warnings(self, letters: str, feed_mm_min: float, step_mm: float) -> str:
        """Return warnings about a usable stage: slow axes, coarse steps."""
        warnings = []
        for letter in letters:
            index = AXES.index(letter)
            if (max_feed := self.get(MAX_FEED + index)) < feed_mm_min:
                warnings.append(
                    f"${MAX_FEED + index} allows {max_feed:g} mm/min, below the rig's "
                    f"plate.speed_m_s of {feed_mm_min:g}, so moves take longer"
                )
            if (step := self.steps_mm(letter)) > step_mm:
                warnings.append(
                    f"{letter} has steps of {step:g} mm (${STEPS_PER_MM + index}={1.0 / step:g})"
                )
        return "; ".join(warnings)

    def _get_axis(self, first: int, letter: str) -> float:
        return self.get(first + AXES.index(letter))

    def _check_positive(self, name: str, number: int) -> None:
        if not self.get(number) > 0.0:
            raise StageError(f"{name} has ${number}={self.get(number):g}; set it above 0")
