"""A G-code stage (GRBL 1.1) that moves the plate."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

from benchtool.bench.stage import grbl_lines
from benchtool.bench.stage.grbl_link import ANSWER_S, MAX_REACTION_S, POLL_S, GrblLink
from benchtool.bench.stage.stage import Pause
from benchtool.bench.transport.transport import Transport
from benchtool.core.errors import BenchtoolError, StageError

MOVE_TIMEOUT_MARGIN_S = (
    10.0  # for answers and short blocks, on top of way over feed and slowing down
)
IDLE_TIMEOUT_S = 2.0  # a stage that is idle elsewhere than at the target for so long stays there
HOLD_TIMEOUT_S = 5.0  # longest feed hold by the stage's own button: time to press start; assumed
AFTER_HOMING_S = 0.6  # a failed homing restarts the stage 0.5 s after `ok` (Grbl 1.1h, measured)
OTHER_STATES = ("Check", "Door", "Sleep", "Jog", "Home")  # brought about by others
SETTLE_TIME_S = 5.0  # margin on the time that slowing down takes


MIN_FEED_MM_MIN = 300.0  # no move is slower for its braking: 1.4 m take 5 minutes; assumed


def _no_pause(duration_s: float) -> None:
    """Listen to nothing else meanwhile."""


class GrblStage:
    """Move the plate with a stage that speaks GRBL 1.1.

    Args:
        min_gap_m: plate distance that a move does not come nearer than, its braking included.
        opening: called while the stage homes on opening, which takes long; a bench beside it would
            run over if nobody listened to it.
    """

    measures_to_m = 0.0

    def __init__(
        self,
        transport: Transport,
        distance: GrblAxis,
        feed_m_s: float,
        lateral: GrblAxis | None = None,
        min_gap_m: float = 0.0,
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
        self._min_gap_m = min_gap_m
        self._facts: dict[str, str | float] = {
            "stage": option,
            "axis": distance.letter,
            "zero_mm": 1e3 * distance.zero_m,
            "direction": distance.direction,
        }
        self._held = False
        self._letters = distance.letter + (lateral.letter if lateral else "")
        self._settings: grbl_lines.GrblSettings | None = None

    @property
    def facts(self) -> Mapping[str, str | float]:
        return self._facts

    def open(self) -> None:
        self._link.open()
        try:
            self._link.wake()
            self._held = False
            self._settings = self._link.settings(self._opening)
            self._settings.check(self._link.name, self._letters)
            if remark := self._settings.remarks(
                self._letters, self._feed_mm_min, 2.0 * ARRIVAL_TOLERANCE_MM
            ):
                self._facts["remark"] = remark
            self.home(self._opening)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        self._link.close()

    def home(self, pause: Pause = _no_pause) -> None:
        """Find the machine zero; the stage is silent until it has."""
        try:
            self._link.order(grbl_lines.HOME, "homing", self._known().homing_s, pause)
        except BaseException:
            if self._link.unanswered:  # a homing that nobody waits for goes on until a reset
                with suppress(BenchtoolError):
                    self._link.send(grbl_lines.RESET)
            raise
        self._link.listen(AFTER_HOMING_S, "homing", pause)
        self._link.locked, self._link.homed = False, True

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        targets_mm = self._targets_mm(z_m, x_m, tilt_rad)
        feed_mm_min = self._braked_feed_mm_min(z_m)
        self._make_ready(pause)
        what = f"the move to {z_m:g} m"
        start_mm = self._link.position_mm(pause)
        way = PlateMove(start_mm, targets_mm, {a: self._known().steps_mm(a) for a in targets_mm})
        stands_mm = self._until_there(way, feed_mm_min, what, pause)
        return self._distance.to_m(stands_mm[self._distance.letter])

    def hold(self) -> None:
        """Stop by a feed hold; the next move starts from there, after a reset."""
        self._held = True
        self._link.send(grbl_lines.HOLD)

    def resume(self, pause: Pause = _no_pause) -> None:
        """Go on with the move after a hold; `~` is ignored until the stage stands still."""
        self._until_held(pause)
        self._link.send(grbl_lines.RESUME)
        self._held = False

    def _braked_feed_mm_min(self, z_m: float) -> float:
        """Return the feed from which a hold beyond the target stops outside of the least gap.

        Raises:
            StageError: the target is so near that no feed is slow enough.
        """
        margin_mm = 1e3 * (z_m - self._min_gap_m) - POSITION_TOLERANCE_MM
        slowest = min(self._feed_mm_min, MIN_FEED_MM_MIN)
        feed = self._known().feed_that_stops_mm_min(self._letters, margin_mm, MAX_REACTION_S)
        if feed < slowest:
            raise StageError(
                f"the plate was not moved to {z_m:g} m: to be held before the least gap of "
                f"{self._min_gap_m:g} m {self._link.name} may move at {feed:.0f} mm/min, and does "
                f"at {slowest:g}; choose a greater distance"
            )
        return min(self._feed_mm_min, feed)

    def _until_there(
        self, way: PlateMove, feed_mm_min: float, what: str, pause: Pause
    ) -> dict[str, float]:
        """Send the plate on its way and return where it stands at the end: Idle at the target."""
        line = grbl_lines.move_line(way.target_mm, feed_mm_min)
        longest_s = MOVE_TIMEOUT_MARGIN_S + 60.0 * way.length_mm / min(
            feed_mm_min, self._allowed_mm_min()
        )
        longest_s += self._stopping_s()
        begun_s = since_s = self._clock()
        state = ""
        for report in self._link.watched(line, what, pause):
            now_s = self._clock()
            if report.state != state:
                state, since_s = report.state, now_s
            place_mm = self._link.place_mm(report)
            if state == "Idle" and place_mm is not None and not way.missed_at(place_mm):
                self._link.unanswered = False
                return place_mm
            problem = _problem(way, report, place_mm, now_s - since_s)
            if not problem and now_s - begun_s > longest_s:
                problem = (
                    f"did not arrive within {longest_s:.0f} s; look for what blocks it or for a "
                    f"feed override"
                )
            if problem:
                held = ""
                if state != "Idle":
                    self.hold()
                    held = " and was held"
                self._link.homed = False
                raise StageError(f"{self._link.name} did not finish {what}{held}: it {problem}")
        raise AssertionError("reports never end")

    def _make_ready(self, pause: Pause) -> None:
        """Leave a hold, half a line, a lock, or a lost position behind."""
        if self._held:
            # A reset discards the rest of the move and holds the position, once all stands.
            self._until_held(pause)
        if self._held or self._link.unanswered:
            self._link.wake()
            self._held = False
        if not self._link.homed:
            self.home(pause)
        elif self._link.locked:
            self._link.order(grbl_lines.UNLOCK, "unlocking", ANSWER_S, pause)
            self._link.locked = False

    def _until_held(self, pause: Pause) -> None:
        """Ask for the state until a hold stands; `~` is ignored until then, a reset loses steps."""
        longest_s = SETTLE_TIME_S + self._stopping_s()
        deadline_s = self._clock() + longest_s
        while (report := self._link.request_report(pause)).words in ("Run", "Hold:1"):
            if self._clock() > deadline_s:
                raise StageError(
                    f"{self._link.name} still says {report.words} {longest_s:.0f} s after the "
                    f"hold; switch its power off"
                )
            pause(POLL_S)

    def _allowed_mm_min(self) -> float:
        """Return the feed at which the stage really moves."""
        return min(self._feed_mm_min, self._known().fastest_mm_min(self._letters))

    def _stopping_s(self) -> float:
        return self._known().stopping_s(self._letters, self._allowed_mm_min())

    def _known(self) -> grbl_lines.GrblSettings:
        if self._settings is None:
            raise StageError(f"{self._link.name} is not open; open it first")
        return self._settings

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
                f"{self._link.name} has no lateral axis, but {x_m:g} m were requested; name its "
                f"axis or plan without lateral positions"
            )
        return targets


def _problem(
    way: PlateMove,
    report: grbl_lines.StatusReport,
    place_mm: Mapping[str, float] | None,
    since_s: float,
) -> str:
    """Return what is wrong with a report that no good move makes; empty for a good one."""
    if report.state == "Idle":
        # A single wrong digit in a report at rest does no harm: the next one is right.
        if since_s < IDLE_TIMEOUT_S or place_mm is None:
            return ""
        return f"stands at {way.missed_at(place_mm)}; home it and start again"
    if report.state in OTHER_STATES:
        return f"says {report.words}; reset it and start again"
    if report.state == "Hold" and since_s >= HOLD_TIMEOUT_S:
        return (
            f"says {report.words} for {HOLD_TIMEOUT_S:g} s, which its feed-hold button or noise "
            f"on that pin brings about; release it and start again"
        )
    if place_mm is not None and (where := way.left_at(place_mm)):
        return (
            f"is at {where}: a digit was wrong on the line; check cable and grounding, then home "
            f"it and start again"
        )
    return ""


POSITION_TOLERANCE_MM = (
    0.5  # so far outside of the way is off it: far above a step and rounding; assumed
)
ARRIVAL_TOLERANCE_MM = (
    0.02  # positions this close are one: two steps of a common drive with 100 per mm
)


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
        return self.direction * 1e3 * (coordinate_m - self.zero_m)

    def to_m(self, position_mm: float) -> float:
        return self.zero_m + self.direction * 1e-3 * position_mm


@dataclass(frozen=True, slots=True)
class PlateMove:
    """Hold where a move begins and ends, by axis letter: mm.

    Attributes:
        steps_mm: length of one step of each axis; a stage stands half of it off at most.
    """

    start_mm: Mapping[str, float]
    target_mm: Mapping[str, float]
    steps_mm: Mapping[str, float]

    @property
    def length_mm(self) -> float:
        """Sum over axes, which is no shorter than the way."""
        return sum(abs(mm - self.start_mm[axis]) for axis, mm in self.target_mm.items())

    def left_at(self, place_mm: Mapping[str, float]) -> str:
        """Return what is wrong with a place that is not on the way; empty when it is."""
        for axis, target_mm in self.target_mm.items():
            low_mm, high_mm = sorted((self.start_mm[axis], target_mm))
            if (
                not low_mm - POSITION_TOLERANCE_MM
                <= place_mm[axis]
                <= high_mm + POSITION_TOLERANCE_MM
            ):
                return (
                    f"{axis} {place_mm[axis]:.3f} mm, outside {self.start_mm[axis]:.3f} to "
                    f"{target_mm:.3f} mm"
                )
        return ""

    def missed_at(self, place_mm: Mapping[str, float]) -> str:
        """Return how a place differs from the target; empty when it is the target."""
        for axis, target_mm in self.target_mm.items():
            allowed_mm = ARRIVAL_TOLERANCE_MM + 0.5 * self.steps_mm[axis]
            if abs(place_mm[axis] - target_mm) > allowed_mm:
                return f"{axis} {place_mm[axis]:.3f} mm instead of {target_mm:.3f} mm"
        return ""
