"""The order of a sweep: settings, and the visits of them, from a plan and its seed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import hypot
from typing import Literal

import numpy as np

from benchtool.acquire.plan import Plan
from benchtool.core.errors import PlanError
from benchtool.core.rig import Rig

MAX_VISITS = 100_000  # more take weeks; assumed


@dataclass(frozen=True, slots=True)
class PlatePosition:
    """A position of the plate; parked counts as out of ground effect."""

    z_m: float
    x_m: float
    tilt_deg: float
    parked: bool = False


@dataclass(frozen=True, slots=True)
class Setting:
    """One combination of plate position and pulse level, numbered from 1."""

    number: int
    place: PlatePosition
    level_us: float
    pwm_us: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Visit:
    """One visit of a setting, numbered from 1 in the order of the sweep."""

    point: int
    kind: Literal["measure", "reference", "anchor"]
    setting: Setting
    repeat: int

    def words(self, radius_m: float | None) -> str:
        """Say what is visited, its distance in rotor radii; None in a test without a plate."""
        place = self.setting.place
        if radius_m is None:
            return f"throttle {self.setting.level_us:.0f} us"
        where = "parked" if place.parked else f"z/R {place.z_m / radius_m:.2f}"
        return f"{self.kind} {where}, {self.setting.level_us:.0f} us"


def plan_settings(plan: Plan, rig: Rig) -> tuple[Setting, ...]:
    """Return the settings of a resolved plan: every place with every level, references last."""
    plate = plan.plate
    count = len(plate.tilts_deg) * len(plate.lateral_m) * len(_distances_m(plan))
    count = (count + 1) * len(plan.throttle.pwm_us) * (plan.repeats or 1)
    if count > MAX_VISITS:
        raise PlanError(
            f"the plan has about {count:,} visits, limit {MAX_VISITS:,}; give fewer distances, "
            f"tilts, places, levels or repeats"
        )
    places = [
        PlatePosition(z_m, x_m, tilt_deg)
        for tilt_deg, x_m, z_m in product(plate.tilts_deg, plate.lateral_m, _distances_m(plan))
    ]
    if plan.order.references:
        places.append(PlatePosition(rig.plate.z_park_m, 0.0, 0.0, parked=True))
    turning = [rotor in plan.throttle.rotors_on for rotor in range(1, rig.n_rotors + 1)]
    stop_us = rig.propulsion.pwm_stop_us
    combinations = product(places, plan.throttle.pwm_us)
    return tuple(
        Setting(number, place, level_us, tuple(np.where(turning, level_us, stop_us).tolist()))
        for number, (place, level_us) in enumerate(combinations, 1)
    )


def _distances_m(plan: Plan) -> tuple[float, ...]:
    return plan.plate.distances_m if plan.plate.used else ()


def plan_visits(plan: Plan, rig: Rig) -> tuple[Visit, ...]:
    """Return every visit of a resolved plan in order; the same plan gives the same order.

    Anchors stand at changes of the plate's position, so that they cost one move at most.
    """
    settings = plan_settings(plan, rig)
    # What is repeated for drift: parked when there are references.
    candidates = [setting for setting in settings if setting.place.parked] or [
        setting for setting in settings if setting.place == settings[0].place
    ]
    anchor = sorted(candidates, key=lambda setting: setting.level_us)[len(candidates) // 2]
    visits: list[Visit] = []
    anchors = since = 0
    every = plan.order.anchor_every

    def add(kind: Literal["measure", "reference", "anchor"], setting: Setting, repeat: int) -> None:
        visits.append(Visit(len(visits) + 1, kind, setting, repeat))

    for repeat, stay in _stays(plan, settings):
        if every and (not visits or since >= every):
            anchors, since = anchors + 1, 0
            add("anchor", anchor, anchors)
        for setting in stay:
            add("reference" if setting.place.parked else "measure", setting, repeat)
            since += 1
    if every and anchors and since:
        add("anchor", anchor, anchors + 1)
    return tuple(visits)


def _stays(plan: Plan, settings: tuple[Setting, ...]) -> Iterator[tuple[int, list[Setting]]]:
    """Give the settings of every stay at one place, with the number of the repeat."""
    rng = np.random.default_rng(plan.order.seed)
    by_place: dict[PlatePosition, list[Setting]] = {}
    for setting in settings:
        by_place.setdefault(setting.place, []).append(setting)
    stays = list(by_place.values())
    for repeat in range(1, (plan.repeats or 1) + 1):
        backwards = plan.order.kind == "counterbalanced" and repeat % 2 == 0
        if plan.order.kind == "randomised":
            order = [stays[i] for i in rng.permutation(len(stays))]
            chosen = [[stay[i] for i in rng.permutation(len(stay))] for stay in order]
        elif backwards:
            chosen = [stay[::-1] for stay in stays[::-1]]
        else:
            chosen = stays
        for stay in chosen:
            yield repeat, stay


SETTLE_WINDOWS = 1.4  # windows that settling takes as a rule; measured on the virtual bench
STOP_S = 1.5  # time for rotors to stop before the plate moves; checked on every move; assumed


def visit_s(plan: Plan) -> float:
    """Return the time of one visit without a move: s."""
    settle_s = min(SETTLE_WINDOWS * plan.settle.window_s, plan.settle.timeout_s)
    return plan.throttle.ramp_s + settle_s + plan.sample_s


def min_duration_s(plan: Plan, rig: Rig) -> float:
    """Return a time that every order of a resolved plan takes at least: s.

    From counts alone, so that a plan of a billion visits is judged at once.
    """
    plate = plan.plate
    places = len(_distances_m(plan)) * len(plate.tilts_deg) * len(plate.lateral_m)
    places += plan.order.references
    visits = places * len(plan.throttle.pwm_us) * (plan.repeats or 1)
    return visits * visit_s(plan)


def expected_duration_s(
    plan: Plan, rig: Rig, visits: Sequence[Visit], place: PlatePosition | None = None
) -> float:
    """Return the time that visits in this order will take: s.

    Args:
        place: where the plate stands; None before a sweep, which then begins with a tare.
    """
    total_s = 0.0
    tares = 1 if place is None else 0
    for visit in visits:
        end = visit.setting.place
        total_s += visit_s(plan)
        if place != end:
            z_m, x_m = (place.z_m, place.x_m) if place else (rig.plate.z_park_m, 0.0)
            total_s += STOP_S + hypot(end.z_m - z_m, end.x_m - x_m) / rig.plate.speed_m_s
        place = end
    tare_s = plan.tare.seconds + STOP_S
    if plan.tare.every_minutes:
        tares += int(total_s // (60.0 * plan.tare.every_minutes))
    return total_s + tares * tare_s


def minutes(seconds: float) -> str:
    """Return a duration as people read it."""
    whole = max(0, round(seconds))
    if whole >= 3600:
        return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
    return f"{whole // 60} min {whole % 60:02d} s"
