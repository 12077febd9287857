"""What a plan comes to before anything spins: visits, order, duration, limits. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from benchtool.acquire.arming import arming_text
from benchtool.acquire.check_plan import check_plan
from benchtool.acquire.duration import expected_duration_s, minutes
from benchtool.acquire.order import settings_of, visits_of
from benchtool.acquire.plan import Plan
from benchtool.core.rig import Rig

SHOWN_VISITS = 400
"""Rows of the order that are shown; a longer plan is told by its counts."""


@dataclass(frozen=True, slots=True)
class Preview:
    """Hold what is shown of a plan.

    Attributes:
        facts: name to text.
        arming: what the operator must know before confirming.
        order: rows of visit, kind, z/R, pulse, repeat.
        visits: how many there are.
    """

    facts: Mapping[str, str]
    arming: str
    order: tuple[tuple[str, ...], ...]
    visits: int


def preview_of(plan: Plan, rig: Rig, device_limits: Mapping[str, float] | None) -> Preview:
    """Return the preview of a plan, not resolved yet.

    Raises:
        PlanError: the limits of rig or device do not allow it.
    """
    resolved = plan.resolved(rig)
    expected = check_plan(resolved, rig, device_limits)
    visits = visits_of(resolved, rig)
    radius_m = rig.propulsion.radius_m
    kinds = [visit.kind for visit in visits]
    distances = ", ".join(f"{z_m / radius_m:g}" for z_m in resolved.plate.distances_m)
    pulses = ", ".join(f"{pulse:g}" for pulse in resolved.throttle.pwm_us)
    facts = {
        "rig": f"{rig.name}: {rig.title}",
        "plate z/R": distances,
        "pulses": f"{pulses} us",
        "visits": (
            f"{len(visits)}, of {len(settings_of(resolved, rig))} settings: "
            f"{resolved.repeats} repeats, {kinds.count('reference')} references, "
            f"{kinds.count('anchor')} anchors"
        ),
        "duration": f"about {minutes(expected_duration_s(resolved, rig, visits))}",
        "limits hold": (
            f"at most {expected.pwm_us:g} us, about {expected.rpm:.0f} rpm and "
            f"{expected.thrust_N:.1f} N of {rig.limits.thrust_N:g} N"
        ),
    }
    rows = tuple(
        (
            str(visit.point),
            visit.kind,
            "parked" if visit.setting.place.parked else f"{visit.setting.place.z_m / radius_m:.2f}",
            f"{visit.setting.level_us:g}",
            str(visit.repeat),
        )
        for visit in visits[:SHOWN_VISITS]
    )
    return Preview(facts, arming_text(resolved, rig, expected), rows, len(visits))
