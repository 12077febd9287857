"""Thrust of every disc near a surface: the only place where the terms of eqs. (2) to (4) meet.

The factor of disc i is F_i = 1 / (1 - D_i), D_i the sum of all effects' terms (own image, images
of the neighbours, body lift, ...); a disc covered in part takes 1 + a_i (F_i - 1), blades answer to
that, and effects' factors multiply it. Which heights enter the images under tilt is the tilt rule
(`tilt`): usually the image of disc j lies z_i + z_j below disc i, and the body term is one
number, at the height of the body's centre. The same functions serve a sweep's arrays, a pitch bench
and every surface under a vehicle in flight.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache, lru_cache
from itertools import accumulate
from typing import Any, NamedTuple

from benchtool.core.errors import InputError
from benchtool.physics.body_lift import BodyImages
from benchtool.physics.distance_law import nearest_z_over_R
from benchtool.physics.effects.effect import N_BEFORE_RATE, N_CONSTANT, NO_FLOW, Effect, Flow
from benchtool.physics.expression import expression
from benchtool.physics.fold import (
    BoundHook,
    Hook,
    added,
    chained,
    multiplied,
    selected,
    summed,
    unrolled,
)
from benchtool.physics.images import clamped_height, partial_factor, thrust_factor
from benchtool.physics.tilt import Plane, axis_cosine, height_over, tilt_rule
from benchtool.physics.wake_rules import wake_rule


class ImageRules(NamedTuple):
    """Name how images are summed: wake rule (`wake_rules`), tilt rule (`tilt`), how many sources
    the body term has, and for each the first that it equals where nothing slopes along y; () for
    planes that do. What is equal is worked out once in a compiled loop.
    """

    wake: str
    tilt: str
    n_body: int
    body_like: tuple[int, ...] = ()


class DiscThrust(NamedTuple):
    """Hold the joined functions; `p` is the tuple of all effects' values, in their order.

    Attributes:
        tilt: tilt(p) -> lean of the plate beyond what was commanded: rad.
        speeds: speeds(flow, p) -> commanded speeds, changed by effects (n,).
        with_images: with_images(flow, distances, body, p) -> the flow with heights and coverages
            changed by effects, and the images that follow: distances [n][n] between discs: m, and
            the `BodyImages` of eq. (4).
        image_factors: image_factors(flow, p) -> 1 + a (1/(1 - D) - 1) of each disc (n,).
        scaled: scaled(first, flow, p) -> what blades make of first (n,), times effects' factors.
        drags: drags(first, flow, p) -> drag torque over that far away (n,), for `first`.
        factors: factors(flow, p) -> T_IGE/T_OGE of each disc (n,): both together.
        nearest_z_over_R: least distance at which the effects' law holds; clamped heights end there.
    """

    tilt: Hook
    speeds: Hook
    with_images: Hook
    image_factors: Hook
    scaled: Hook
    drags: Hook
    factors: Hook
    nearest_z_over_R: float


NO_CHANGE = expression(lambda i, first, flow, p: 1.0)  # drag torque where no effect changes it


def bound_hooks(
    effects: Iterable[Effect], hook: str, of: Callable[[Effect], bool] = lambda effect: True
) -> tuple[BoundHook, ...]:
    """Return one hook of every effect that has it, with the place of the effect's numbers."""
    all_effects = tuple(effects)
    ends = accumulate((len(effect.parameters) for effect in all_effects), initial=0)
    return tuple(
        BoundHook(call, effect.makes_p, start, start + len(effect.parameters))
        for effect, start in zip(all_effects, ends, strict=False)
        if (call := getattr(effect.hooks, hook)) is not None and of(effect)
    )


@expression
def identity_hook(z_m: Any, radius_m: Any) -> Any:
    """Return the height."""
    return z_m


@cache
def _held_at(nearest_z_over_R: float) -> Hook:
    return expression(lambda z, radius: clamped_height(z, nearest_z_over_R * radius))


