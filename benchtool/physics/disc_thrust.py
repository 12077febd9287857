"""Thrust of every disc near a surface: the only place where the terms of eqs. (2) to (4) meet.

The factor of disc i is F_i = 1 / (1 - D_i), D_i the sum of all effects' terms (own image, images
of the neighbours, body lift, ...); a disc covered in part takes 1 + a_i (F_i - 1), blades answer to
that, and effects' factors multiply it. Every disc enters with its own height. The same functions
serve a sweep's arrays, a pitch bench and every surface under a vehicle in flight.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache, lru_cache
from itertools import accumulate
from typing import Any, NamedTuple

from benchtool.core.errors import InputError
from benchtool.physics.distance_law import nearest_z_over_R
from benchtool.physics.effects.effect import Effect, Flow
from benchtool.physics.expression import expression
from benchtool.physics.fold import Hook, Own, added, chained, each, multiplied, selected, summed
from benchtool.physics.images import image_velocity, partial_factor, thrust_factor
from benchtool.physics.validity import clamped_height
from benchtool.physics.wake_rules import wake_rule


class DiscThrust(NamedTuple):
    """Hold the joined functions; `p` is the tuple of all effects' values, in their order.

    Attributes:
        speeds: speeds(flow, p) -> commanded speeds, changed by effects (n,).
        with_images: with_images(flow, distances, arms, p) -> the flow with heights and coverages
            changed by effects, and the images that follow: distances [n][n] between discs, arms
            from the body's centre to the images of eq. (4): m.
        image_factors: image_factors(flow, p) -> 1 + a (1/(1 - D) - 1) of each disc (n,).
        scaled: scaled(first, flow, p) -> what blades make of first (n,), times effects' factors.
        drags: drags(first, flow, p) -> drag torque over that far away (n,), for `first`.
        factors: factors(flow, p) -> T_IGE/T_OGE of each disc (n,): both together.
        nearest_z_over_R: least distance at which the effects' law holds; clamped heights end there.
    """

    speeds: Hook
    with_images: Hook
    image_factors: Hook
    scaled: Hook
    drags: Hook
    factors: Hook
    nearest_z_over_R: float


UNCHANGED = expression(lambda i, first, flow, p: 1.0)
"""Drag torque where no effect changes it."""


def owned(effects: Iterable[Effect], hook: str) -> tuple[Own, ...]:
    """Return one hook of every effect that has it, with the place of the effect's numbers."""
    all_effects = tuple(effects)
    ends = accumulate((len(effect.parameters) for effect in all_effects), initial=0)
    return tuple(
        Own(call, effect.makes_p, start, start + len(effect.parameters))
        for effect, start in zip(all_effects, ends, strict=False)
        if (call := getattr(effect.hooks, hook)) is not None
    )


@lru_cache(maxsize=256)
def disc_thrust(
    effects: tuple[Effect, ...],
    n_discs: int,
    rule: str,
    arms: tuple[int, ...],
    *,
    clamped: bool = False,
) -> DiscThrust:
    """Return the joined functions of effects for a number of discs.

    Args:
        effects: that act, in the order in which they change quantities and are summed.
        n_discs: of the vehicle.
        rule: wake rule (`wake_rules`).
        arms: of each image of eq. (4) the number that are as far from the body's centre, 0 where
            an earlier image counts it (`physics.body_lift.equal_arms`).
        clamped: hold heights at the least where the formulae are valid; for simulators.
    """
    n = n_discs
    height, coverage = chained(owned(effects, "height")), chained(owned(effects, "coverage"))
    speed, factor = chained(owned(effects, "speed")), multiplied(owned(effects, "factor"))
    denominator = summed(owned(effects, "denominator"))
    response, torques = chained(owned(effects, "response")), owned(effects, "drag")
    if len(torques) > 1:
        raise InputError("two effects of the model have the hook drag; leave one out")
    drag = chained(torques) if torques else UNCHANGED
    weight = wake_rule(rule).weight
    nearest = nearest_z_over_R(effect.distance_law for effect in effects)
    if clamped:
        heights = each(
            n,
            expression(
                lambda i, flow, p: clamped_height(
                    height(i, flow.height_m[i], flow, p), nearest * flow.radius_m
                )
            ),
        )
    else:
        heights = each(n, expression(lambda i, flow, p: height(i, flow.height_m[i], flow, p)))
    coverages = each(n, expression(lambda i, flow, p: coverage(i, flow.coverage[i], flow, p)))
    sources = each(n, expression(lambda i, area, active: area[i] * active[i]))
    neighbours = each(n, selected(tuple(_neighbours_of(i, n) for i in range(n))))
    body = added(tuple(_body_image(j, count) for j, count in enumerate(arms) if count))
    bodies = each(n, expression(lambda i, z, arms: body(z[i], arms)))
    image_factors = each(
        n,
        expression(
            lambda i, flow, p: partial_factor(
                thrust_factor(denominator(i, flow, p)), flow.coverage[i]
            )
        ),
    )
    scale = each(
        n,
        expression(lambda i, first, flow, p: factor(i, response(i, first[i], flow, p), flow, p)),
    )

    @expression
    def with_images(flow: Flow, distances: Any, arms: Any, p: Any) -> Flow:
        z, area = heights(flow, p), coverages(flow, p)
        source = sources(area, flow.active)
        return Flow(
            flow.radius_m,
            flow.position_x_m,
            flow.position_y_m,
            z,
            area,
            flow.active,
            flow.speed_rad_s,
            neighbours(source, z, distances),
            bodies(z, arms),
            weight(source),
            flow.voltage_V,
            flow.elapsed_s,
            flow.time_s,
            flow.pitch_rad,
            flow.rate_rad_s,
            flow.cos_pitch,
            flow.weight_N,
            flow.thrust_N,
            flow.load_direction,
            flow.plate_x_m,
        )

    return DiscThrust(
        speeds=each(n, expression(lambda i, flow, p: speed(i, flow.speed_rad_s[i], flow, p))),
        with_images=with_images,
        image_factors=image_factors,
        scaled=scale,
        drags=each(n, expression(lambda i, first, flow, p: drag(i, first[i], flow, p))),
        factors=expression(lambda flow, p: scale(image_factors(flow, p), flow, p)),
        nearest_z_over_R=nearest,
    )


@cache
def _neighbours_of(i: int, n: int) -> Hook:
    """Return f(source, z, distances): the images of all other discs at disc i (eq. 3), no loop.

    A loop inside would keep the compiler from running several lanes at once.
    """
    return added(tuple(_neighbour(i, j) for j in range(n) if j != i))


@cache
def _neighbour(i: int, j: int) -> Hook:
    return expression(
        lambda source, z, distances: source[j] * image_velocity(z[i], distances[i][j])
    )


@cache
def _body_image(j: int, count: int) -> Hook:
    return expression(lambda height_m, arms: count * image_velocity(height_m, arms[j]))
