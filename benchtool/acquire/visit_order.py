"""Settings and order of the visits of a sweep, from plan and seed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import hypot

import numpy as np

from benchtool.acquire.plan import Plan
from benchtool.core.choices import PointKind
from benchtool.core.errors import PlanError
from benchtool.core.rig import Rig

MAX_VISITS = 100_000  # more would take weeks; assumed


@dataclass(frozen=True, slots=True)
class PlatePosition:
    """Plate position; parked means out of ground effect."""

    z_m: float
    x_m: float
    tilt_deg: float
    parked: bool = False


@dataclass(frozen=True, slots=True)
class Setting:
    """Combination of plate position and pulse level, numbered from 1."""

    number: int
    place: PlatePosition
    level_us: float
    pwm_us: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Visit:
    """Visit of a setting, numbered from 1 in the order of the sweep."""

    point: int
    kind: PointKind
    setting: Setting
    repeat: int

    def description(self, radius_m: float | None) -> str:
        """Return a description with the distance in rotor radii; None: test without a plate."""
        position = self.setting.place
        if radius_m is None:
            return f"throttle {self.setting.level_us:.0f} us"
        where = "parked" if position.parked else f"z/R {position.z_m / radius_m:.2f}"
        return f"{self.kind} {where}, {self.setting.level_us:.0f} us"


def plan_settings(plan: Plan, rig: Rig) -> tuple[Setting, ...]:
    """Return the settings of a resolved plan: every position with every level, references last."""
    plate = plan.plate
    count = len(plate.tilts_deg) * len(plate.lateral_m) * len(_distances_m(plan))
    count = (count + 1) * len(plan.throttle.pwm_us) * (plan.repeats or 1)
    if count > MAX_VISITS:
        raise PlanError(
            f"the plan has about {count:,} visits, limit {MAX_VISITS:,}; use fewer distances, "
            f"tilts, positions, levels or repeats"
        )
    positions = [
        PlatePosition(z_m, x_m, tilt_deg)
        for tilt_deg, x_m, z_m in product(plate.tilts_deg, plate.lateral_m, _distances_m(plan))
    ]
    if plan.order.references:
        positions.append(PlatePosition(rig.plate.z_park_m, 0.0, 0.0, parked=True))
    is_on = [rotor in plan.throttle.rotors_on for rotor in range(1, rig.n_rotors + 1)]
    stop_us = rig.propulsion.pwm_stop_us
    combinations = product(positions, plan.throttle.pwm_us)
    return tuple(
        Setting(number, position, level_us, tuple(np.where(is_on, level_us, stop_us).tolist()))
        for number, (position, level_us) in enumerate(combinations, 1)
    )


def _distances_m(plan: Plan) -> tuple[float, ...]:
    return plan.plate.distances_m if plan.plate.used else ()


def plan_visits(plan: Plan, rig: Rig) -> tuple[Visit, ...]:
    """Return the visits of a resolved plan in order; the same plan gives the same order.

    Anchors are placed at changes of the plate position, so that they need at most one extra move.
    """
    settings = plan_settings(plan, rig)
    # The anchor is parked if there are references.
    candidates = [setting for setting in settings if setting.place.parked] or [
        setting for setting in settings if setting.place == settings[0].place
    ]
    anchor = sorted(candidates, key=lambda setting: setting.level_us)[len(candidates) // 2]
    visits: list[Visit] = []
    anchors = since = 0
    every = plan.order.anchor_every

    def add(kind: PointKind, setting: Setting, repeat: int) -> None:
        visits.append(Visit(len(visits) + 1, kind, setting, repeat))

    for repeat, group in _position_groups(plan, settings):
        if every and (not visits or since >= every):
            anchors, since = anchors + 1, 0
            add("anchor", anchor, anchors)
        for setting in group:
            add("reference" if setting.place.parked else "measure", setting, repeat)
            since += 1
    if every and anchors and since:
        add("anchor", anchor, anchors + 1)
    return tuple(visits)


def _position_groups(
    plan: Plan, settings: tuple[Setting, ...]
) -> Iterator[tuple[int, list[Setting]]]:
    """Yield the settings of one plate position at a time, with the number of the repeat."""
    rng = np.random.default_rng(plan.order.seed)
    by_position: dict[PlatePosition, list[Setting]] = {}
    for setting in settings:
        by_position.setdefault(setting.place, []).append(setting)
    groups = list(by_position.values())
    for repeat in range(1, (plan.repeats or 1) + 1):
        is_reversed = plan.order.kind == "counterbalanced" and repeat % 2 == 0
        if plan.order.kind == "randomised":
            shuffled = [groups[i] for i in rng.permutation(len(groups))]
            ordered = [[group[i] for i in rng.permutation(len(group))] for group in shuffled]
        elif is_reversed:
            ordered = [group[::-1] for group in groups[::-1]]
        else:
            ordered = groups
        for group in ordered:
            yield repeat, group


SETTLE_WINDOWS = 1.4  # typical settling time in windows; measured on the virtual bench
STOP_S = 1.5  # time for rotors to stop before the plate moves; checked on every move; assumed


def visit_s(plan: Plan) -> float:
    """Return the time of one visit without a move: s."""
    settle_s = min(SETTLE_WINDOWS * plan.settle.window_s, plan.settle.timeout_s)
    return plan.throttle.ramp_s + settle_s + plan.sample_s


def min_duration_s(plan: Plan, rig: Rig) -> float:
    """Return the minimum duration of a resolved plan in any order: s.

    Computed from counts, so that it is fast for a plan of a billion visits.
    """
    plate = plan.plate
    positions = len(_distances_m(plan)) * len(plate.tilts_deg) * len(plate.lateral_m)
    positions += plan.order.references
    visits = positions * len(plan.throttle.pwm_us) * (plan.repeats or 1)
    return visits * visit_s(plan)


def expected_duration_s(
    plan: Plan, rig: Rig, visits: Sequence[Visit], start: PlatePosition | None = None
) -> float:
    """Return the expected duration of visits in this order: s.

    Args:
        start: plate position; None before a sweep, which starts with a tare.
    """
    total_s = 0.0
    position, tares = start, 1 if start is None else 0
    for visit in visits:
        end = visit.setting.place
        total_s += visit_s(plan)
        if position != end:
            z_m, x_m = (position.z_m, position.x_m) if position else (rig.plate.z_park_m, 0.0)
            total_s += STOP_S + hypot(end.z_m - z_m, end.x_m - x_m) / rig.plate.speed_m_s
        position = end
    tare_s = plan.tare.seconds + STOP_S
    if plan.tare.every_minutes:
        tares += int(total_s // (60.0 * plan.tare.every_minutes))
    return total_s + tares * tare_s


def format_duration(seconds: float) -> str:
    """Return a duration as text: 1 h 05 min, 3 min 20 s."""
    whole = max(0, round(seconds))
    if whole >= 3600:
        return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
    return f"{whole // 60} min {whole % 60:02d} s"
