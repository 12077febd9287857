"""A G-code stage (GRBL 1.1) that moves the plate."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

from benchtool.bench.drivers import GrblAddress
from benchtool.bench.guard import GuardedBench
from benchtool.bench.stage import grbl_lines
from benchtool.bench.stage.grbl_link import (
    MAX_REACTION_S,
    POLL_INTERVAL_S,
    REPLY_TIMEOUT_S,
    GrblLink,
)
from benchtool.bench.stage.stage import Pause, PlateStage
from benchtool.bench.transport.transport import Transport
from benchtool.core.errors import BenchtoolError, StageError
from benchtool.core.rig import PlateDrive

MOVE_TIMEOUT_MARGIN_S = 10.0  # for replies and short blocks, beyond path over feed and braking
IDLE_TIMEOUT_S = 2.0  # of Idle elsewhere than at the target; then the move has failed
HOLD_TIMEOUT_S = 5.0  # longest feed hold by the stage's button: time to press start; assumed
AFTER_HOMING_S = 0.6  # a failed homing restarts the stage 0.5 s after `ok` (Grbl 1.1h, measured)
OTHER_STATES = ("Check", "Door", "Sleep", "Jog", "Home")  # not caused by a move of the host
SETTLE_TIME_S = 5.0  # margin on the braking time
MIN_FEED_MM_MIN = 300.0  # braking distance never needs a slower move: 1.4 m in 5 min; assumed


def _no_pause(duration_s: float) -> None:
    """Wait without reading a bench (no-op)."""


class GrblStage(PlateStage):
    """Stage with GRBL 1.1 firmware."""

    def __init__(
        self,
        transport: Transport,
        address: GrblAddress,
        plate: PlateDrive,
        guard: GuardedBench | None = None,
        homing_pause: Pause = _no_pause,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(plate, guard)
        self._link = GrblLink(transport, clock, f"the stage on {address.port}")
        self._clock = clock
        # Called during homing on opening, which takes long: the buffers of a bench that is not read
        # meanwhile would overflow
        self._homing_pause = homing_pause
        zero_m = plate.z_park_m if address.zero_mm is None else 1e-3 * address.zero_mm
        self._distance = GrblAxis(address.axis, zero_m, address.direction)
        lateral = address.lateral
        self._lateral = lateral and GrblAxis(lateral, 1e-3 * address.lateral_zero_mm)
        self._feed_mm_min = 60e3 * plate.speed_m_s
        self._min_gap_m = plate.z_min_m  # of a move, including its braking distance
        self.facts = {
            "stage": address.text,
            "axis": address.axis,
            "zero_mm": 1e3 * zero_m,
            "direction": address.direction,
        }
        self._is_on_hold = False
        self._letters = address.axis + (lateral or "")
        self._settings: grbl_lines.GrblSettings | None = None

    def open(self) -> None:
        self._link.open()
        try:
            self._link.reset()
            self._is_on_hold = False
            self._settings = self._link.read_settings(self._homing_pause)
            self._settings.check(self._link.name, self._letters)
            if warning := self._settings.format_warnings(
                self._letters, self._feed_mm_min, 2.0 * ARRIVAL_TOLERANCE_MM
            ):
                self.facts = {**self.facts, "remark": warning}
            self.home(self._homing_pause)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        self._link.close()

    def home(self, pause: Pause = _no_pause) -> None:
        """Home the machine; the stage is silent until the end."""
        try:
            self._link.send_command(
                grbl_lines.HOME, "homing", self._loaded_settings().homing_timeout_s, pause
            )
        except BaseException:
            if self._link.is_unacknowledged:  # an interrupted homing continues until a reset
                with suppress(BenchtoolError):
                    self._link.send(grbl_lines.RESET)
            raise
        self._link.listen(AFTER_HOMING_S, "homing", pause)
        self._link.is_locked, self._link.is_homed = False, True

    def _move_once(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        targets_mm = self._build_targets_mm(z_m, x_m, tilt_rad)
        feed_mm_min = self._braked_feed_mm_min(z_m)
        self._prepare(pause)
        action = f"the move to {z_m:g} m"
        start_mm = self._link.position_mm(pause)
        settings = self._loaded_settings()
        steps_mm = {letter: settings.steps_mm(letter) for letter in targets_mm}
        path = PlateMove(start_mm, targets_mm, steps_mm)
        end_mm = self._run_move(path, feed_mm_min, action, pause)
        return self._distance.to_m(end_mm[self._distance.letter])

    def hold(self) -> None:
        """Stop by a feed hold; the next move starts at that position, after a reset."""
        super().hold()
        self._is_on_hold = True
        self._link.send(grbl_lines.HOLD)

    def resume(self, pause: Pause = _no_pause) -> None:
        """Resume the move after a hold; `~` is ignored until the stage has stopped."""
        self._wait_for_hold(pause)
        self._link.send(grbl_lines.RESUME)
        self._is_on_hold = False

    def _braked_feed_mm_min(self, z_m: float) -> float:
        """Return the feed at which a hold beyond the target stops outside the minimum gap.

        Raises:
            StageError: the target is so near that no feed is slow enough.
        """
        margin_mm = 1e3 * (z_m - self._min_gap_m) - POSITION_TOLERANCE_MM
        min_feed = min(self._feed_mm_min, MIN_FEED_MM_MIN)
        max_feed = self._loaded_settings().stoppable_feed_mm_min(
            self._letters, margin_mm, MAX_REACTION_S
        )
        if max_feed < min_feed:
            raise StageError(
                f"the plate was not moved to {z_m:g} m: feed {min_feed:g} mm/min is too high to "
                f"stop {self._link.name} before the minimum gap of {self._min_gap_m:g} m; maximum: "
                f"{max_feed:.0f} mm/min; choose a greater distance"
            )
        return min(self._feed_mm_min, max_feed)

    def _run_move(
        self, path: PlateMove, feed_mm_min: float, action: str, pause: Pause
    ) -> dict[str, float]:
        """Start the move and return the final position: Idle at the target."""
        line = grbl_lines.move_line(path.target_mm, feed_mm_min)
        timeout_s = MOVE_TIMEOUT_MARGIN_S + 60.0 * path.length_mm / min(
            feed_mm_min, self._allowed_mm_min()
        )
        timeout_s += self._braking_time_s()
        start_s = state_since_s = self._clock()
        state = ""
        for report in self._link.reports(line, action, pause):
            now_s = self._clock()
            if report.state != state:
                state, state_since_s = report.state, now_s
            position_mm = self._link.reported_mm(report)
            if state == "Idle" and position_mm is not None and not path.target_error(position_mm):
                self._link.is_unacknowledged = False
                return position_mm
            problem = _find_problem(path, report, position_mm, now_s - state_since_s)
            if not problem and now_s - start_s > timeout_s:
                problem = (
                    f"did not arrive within {timeout_s:.0f} s; check for an obstacle or a feed "
                    f"override"
                )
            if problem:
                suffix = ""
                if state != "Idle":
                    self.hold()
                    suffix = " and was held"
                self._link.is_homed = False
                raise StageError(f"{self._link.name} did not finish {action}{suffix}: it {problem}")
        raise AssertionError("unreachable: the stage reports endlessly")

    def _prepare(self, pause: Pause) -> None:
        """Clear a hold, an incomplete line, a lock, or a lost position."""
        if self._is_on_hold:
            # A reset after standstill discards the rest of the move and keeps the position.
            self._wait_for_hold(pause)
        if self._is_on_hold or self._link.is_unacknowledged:
            self._link.reset()
            self._is_on_hold = False
        if not self._link.is_homed:
            self.home(pause)
        elif self._link.is_locked:
            self._link.send_command(grbl_lines.UNLOCK, "unlocking", REPLY_TIMEOUT_S, pause)
            self._link.is_locked = False

    def _wait_for_hold(self, pause: Pause) -> None:
        """Poll the state until a hold is complete; before, `~` is ignored, a reset loses steps."""
        timeout_s = SETTLE_TIME_S + self._braking_time_s()
        deadline_s = self._clock() + timeout_s
        while (report := self._link.request_report(pause)).state_text in ("Run", "Hold:1"):
            if self._clock() > deadline_s:
                raise StageError(
                    f"{self._link.name} still reports {report.state_text} {timeout_s:.0f} s after "
                    f"the hold; switch its power off"
                )
            pause(POLL_INTERVAL_S)

    def _allowed_mm_min(self) -> float:
        """Return the actual feed of the stage."""
        return min(self._feed_mm_min, self._loaded_settings().max_feed_mm_min(self._letters))

    def _braking_time_s(self) -> float:
        return self._loaded_settings().braking_time_s(self._letters, self._allowed_mm_min())

    def _loaded_settings(self) -> grbl_lines.GrblSettings:
        if self._settings is None:
            raise StageError(f"{self._link.name} is not open; call open() first")
        return self._settings

    def _build_targets_mm(self, z_m: float, x_m: float, tilt_rad: float) -> dict[str, float]:
        if tilt_rad:
            raise StageError(
                f"{self._link.name} has no tilt axis; tilt the plate by hand or plan without tilt"
            )
        targets_mm = {self._distance.letter: self._distance.to_mm(z_m)}
        if self._lateral is not None:
            targets_mm[self._lateral.letter] = self._lateral.to_mm(x_m)
        elif x_m:
            raise StageError(
                f"{self._link.name} has no lateral axis, but {x_m:g} m was requested; set its "
                f"lateral axis or plan without lateral positions"
            )
        return targets_mm


def _find_problem(
    path: PlateMove,
    report: grbl_lines.StatusReport,
    position_mm: Mapping[str, float] | None,
    since_s: float,
) -> str:
    """Return the problem that a report during a move shows, or "" if there is none."""
    if report.state == "Idle":
        # A single wrong digit in a report at rest is harmless: the next report is right.
        if since_s < IDLE_TIMEOUT_S or position_mm is None:
            return ""
        return f"stopped at {path.target_error(position_mm)}; home it and start again"
    if report.state in OTHER_STATES:
        return f"reports {report.state_text}; reset it and start again"
    if report.state == "Hold" and since_s >= HOLD_TIMEOUT_S:
        return (
            f"reports {report.state_text} for {HOLD_TIMEOUT_S:g} s, caused by its feed-hold button "
            f"or noise on that pin; release it and start again"
        )
    if position_mm is not None and (off_path := path.path_error(position_mm)):
        return (
            f"is at {off_path}: a digit was wrong on the line; check cable and grounding, then "
            f"home it and start again"
        )
    return ""


POSITION_TOLERANCE_MM = 0.5  # of a path: far above a step and rounding; assumed
ARRIVAL_TOLERANCE_MM = 0.02  # of a target: two steps of a common drive with 100 per mm


@dataclass(frozen=True, slots=True)
class GrblAxis:
    """Axis of the stage in plate coordinates."""

    letter: str  # axis of the stage, in G-code
    zero_m: float  # plate coordinate (distance, or lateral position) at machine position 0
    direction: int = 1  # +1 if the coordinate increases with machine position, -1 if it decreases

    def to_mm(self, coordinate_m: float) -> float:
        return self.direction * 1e3 * (coordinate_m - self.zero_m)

    def to_m(self, position_mm: float) -> float:
        return self.zero_m + self.direction * 1e-3 * position_mm


@dataclass(frozen=True, slots=True)
class PlateMove:
    """Start and target of a move by axis letter: mm."""

    start_mm: Mapping[str, float]
    target_mm: Mapping[str, float]
    # Length of one step of each axis; the position error is at most half of it
    steps_mm: Mapping[str, float]

    @property
    def length_mm(self) -> float:
        """Sum over axes, an upper bound of the path length."""
        return sum(abs(mm - self.start_mm[axis]) for axis, mm in self.target_mm.items())

    def path_error(self, position_mm: Mapping[str, float]) -> str:
        """Return how a position leaves the path; "" if it is on the path."""
        for axis, target_mm in self.target_mm.items():
            low_mm, high_mm = sorted((self.start_mm[axis], target_mm))
            if (
                not low_mm - POSITION_TOLERANCE_MM
                <= position_mm[axis]
                <= high_mm + POSITION_TOLERANCE_MM
            ):
                return (
                    f"{axis} {position_mm[axis]:.3f} mm, outside {self.start_mm[axis]:.3f} to "
                    f"{target_mm:.3f} mm"
                )
        return ""

    def target_error(self, position_mm: Mapping[str, float]) -> str:
        """Return how a position differs from the target; "" if it is the target."""
        for axis, target_mm in self.target_mm.items():
            allowed_mm = ARRIVAL_TOLERANCE_MM + 0.5 * self.steps_mm[axis]
            if abs(position_mm[axis] - target_mm) > allowed_mm:
                return f"{axis} {position_mm[axis]:.3f} mm instead of {target_mm:.3f} mm"
        return ""
