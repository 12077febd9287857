"""Check of a plan against the limits of rig and device."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import atan2, degrees, radians, tan

import numpy as np

from benchtool.acquire.plan import Plan, PlatePart
from benchtool.acquire.visit_order import Visit, min_duration_s, plan_settings
from benchtool.core.errors import PlanError
from benchtool.core.inputs import items, with_changes
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model
from benchtool.physics.rotor import speed_from_pwm

MAX_DURATION_S = 48.0 * 3600.0  # a longer plan is probably a typing error; assumed
BODY_LIFT_K = 2.0  # K_b of the expected thrust: "close to 2" (paper, section 2.2)


@dataclass(frozen=True, slots=True)
class PlanExtremes:
    """Maxima of a plan: pulse, speed, thrust out of and in ground effect."""

    pwm_us: float
    rpm: float
    thrust_oge_N: float
    thrust_N: float


def expected_extremes(plan: Plan, rig: Rig) -> PlanExtremes:
    """Return the maxima of a resolved plan at nominal voltage.

    Thrust from the rig's k and pwm map, with eq. (3) for the rotors and eq. (4) for the body of a
    multirotor.
    """
    settings = plan_settings(plan, rig)
    thrust_N, thrust_oge_N, rpm = expected_thrust_N(settings, rig)
    maxima = (rpm.max(), thrust_oge_N.max(), np.abs(thrust_N).max())
    return PlanExtremes(float(max(max(s.pwm_us) for s in settings)), *map(float, maxima))


def expected_thrust_N(settings: Sequence[Visit], rig: Rig) -> tuple[Array, Array, Array]:
    """Return the thrust (n,) of settings at nominal voltage, that without a plate, and rpm."""
    model = Model.single(rig)
    if rig.n_discs > 1:
        model = model.with_effect("neighbour_images").with_effect("body_lift", K_b=BODY_LIFT_K)
    p = rig.propulsion
    pulses = np.array([setting.pwm_us for setting in settings], float).T
    speed = np.asarray(
        speed_from_pwm(
            pulses,
            p.speed_per_us_rad_s,
            p.pwm_start_us,
            np.full(len(settings), p.voltage_nominal_V),
            p.voltage_nominal_V,
        )
    )
    speed = np.where(pulses > p.pwm_start_us, speed, 0.0)
    conditions = Conditions.build(
        rig,
        speed_rad_s=speed,
        plate_z_m=np.array([setting.target_z_m for setting in settings]),
        plate_x_m=np.array([setting.target_x_m for setting in settings]),
        plate_tilt_rad=np.array([radians(setting.target_tilt_deg) for setting in settings]),
    )
    in_ground_effect = np.asarray(model.thrust_N(conditions), float)
    out_of_ground_effect = np.asarray(model.thrust_N(conditions.out_of_ground_effect()), float)
    return in_ground_effect, out_of_ground_effect, speed * 60.0 / (2.0 * np.pi)


def check_plan(
    plan: Plan, rig: Rig, device_limits: Mapping[str, float] | None = None
) -> PlanExtremes:
    """Return the maxima of a resolved plan; raise PlanError if they exceed the limits."""
    _check_lists(plan, rig)
    duration_s = min_duration_s(plan)
    if duration_s > MAX_DURATION_S:
        raise PlanError(
            f"the plan takes at least {duration_s / 3600.0:,.0f} h, limit "
            f"{MAX_DURATION_S / 3600.0:g} h; lower repeats ({plan.repeats:,}) or sample_s "
            f"({plan.sample_s:g} s), or split the sweep"
        )
    settings = plan_settings(plan, rig)
    device = dict(device_limits or {})
    max_rotors, rotors_on = device.get("rotors_together", np.inf), plan.throttle.rotors_on
    if len(rotors_on) > max_rotors:
        listed = ", ".join(map(str, rotors_on))
        raise PlanError(
            f"throttle.rotors_on turns rotors {listed} together, but this autopilot's motor "
            f"test turns {max_rotors:g} at a time; name one with --rotors {rotors_on[0]}"
        )
    max_us = min(rig.limits.pwm_us, rig.propulsion.pwm_max_us, device.get("pwm_us", np.inf))
    stop_us = rig.propulsion.pwm_stop_us
    for level_us in plan.throttle.pwm_us:
        if not stop_us < level_us <= max_us:
            raise PlanError(
                f"throttle.pwm_us names {level_us:g} us, allowed are {stop_us:g} to "
                f"{max_us:g} us; change that level or the rig's limits.pwm_us"
            )
    for setting in settings:
        _check_position(setting, rig, device)
    expected = expected_extremes(plan, rig)
    allowed_N = min(
        rig.limits.thrust_N, rig.limits.load_cell_rating_N, device.get("thrust_N", np.inf)
    )
    if expected.thrust_N > allowed_N:
        raise PlanError(
            f"the plan would give about {expected.thrust_N:.3g} N at {expected.pwm_us:g} us"
            f"{' close to the plate' if plan.plate.used else ''}, limit {allowed_N:.3g} N; lower "
            f"throttle.pwm_us{', move the plate away' if plan.plate.used else ''} "
            f"or raise limits.thrust_N within the load cell's rating of "
            f"{rig.limits.load_cell_rating_N:g} N"
        )
    allowed_rpm = min(rig.limits.rpm, device.get("rpm", np.inf))
    if expected.rpm > allowed_rpm:
        raise PlanError(
            f"the plan would give about {expected.rpm:.0f} rpm at {expected.pwm_us:g} us, limit "
            f"{allowed_rpm:.0f} rpm; lower throttle.pwm_us"
        )
    return expected


def _check_lists(plan: Plan, rig: Rig) -> None:
    if not plan.plate.used and not plan.order.references:
        raise PlanError(
            "plate.used and order.references are both false, so the plan has no points; remove "
            "order.references"
        )
    changes = {} if plan.plate.used else with_changes(plan.plate)
    for item in items(PlatePart):
        if item.name in changes:
            raise PlanError(
                f"plate.{item.key} ({item.option}) is given, but the plan turns rotors without a "
                f"plate (plate.used = false); remove it, or use another plan"
            )
    if plan.plate.used and not plan.plate.distances_m:
        raise PlanError(
            f"no plate distance between the minimum of {rig.plate.z_min_m:g} m and the "
            f"park position at {rig.plate.z_park_m:g} m; give plate.distances_m"
        )
    unknown = [rotor for rotor in plan.throttle.rotors_on if rotor > rig.n_rotors]
    if unknown:
        raise PlanError(
            f"throttle.rotors_on names rotor {unknown[0]}, but rig {rig.name!r} has rotors 1 to "
            f"{rig.n_rotors}; correct the number"
        )
    lists: dict[str, tuple[float, ...]] = {
        "plate.distances_m": plan.plate.distances_m,
        "plate.tilts_deg": plan.plate.tilts_deg,
        "plate.lateral_m": plan.plate.lateral_m,
        "throttle.pwm_us": plan.throttle.pwm_us,
        "throttle.rotors_on": plan.throttle.rotors_on,
    }
    for name, numbers in lists.items():
        duplicates = [number for number in numbers if numbers.count(number) > 1]
        if duplicates:
            raise PlanError(
                f"{name} contains {duplicates[0]:g} twice; remove one (set repeats for more points)"
            )
    cooldown = plan.rest
    if cooldown.above_degC is not None and cooldown.until_degC >= cooldown.above_degC:
        raise PlanError(
            f"rest.until_degC {cooldown.until_degC:g} is not below rest.above_degC "
            f"{cooldown.above_degC:g}; lower it"
        )


def _check_position(setting: Visit, rig: Rig, device: Mapping[str, float]) -> None:
    plate = rig.plate
    z_m, x_m, tilt_deg, _ = setting.position
    low_m = max(plate.z_min_m, device.get("plate_z_min_m", 0.0))
    high_m = min(plate.z_max_m, device.get("plate_z_max_m", np.inf))
    if not low_m <= z_m <= high_m:
        raise PlanError(
            f"plate distance {z_m:g} m (z/R = "
            f"{z_m / rig.propulsion.radius_m:.2f}) is out of range; allowed: {low_m:g} to "
            f"{high_m:g} m; change plate.distances or the rig's plate.z_min_m, z_max_m"
        )
    side_m = min(rig.plate_x_max_m, device.get("plate_x_max_m", np.inf))
    if abs(x_m) > side_m:
        raise PlanError(
            f"lateral position {x_m:g} m is out of range; allowed: -{side_m:g} to "
            f"{side_m:g} m; change plate.lateral_m or the rig's plate.x_max_m"
        )
    tips_m = max(abs(rotor.x_m) for rotor in rig.rotors) + rig.propulsion.radius_m
    reach_m = min(abs(x_m) + tips_m, 0.5 * plate.size_x_m)  # from the pivot at the centre
    nearest_m = z_m - reach_m * tan(abs(radians(tilt_deg)))
    if nearest_m < low_m:
        max_deg = degrees(atan2(z_m - low_m, reach_m))
        raise PlanError(
            f"at {z_m:g} m a tilt of {tilt_deg:g} deg brings the plate to "
            f"{nearest_m:.3g} m of the blade tips, minimum distance {low_m:g} m; tilt at most "
            f"{max_deg:.1f} deg there or use a larger distance"
        )
