"""What a GRBL 1.1 stage says of itself in `$$`, and what follows from it, pure.

Numbers and defaults after the Grbl 1.1 documentation (gnea/grbl, doc/markdown/settings.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from benchtool.core.errors import StageError

INCHES, SOFT_LIMITS, HOMING = 13, 20, 22
HOMING_FEED, HOMING_SEEK, HOMING_PAUSE_MS, PULL_OFF = 24, 25, 26, 27
STEPS_PER_MM, FASTEST, ACCELERATION, TRAVEL = 100, 110, 120, 130
AXES = "XYZ"

SEARCH = 1.5
"""Grbl seeks a switch over this many times the travel (HOMING_AXIS_SEARCH_SCALAR)."""

LOCATE = 5.0
"""Grbl seeks again over so many pull-offs at the slow feed (HOMING_AXIS_LOCATE_SCALAR)."""

HOMING_SPARE_S = 10.0


@dataclass(frozen=True, slots=True)
class GrblSettings:
    """Hold the numbered settings of a stage."""

    values: Mapping[int, float]

    def of(self, number: int) -> float:
        """Return a setting.

        Raises:
            StageError: the stage did not list it.
        """
        try:
            return self.values[number]
        except KeyError:
            raise StageError(
                f"the stage lists no ${number} among its settings; it needs firmware that speaks "
                f"Grbl 1.1"
            ) from None

    def steps_mm(self, letter: str) -> float:
        """Return the length of one step of an axis: mm."""
        return 1.0 / self._of_axis(STEPS_PER_MM, letter)

    def fastest_mm_min(self, letters: Iterable[str]) -> float:
        """Return the fastest feed that every one of these axes allows: mm/min."""
        return min(self._of_axis(FASTEST, letter) for letter in letters)

    def stopping_s(self, letters: Iterable[str], feed_mm_min: float) -> float:
        """Return how long slowing down from a feed takes: s."""
        return feed_mm_min / 60.0 / min(self._of_axis(ACCELERATION, letter) for letter in letters)

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
        """Refuse a stage that cannot be moved safely, before anything moves.

        Raises:
            StageError: which setting, and what to set.
        """
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
        said = []
        for letter in letters:
            index = AXES.index(letter)
            if (fastest := self.of(FASTEST + index)) < feed_mm_min:
                said.append(
                    f"${FASTEST + index} allows {fastest:g} mm/min where the rig's "
                    f"plate.speed_m_s asks for {feed_mm_min:g}, so moves take longer"
                )
            if (step := self.steps_mm(letter)) > step_mm:
                said.append(
                    f"{letter} stands only on multiples of {step:g} mm "
                    f"(${STEPS_PER_MM + index}={1.0 / step:g})"
                )
        return "; ".join(said)

    def _of_axis(self, first: int, letter: str) -> float:
        return self.of(first + AXES.index(letter))

    def _positive(self, name: str, number: int) -> None:
        if not self.of(number) > 0.0:
            raise StageError(f"{name} has ${number}={self.of(number):g}; set it above 0")
