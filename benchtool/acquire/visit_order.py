"""Settings and order of the visits of a sweep, from plan and seed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import hypot

import numpy as np

from benchtool.acquire.plan import Plan
from benchtool.core.choices import PointKind
from benchtool.core.errors import PlanError
from benchtool.core.rig import Rig

MAX_VISITS = 100_000  # more would take weeks; assumed


@dataclass(frozen=True, slots=True)
class Visit:
    """Visit of a combination of plate position and pulse level.

    Attributes:
        point: number in the order of the sweep, from 1; 0 for a setting that is not visited yet.
        setting: number of the combination, from 1.
        is_parked: out of ground effect.
    """

    target_z_m: float
    target_x_m: float
    target_tilt_deg: float
    is_parked: bool
    setting: int
    pwm_us: tuple[float, ...]
    point: int = 0
    kind: PointKind = "measure"
    repeat: int = 0

    @property
    def position(self) -> tuple[float, float, float, bool]:
        """Plate position; equal positions need no move."""
        return self.target_z_m, self.target_x_m, self.target_tilt_deg, self.is_parked

    @property
    def level_us(self) -> float:
        """Pulse of the rotors that turn."""
        return max(self.pwm_us)

    def description(self, radius_m: float | None) -> str:
        """Return a description with the distance in rotor radii; None: test without a plate."""
        if radius_m is None:
            return f"throttle {self.level_us:.0f} us"
        where = "parked" if self.is_parked else f"z/R {self.target_z_m / radius_m:.2f}"
        return f"{self.kind} {where}, {self.level_us:.0f} us"


def plan_settings(plan: Plan, rig: Rig) -> tuple[Visit, ...]:
    """Return the settings of a resolved plan: every position with every level, references last."""
    plate = plan.plate
    distances_m = _distances_m(plan)
    count = len(plate.tilts_deg) * len(plate.lateral_m) * len(distances_m)
    count = (count + 1) * len(plan.throttle.pwm_us) * (plan.repeats or 1)
    if count > MAX_VISITS:
        raise PlanError(
            f"the plan has about {count:,} visits, limit {MAX_VISITS:,}; use fewer distances, "
            f"tilts, positions, levels or repeats"
        )
    positions = [
        (z_m, x_m, tilt_deg, False)
        for tilt_deg, x_m, z_m in product(plate.tilts_deg, plate.lateral_m, distances_m)
    ]
    if plan.order.references:
        positions.append((rig.plate.z_park_m, 0.0, 0.0, True))
    is_on = [rotor in plan.throttle.rotors_on for rotor in range(1, rig.n_rotors + 1)]
    stop_us = rig.propulsion.pwm_stop_us
    combinations = product(positions, plan.throttle.pwm_us)
    return tuple(
        Visit(*position, number, tuple(np.where(is_on, level_us, stop_us).tolist()))
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
    candidates = [setting for setting in settings if setting.is_parked] or [
        setting for setting in settings if setting.position == settings[0].position
    ]
    anchor = sorted(candidates, key=lambda setting: setting.level_us)[len(candidates) // 2]
    visits: list[Visit] = []
    anchors = since = 0
    every = plan.order.anchor_every

    def add(kind: PointKind, setting: Visit, repeat: int) -> None:
        visits.append(replace(setting, point=len(visits) + 1, kind=kind, repeat=repeat))

    for repeat, group in _position_groups(plan, settings):
        if every and (not visits or since >= every):
            anchors, since = anchors + 1, 0
            add("anchor", anchor, anchors)
        for setting in group:
            add("reference" if setting.is_parked else "measure", setting, repeat)
            since += 1
    if every and anchors and since:
        add("anchor", anchor, anchors + 1)
    return tuple(visits)


def _position_groups(plan: Plan, settings: tuple[Visit, ...]) -> Iterator[tuple[int, list[Visit]]]:
    """Yield the settings of one plate position at a time, with the number of the repeat."""
    rng = np.random.default_rng(plan.order.seed)
    by_position: dict[tuple[float, ...], list[Visit]] = {}
    for setting in settings:
        by_position.setdefault(setting.position, []).append(setting)
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


def min_duration_s(plan: Plan) -> float:
    """Return the minimum duration of a resolved plan in any order: s.

    Computed from counts, so that it is fast for a plan of a billion visits.
    """
    plate = plan.plate
    positions = len(_distances_m(plan)) * len(plate.tilts_deg) * len(plate.lateral_m)
    positions += plan.order.references
    visits = positions * len(plan.throttle.pwm_us) * (plan.repeats or 1)
    return visits * visit_s(plan)


def expected_duration_s(
    plan: Plan, rig: Rig, visits: Sequence[Visit], last: Visit | None = None
) -> float:
    """Return the expected duration of visits in this order: s.

    Args:
        last: visit before them; None before a sweep, which starts with a tare.
    """
    total_s = 0.0
    tares = 1 if last is None else 0
    for visit in visits:
        total_s += visit_s(plan)
        if last is None or last.position != visit.position:
            z_m, x_m = (last.target_z_m, last.target_x_m) if last else (rig.plate.z_park_m, 0.0)
            distance_m = hypot(visit.target_z_m - z_m, visit.target_x_m - x_m)
            total_s += STOP_S + distance_m / rig.plate.speed_m_s
        last = visit
    tare_s = plan.tare.seconds + STOP_S
    if plan.tare.every_minutes:
        tares += int(total_s // (60.0 * plan.tare.every_minutes))
    return total_s + tares * tare_s


def format_duration(seconds: float) -> str:
    """Return a duration as text: 1 h 05 min, 3 min 20 s."""
    whole = max(0, round(seconds))
    if whole >= 3600:
        return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
    return f"{whole // 60} min {whole % 60:02d} s" if whole >= 60 else f"{whole} s"
