"""A G-code stage (GRBL 1.1) that moves the plate."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

from benchtool.bench.grbl_link import ANSWER_S, ASK_S, GrblLink
from benchtool.bench.grbl_words import (
    HOLD,
    HOME,
    RESET,
    RESUME,
    UNLOCK,
    WAIT_UNTIL_MOVED,
    move_line,
)
from benchtool.bench.stage import Pause
from benchtool.bench.transport import Transport
from benchtool.errors import BenchtoolError, StageError

HOME_S = 90.0
"""Longest homing; a stage says nothing meanwhile, for seconds to tens of seconds."""

SPARE_S = 10.0
"""Time for speeding up, slowing down and answering, on top of way over feed."""

ARRIVED_MM = 0.02
"""A stage that stands this far off has lost steps; two steps of a common 100 per mm."""

STILL_S = 5.0


def _no_pause(duration_s: float) -> None:
    """Listen to nothing else meanwhile."""


@dataclass(frozen=True, slots=True)
class GrblAxis:
    """Relate one axis of the stage to the plate.

    Attributes:
        letter: axis of the stage, in G-code.
        zero_m: plate coordinate (distance, or lateral position) at machine position 0.
        direction: +1 when the coordinate grows with machine position, -1 when it falls.
    """

    letter: str
    zero_m: float
    direction: int = 1

    def to_mm(self, coordinate_m: float) -> float:
        """Return the machine position of a plate coordinate."""
        return self.direction * 1e3 * (coordinate_m - self.zero_m)

    def to_m(self, position_mm: float) -> float:
        """Return the plate coordinate of a machine position."""
        return self.zero_m + self.direction * 1e-3 * position_mm


class GrblStage:
    """Move the plate with a stage that speaks GRBL 1.1.

    Args:
        transport: carries the bytes.
        distance: axis of the plate distance.
        feed_m_s: how fast.
        lateral: axis of the lateral position, None where there is none.
        clock: monotonic seconds.
        name: of the stage, for messages.
        opening: called while the stage homes on opening, which takes long; a bench beside it would
            run over if nobody listened to it.
        option: how it was chosen.
    """

    measures_to_m = 0.0

    def __init__(
        self,
        transport: Transport,
        distance: GrblAxis,
        feed_m_s: float,
        lateral: GrblAxis | None = None,
        clock: Callable[[], float] = time.monotonic,
        name: str = "the stage",
        opening: Pause = _no_pause,
        option: str = "grbl",
    ) -> None:
        self._link = GrblLink(transport, clock, name)
        self._clock = clock
        self._opening = opening
        self._distance = distance
        self._lateral = lateral
        self._feed_mm_min = 60e3 * feed_m_s
        self._facts: dict[str, str | float] = {
            "stage": option,
            "axis": distance.letter,
            "zero_mm": 1e3 * distance.zero_m,
            "direction": distance.direction,
        }
        self._held = False

    @property
    def facts(self) -> Mapping[str, str | float]:
        return self._facts

    def open(self) -> None:
        self._link.open()
        try:
            self._link.wake()
            self._home_or_reset()
        except BaseException:
            self.close()
            raise

    def _home_or_reset(self) -> None:
        """Home; a homing that nobody waits for any more goes on until a reset ends it."""
        try:
            self.home(self._opening)
        except StageError:  # the stage has answered, or cannot
            raise
        except BaseException:
            with suppress(BenchtoolError):
                self._link.send(RESET)
            raise

    def close(self) -> None:
        self._link.close()

    def home(self, pause: Pause = _no_pause) -> None:
        """Find the machine zero; the stage is silent until it has."""
        self._link.order(HOME, "homing", HOME_S, pause)
        self._link.locked, self._link.homed = False, True

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        targets_mm = self._targets_mm(z_m, x_m, tilt_rad)
        self._make_ready(pause)
        what = f"the move to {z_m:g} m"
        start_mm = self._link.position_mm(pause)
        self._check_axes(start_mm)
        self._link.order(move_line(targets_mm, self._feed_mm_min), what, ANSWER_S, pause)
        way_mm = sum(abs(target - start_mm[letter]) for letter, target in targets_mm.items())
        longest_s = SPARE_S + 60.0 * way_mm / self._feed_mm_min
        if not self._link.order_watched(WAIT_UNTIL_MOVED, what, longest_s, pause):
            self.hold()
            raise StageError(
                f"{self._link.name} did not finish {what} within {longest_s:.0f} s and was held; "
                f"look for a feed hold or for what blocks it"
            )
        self._until(lambda state: state == "Idle", what, pause)
        stands_mm = self._link.position_mm(pause)
        for letter, target in targets_mm.items():
            if abs(stands_mm[letter] - target) > ARRIVED_MM:
                self._link.homed = False
                raise StageError(
                    f"{self._link.name} stands at {letter} {stands_mm[letter]:.3f} mm instead of "
                    f"{target:.3f} mm after {what}; home it and start again"
                )
        return self._distance.to_m(stands_mm[self._distance.letter])

    def hold(self) -> None:
        """Stop by a feed hold; the next move starts from there, after a reset."""
        self._held = True
        self._link.send(HOLD)

    def resume(self, pause: Pause = _no_pause) -> None:
        """Go on with the move after a hold; `~` is ignored until the stage stands still."""
        self._until(lambda state: state not in ("Run", "Hold:1"), "the hold", pause)
        self._link.send(RESUME)
        self._held = False

    def _make_ready(self, pause: Pause) -> None:
        """Leave a hold, a lock, or a lost position behind."""
        if self._held:
            # A reset throws the rest of the move away and keeps the position, once all stands.
            self._until(lambda state: state not in ("Run", "Hold:1"), "the hold", pause)
            self._link.wake()
            self._held = False
        if not self._link.homed:
            self.home(pause)
        elif self._link.locked:
            self._link.order(UNLOCK, "unlocking", ANSWER_S, pause)
            self._link.locked = False

    def _until(self, reached: Callable[[str], bool], what: str, pause: Pause) -> None:
        """Ask for the state until it is one that was waited for."""
        deadline_s = self._clock() + STILL_S
        while True:
            report = self._link.ask(pause)
            state = report.state + ("" if report.substate is None else f":{report.substate}")
            if reached(state):
                return
            if self._clock() > deadline_s:
                raise StageError(
                    f"{self._link.name} still says {state} {STILL_S:g} s after {what}; look at it "
                    f"and start again"
                )
            pause(ASK_S)

    def _targets_mm(self, z_m: float, x_m: float, tilt_rad: float) -> dict[str, float]:
        if tilt_rad:
            raise StageError(
                f"{self._link.name} has no tilt axis; tilt the plate by hand or plan without tilt"
            )
        targets = {self._distance.letter: self._distance.to_mm(z_m)}
        if self._lateral is not None:
            targets[self._lateral.letter] = self._lateral.to_mm(x_m)
        elif x_m:
            raise StageError(
                f"{self._link.name} has no lateral axis, but {x_m:g} m were asked for; name its "
                f"axis or plan without lateral positions"
            )
        return targets

    def _check_axes(self, present: dict[str, float]) -> None:
        for axis in (self._distance, self._lateral):
            if axis is not None and axis.letter not in present:
                raise StageError(
                    f"{self._link.name} reports no axis {axis.letter}, only {' '.join(present)}; "
                    f"name one of those"
                )
