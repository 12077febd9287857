"""How long a sweep will take, before anything spins."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

from benchtool.acquire.order import Place, Visit
from benchtool.acquire.plan import Plan
from benchtool.core.rig import Rig

SETTLE_WINDOWS = 1.4
"""Windows that settling takes as a rule; measured on the virtual bench."""

STOP_S = 1.5
"""Time for rotors to stand still before the plate moves; an assumption, watched on every move."""


def visit_s(plan: Plan) -> float:
    """Return the time of one visit without a move: s."""
    settle_s = min(SETTLE_WINDOWS * plan.settle.window_s, plan.settle.timeout_s)
    return plan.throttle.ramp_s + settle_s + plan.sample_s


def move_s(plan: Plan, rig: Rig, start: Place | None, end: Place) -> float:
    """Return the time of a move with the rotors stopped before it: s."""
    if start == end:
        return 0.0
    z_m, x_m = (start.z_m, start.x_m) if start else (rig.plate.z_park_m, 0.0)
    return STOP_S + hypot(end.z_m - z_m, end.x_m - x_m) / rig.plate.speed_m_s


def least_duration_s(plan: Plan, rig: Rig) -> float:
    """Return a time that every order of a resolved plan takes at least: s.

    From counts alone, so that a plan of a billion visits is judged at once.
    """
    plate = plan.plate
    places = len(plate.distances_m) * len(plate.tilts_deg) * len(plate.lateral_m)
    places += plan.order.references
    visits = places * len(plan.throttle.pwm_us) * (plan.repeats or 1)
    return visits * visit_s(plan)


def expected_duration_s(
    plan: Plan, rig: Rig, visits: Sequence[Visit], place: Place | None = None
) -> float:
    """Return the time that visits in this order will take: s.

    Args:
        plan: resolved.
        rig: speed and park position of the plate.
        visits: those that are left.
        place: where the plate stands; None before a sweep, which then begins with a tare.
    """
    total_s = 0.0
    tares = 1 if place is None else 0
    for visit in visits:
        total_s += visit_s(plan) + move_s(plan, rig, place, visit.setting.place)
        place = visit.setting.place
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
