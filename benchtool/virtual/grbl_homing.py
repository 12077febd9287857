"""What is around the board of a virtual stage, and what comes of homing there. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from benchtool.virtual.grbl_settings import ACCELERATION, AXES, TRAVEL, VirtualSettings

SEARCH = 1.5
"""A switch is sought over so many times the travel."""

STUCK, NO_SWITCH = 8, 9


@dataclass(slots=True)
class Surroundings:
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
    settings: VirtualSettings, counted_mm: Mapping[str, float], around: Surroundings, now_s: float
) -> Homing:
    """Return what homing will bring: Z first, then X and Y together.

    Args:
        settings: feeds, pauses, travel.
        counted_mm: position of each axis as the board counts it.
        around: switches, and where the axes really stand.
        now_s: time at which it begins.
    """
    seek_mm_s, locate_mm_s, pull_off_mm = settings[25] / 60.0, settings[24] / 60.0, settings[27]
    place_mm, until_s = dict(counted_mm), now_s
    for axes in ("Z", "XY"):
        if missing := [axis for axis in axes if axis in around.missing]:
            search_mm = SEARCH * max(settings.of(TRAVEL, axis) for axis in axes)
            place_mm |= dict.fromkeys(missing, search_mm)
            return Homing(now_s, until_s + search_mm / seek_mm_s, NO_SWITCH, place_mm)
        way_mm = max(
            0.0 if axis in around.closed else -counted_mm[axis] - around.lost_mm[axis]
            for axis in axes
        )
        until_s += way_mm / seek_mm_s + seek_mm_s / settings.of(ACCELERATION, axes[0])
        place_mm |= dict.fromkeys(axes, -pull_off_mm)
        if around.stuck.intersection(axes):
            return Homing(now_s, until_s, STUCK, place_mm)
        until_s += pull_off_mm / locate_mm_s + 10.0 * 1e-3 * settings[26]
    return Homing(now_s, until_s, 0, place_mm)
