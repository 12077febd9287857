"""The order of a sweep: settings, and the visits of them, from a plan and its seed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from benchtool.acquire.plan import Plan
from benchtool.core.errors import PlanError
from benchtool.core.rig import Rig

MOST_VISITS = 100_000
"""More take weeks. A choice."""


@dataclass(frozen=True, slots=True)
class Place:
    """A position of the plate; parked counts as out of ground effect."""

    z_m: float
    x_m: float
    tilt_deg: float
    parked: bool = False


@dataclass(frozen=True, slots=True)
class Setting:
    """One combination of plate position and pulse level, numbered from 1."""

    number: int
    place: Place
    level_us: float
    pwm_us: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Visit:
    """One visit of a setting, numbered from 1 in the order of the sweep."""

    point: int
    kind: Literal["measure", "reference", "anchor"]
    setting: Setting
    repeat: int


def settings_of(plan: Plan, rig: Rig) -> tuple[Setting, ...]:
    """Return the settings of a resolved plan: every place with every level, references last."""
    plate = plan.plate
    count = len(plate.tilts_deg) * len(plate.lateral_m) * len(plate.distances_m)
    count = (count + 1) * len(plan.throttle.pwm_us) * (plan.repeats or 1)
    if count > MOST_VISITS:
        raise PlanError(
            f"the plan has about {count:,} visits, limit {MOST_VISITS:,}; give fewer distances, "
            f"tilts, places, levels or repeats"
        )
    places = [
        Place(z_m, x_m, tilt_deg)
        for tilt_deg, x_m, z_m in product(plate.tilts_deg, plate.lateral_m, plate.distances_m)
    ]
    if plan.order.references:
        places.append(Place(rig.plate.z_park_m, 0.0, 0.0, parked=True))
    combinations = product(places, plan.throttle.pwm_us)
    return tuple(
        Setting(number, place, level_us, pulses_us(plan, rig, level_us))
        for number, (place, level_us) in enumerate(combinations, 1)
    )


def pulses_us(plan: Plan, rig: Rig, level_us: float) -> tuple[float, ...]:
    """Return the pulse of every rotor (n_rotors,) at a level: us."""
    stop_us = rig.propulsion.pwm_stop_us
    on = set(plan.throttle.rotors_on)
    return tuple(level_us if rotor in on else stop_us for rotor in range(1, rig.n_rotors + 1))


def visits_of(plan: Plan, rig: Rig) -> tuple[Visit, ...]:
    """Return every visit of a resolved plan in order; the same plan gives the same order.

    Anchors stand at changes of the plate's position, so that they cost one move at most.
    """
    settings = settings_of(plan, rig)
    anchor = _anchor(settings)
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


def _anchor(settings: tuple[Setting, ...]) -> Setting:
    """Return the setting that is repeated for drift: parked when there are references."""
    parked = [setting for setting in settings if setting.place.parked]
    candidates = parked or [s for s in settings if s.place == settings[0].place]
    return sorted(candidates, key=lambda setting: setting.level_us)[len(candidates) // 2]


def _stays(plan: Plan, settings: tuple[Setting, ...]) -> Iterator[tuple[int, list[Setting]]]:
    """Give the settings of every stay at one place, with the number of the repeat."""
    rng = np.random.default_rng(plan.order.seed)
    by_place: dict[Place, list[Setting]] = {}
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
