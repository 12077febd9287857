"""How a virtual stage moves and homes. Pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import sqrt

from benchtool.virtual.grbl_code import ACCELERATION, AXES, TRAVEL, VirtualSettings

STEP_S = 0.002


class StageMotion:
    """Move axes along one line, from standstill to standstill."""

    def __init__(
        self,
        start_mm: Mapping[str, float],
        target_mm: Mapping[str, float],
        feed_mm_s: float,
        accel_mm_s2: float,
    ) -> None:
        self.speed_mm_s = 0.0
        self._start_mm, self._target_mm = dict(start_mm), dict(target_mm)
        self._feed_mm_s, self._accel = feed_mm_s, accel_mm_s2
        ways = (mm - start_mm[axis] for axis, mm in target_mm.items())
        self._length_mm = sqrt(sum(way * way for way in ways))
        self._gone_mm = 0.0

    @property
    def end_mm(self) -> dict[str, float]:
        return self._start_mm | self._target_mm

    @property
    def done(self) -> bool:
        return self._gone_mm >= self._length_mm

    @property
    def place_mm(self) -> dict[str, float]:
        if self.done:
            return self.end_mm
        share = self._gone_mm / self._length_mm
        return {
            axis: mm + share * (self._target_mm.get(axis, mm) - mm)
            for axis, mm in self._start_mm.items()
        }

    def goes_on(self, following: StageMotion) -> bool:
        """Take a following motion up, where it goes on straight at the same feed."""
        ways = [end - self.place_mm[axis] for axis, end in self._target_mm.items()]
        more = [mm - self.end_mm[axis] for axis, mm in following._target_mm.items()]
        same = self._target_mm.keys() == following._target_mm.keys() and len(ways) == 1
        if not same or self._feed_mm_s != following._feed_mm_s or ways[0] * more[0] <= 0.0:
            return False
        self._target_mm = following._target_mm
        self._length_mm += abs(more[0])
        return True

    def advance(self, left_s: float, override: float = 1.0, *, holding: bool = False) -> float:
        """Move on for at most so long and return the time that is left over: s."""
        while left_s > 0.0 and not self.done and not (holding and self.speed_mm_s == 0.0):
            dt_s = min(left_s, STEP_S)
            left_mm = self._length_mm - self._gone_mm
            # Never faster than what it can still stop from.
            stopping_mm_s = sqrt(2.0 * self._accel * left_mm)
            wanted = 0.0 if holding else min(self._feed_mm_s * override, stopping_mm_s)
            change = self._accel * dt_s
            before = self.speed_mm_s
            self.speed_mm_s = min(max(wanted, before - change), before + change)
            if self.speed_mm_s < 1e-9:
                self.speed_mm_s = 0.0
            step_mm = 0.5 * (before + self.speed_mm_s) * dt_s
            if step_mm >= left_mm - 1e-4 and not holding:
                self._gone_mm, self.speed_mm_s = self._length_mm, 0.0
                return left_s - dt_s
            self._gone_mm += min(step_mm, left_mm)
            left_s -= dt_s
        return left_s


def queue_move(
    moves: deque[StageMotion],
    start_mm: Mapping[str, float],
    target_mm: Mapping[str, float],
    feed_mm_min: float,
    settings: VirtualSettings,
) -> None:
    """Add a move to those that wait, or let the last of them go on to its end."""
    fastest, accel = settings.pace(target_mm)
    motion = StageMotion(start_mm, target_mm, min(feed_mm_min, fastest) / 60.0, accel)
    if not (moves and moves[-1].goes_on(motion)) and not motion.done:
        moves.append(motion)


def run_moves(
    moves: deque[StageMotion],
    position_mm: dict[str, float],
    left_s: float,
    override: float,
    *,
    holding: bool,
) -> None:
    """Let moves run for so long, one after another, and write where the axes are."""
    while moves and left_s > 0.0:
        motion = moves[0]
        left_s = motion.advance(left_s, override, holding=holding)
        position_mm |= motion.place_mm
        if not motion.done:
            break
        moves.popleft()


SEARCH = 1.5
"""A switch is sought over so many times the travel."""

STUCK, NO_SWITCH = 8, 9


@dataclass(slots=True)
class StageHardware:
    """Say how switches, buttons and the plate stand.

    Attributes:
        closed: switches that are closed now.
        missing: switches that never close.
        stuck: switches that stay closed.
        pressed: buttons, as reports show them: H hold, S start, R abort.
        lost_mm: how far each axis is from where its steps were counted.
    """

    closed: set[str] = field(default_factory=set)
    missing: set[str] = field(default_factory=set)
    stuck: set[str] = field(default_factory=set)
    pressed: set[str] = field(default_factory=set)
    lost_mm: dict[str, float] = field(default_factory=lambda: dict.fromkeys(AXES, 0.0))


@dataclass(frozen=True, slots=True)
class Homing:
    """Hold a homing under way: when it began and ends, its alarm (0: none), where it ends."""

    begun_s: float
    until_s: float
    alarm: int
    place_mm: dict[str, float]


def homing(
    settings: VirtualSettings,
    counted_mm: Mapping[str, float],
    hardware: StageHardware,
    now_s: float,
) -> Homing:
    """Return what homing will bring: Z first, then X and Y together.

    Args:
        counted_mm: position of each axis as the board counts it.
        hardware: switches, and where the axes really stand.
    """
    seek_mm_s, locate_mm_s, pull_off_mm = settings[25] / 60.0, settings[24] / 60.0, settings[27]
    place_mm, until_s = dict(counted_mm), now_s
    for axes in ("Z", "XY"):
        if missing := [axis for axis in axes if axis in hardware.missing]:
            search_mm = SEARCH * max(settings.of(TRAVEL, axis) for axis in axes)
            place_mm |= dict.fromkeys(missing, search_mm)
            return Homing(now_s, until_s + search_mm / seek_mm_s, NO_SWITCH, place_mm)
        way_mm = max(
            0.0 if axis in hardware.closed else -counted_mm[axis] - hardware.lost_mm[axis]
            for axis in axes
        )
        until_s += way_mm / seek_mm_s + seek_mm_s / settings.of(ACCELERATION, axes[0])
        place_mm |= dict.fromkeys(axes, -pull_off_mm)
        if hardware.stuck.intersection(axes):
            return Homing(now_s, until_s, STUCK, place_mm)
        until_s += pull_off_mm / locate_mm_s + 10.0 * 1e-3 * settings[26]
    return Homing(now_s, until_s, 0, place_mm)