@lru_cache(maxsize=256)
def disc_thrust(
    effects: tuple[Effect, ...], n_discs: int, rules: ImageRules, *, clamped: bool = False
) -> DiscThrust:
    """Return the joined functions of effects for a number of discs.

    Args:
        effects: that act, in the order in which they change quantities and are summed.
        clamped: hold heights at the least where the formulae are valid; for simulators.
    """
    n = n_discs
    height, coverage = (
        chained(bound_hooks(effects, "height")),
        chained(bound_hooks(effects, "coverage")),
    )
    speed, factor = (
        chained(bound_hooks(effects, "speed")),
        multiplied(bound_hooks(effects, "factor")),
    )
    elsewhere = any(law and law.surface != "below" for law in (e.distance_law for e in effects))
    law = summed(
        bound_hooks(effects, "denominator", lambda effect: effect.distance_law is not None)
    )
    # A surface above or beside has no images in a surface below: its law stands alone.
    others = summed(
        bound_hooks(effects, "denominator", lambda e: not elsewhere and e.distance_law is None)
    )
    kept = multiplied(bound_hooks(effects, "image_share"))
    response, torques = chained(bound_hooks(effects, "response")), bound_hooks(effects, "drag")
    if len(torques) > 1:
        raise InputError("two effects of the model have the hook drag; leave one out")
    drag = chained(torques) if torques else NO_CHANGE
    weight, share_of = wake_rule(rules.wake), tilt_rule(rules.tilt).share
    tilt = summed(bound_hooks(effects, "tilt"))
    nearest = nearest_z_over_R(effect.distance_law for effect in effects)
    held = _held_at(nearest) if clamped else identity_hook
    neighbours, bodies = _neighbours(n, rules), _bodies(n, rules, held)
    heights = unrolled(n, expression(lambda i, flow, p: height(i, flow.height_m[i], flow, p)))
    all_held = unrolled(n, expression(lambda i, z, radius: held(z[i], radius)))
    mean_change = _mean_change(n if bound_hooks(effects, "height") else 0)
    coverages = unrolled(n, expression(lambda i, flow, p: coverage(i, flow.coverage[i], flow, p)))
    sources = unrolled(n, expression(lambda i, area, active: area[i] * active[i]))
    counted = unrolled(n, expression(lambda i, images, share: images[i] * share))
    image_factors = unrolled(
        n,
        expression(
            lambda i, flow, p: partial_factor(
                thrust_factor(
                    kept(i, flow.axial_share * law(i, flow, p) + others(i, flow, p), flow, p)
                ),
                flow.coverage[i],
            )
        ),
    )
    scale = unrolled(
        n, expression(lambda i, first, flow, p: factor(i, response(i, first[i], flow, p), flow, p))
    )

    @expression
    def with_images(flow: Flow, distances: Any, body_at: BodyImages, p: Any) -> Flow:
        free, area = heights(flow, p), coverages(flow, p)
        z, source = all_held(free, flow.radius_m), sources(area, flow.active)
        plane = Plane(
            flow.plane.centre_m + mean_change(free, flow), flow.plane.slope_x, flow.plane.slope_y
        )
        share = share_of(axis_cosine(plane))
        return Flow(  # type: ignore[call-arg]  # mypy takes the first star for all fields
            *flow[:N_CONSTANT],
            z,
            area,
            counted(neighbours(source, z, distances), share),
            counted(bodies(z, plane, body_at, flow.radius_m), share),
            weight(source),
            plane,
            share,
            *flow[N_BEFORE_RATE:],
        )

    return DiscThrust(
        tilt=expression(lambda p: tilt(0, NO_FLOW, p)),
        speeds=unrolled(n, expression(lambda i, flow, p: speed(i, flow.speed_rad_s[i], flow, p))),
        with_images=with_images,
        image_factors=image_factors,
        scaled=scale,
        drags=unrolled(n, expression(lambda i, first, flow, p: drag(i, first[i], flow, p))),
        factors=expression(lambda flow, p: scale(image_factors(flow, p), flow, p)),
        nearest_z_over_R=nearest,
    )


@cache
def _mean_change(n: int) -> Hook:
    """Return f(z, flow): by how much effects change n discs' heights in the mean; 0 without any."""
    changes, share = added(tuple(_change(i) for i in range(n))), 1.0 / max(n, 1)
    return expression(lambda z, flow: share * changes(z, flow))


@cache
def _change(i: int) -> Hook:
    return expression(lambda z, flow: z[i] - flow.height_m[i])


@cache
def _neighbours(n: int, rules: ImageRules) -> Hook:
    """Return f(source, z, distances): at each disc the images of all other discs (eq. 3)."""
    image = tilt_rule(rules.tilt).image
    return unrolled(n, selected(tuple(_neighbours_of(i, n, image) for i in range(n))))


@cache
def _neighbours_of(i: int, n: int, image: Hook) -> Hook:
    """Return the same at disc i, without a loop.

    A loop inside would keep the compiler from running several lanes at once.
    """
    return added(tuple(_neighbour(i, j, image) for j in range(n) if j != i))


@cache
def _neighbour(i: int, j: int, image: Hook) -> Hook:
    low, high = min(i, j), max(i, j)  # one place for both ways: half the roots, once compiled
    return expression(
        lambda source, z, distances: source[j] * image(z[i], z[j], distances[low][high])
    )


@cache
def _bodies(n: int, rules: ImageRules, held: Hook) -> Hook:
    """Return f(z, plane, body_at, radius): for each disc the images of all at the body (eq. 4)."""
    rule = tilt_rule(rules.tilt)
    sources = rules.body_like or range(rules.n_body)
    body = added(tuple(_body_image(j, rule.image, held) for j in sources))
    if not rule.one_body:
        return unrolled(n, expression(lambda i, z, *where: body(z[i], *where)))
    for_each = unrolled(n, expression(lambda i, found: found))
    return expression(
        lambda z, plane, body_at, radius: for_each(
            body(held(plane.centre_m, radius), plane, body_at, radius)
        )
    )


@cache
def _body_image(j: int, image: Hook, held: Hook) -> Hook:
    """Return f(at, plane, body_at, radius): velocity at height `at` from source j of the body."""
    return expression(
        lambda at, plane, body_at, radius: image(
            at, held(height_over(plane, body_at.x_m[j], body_at.y_m[j]), radius), body_at.arm_m[j]
        )
    )
