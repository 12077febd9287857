"""Thrust of all discs near a surface: combination of the terms of eqs. (2) to (4).

The factor of disc i is F_i = 1 / (1 - D_i), D_i the sum of all terms (own image, neighbour images,
body lift, ...). A partly covered disc has 1 + a_i (F_i - 1); the response of the blades and the
factors of effects follow. The tilt rule (`images`) defines the heights: by default the image of
disc j is z_i + z_j below disc i, and the body term is evaluated once, at the height of the body's
centre. The same functions are used for sweeps, pitch benches and flights over any surface.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache, lru_cache
from itertools import accumulate
from typing import Any, NamedTuple

from benchtool.core.errors import InputError
from benchtool.physics.body_lift import BodyImages, wake_rule
from benchtool.physics.distance_law import nearest_z_over_R
from benchtool.physics.effects.effect import N_BEFORE_RATE, N_CONSTANT, NO_FLOW, Effect, Flow
from benchtool.physics.expression import expression, unless_zero
from benchtool.physics.fold import (
    BoundHook,
    Hook,
    chain_hooks,
    multiply_hooks,
    select_function,
    sum_functions,
    sum_hooks,
    unrolled,
)
from benchtool.physics.images import (
    Plane,
    axis_cosine,
    clamped_height,
    height_over,
    partial_factor,
    thrust_factor,
    tilt_rule,
)


class ImageRules(NamedTuple):
    """Rules for sums of images: wake rule (`body_lift`), tilt rule (`images`), number of sources of
    the body term, and for each source the first equal one for planes without slope along y; () for
    other planes. A compiled loop evaluates equal sources once.
    """

    wake: str
    tilt: str
    n_body: int
    body_like: tuple[int, ...] = ()


class DiscThrust(NamedTuple):
    """Combined functions of all effects; `p` is the tuple of their parameters, in their order."""

    tilt: Hook  # tilt(p) -> tilt of the plate in addition to the commanded one: rad
    speeds: Hook  # speeds(flow, p) -> commanded speeds, changed by effects (n,)
    # with_images(flow, distances, body, p) -> the flow with heights and coverages changed by
    # effects, and the resulting images; distances [n][n] between discs: m, body the `BodyImages` of
    # eq. (4)
    with_images: Hook
    image_factors: Hook  # image_factors(flow, p) -> 1 + a (1/(1 - D) - 1) of each disc (n,)
    # scaled(first, flow, p) -> response of the blades to the ratios `first` (n,), times the factors
    # of effects
    scaled: Hook
    # drags(first, flow, p) -> drag torque for the ratios `first` over that out of ground effect
    # (n,)
    drags: Hook
    factors: Hook  # factors(flow, p) -> T_IGE/T_OGE of each disc (n,): scaled image factors
    nearest_z_over_R: float  # minimum distance at which the law is valid; limit of clamped heights


NO_CHANGE = expression(lambda i, first, flow, p: 1.0)  # drag torque ratio without an effect on it


def bound_hooks(
    effects: Iterable[Effect],
    hook: str,
    is_selected: Callable[[Effect], bool] = lambda effect: True,
) -> tuple[BoundHook, ...]:
    """Return one hook of all effects that have it, with the positions of their parameters."""
    all_effects = tuple(effects)
    ends = accumulate((len(effect.parameters) for effect in all_effects), initial=0)
    return tuple(
        BoundHook(call, effect.build_p, start, start + len(effect.parameters))
        for effect, start in zip(all_effects, ends, strict=False)
        if (call := getattr(effect.hooks, hook)) is not None and is_selected(effect)
    )


@cache
def _clamp_hook(nearest_z_over_R: float, *, clamped: bool) -> Hook:
    """Return f(z, radius), the height clipped to the minimum, or unchanged."""
    if not clamped:
        return expression(lambda z, radius: z)
    return expression(lambda z, radius: clamped_height(z, nearest_z_over_R * radius))


@lru_cache(maxsize=256)
def disc_thrust(
    effects: tuple[Effect, ...], n_discs: int, rules: ImageRules, *, clamped: bool = False
) -> DiscThrust:
    """Return the combined functions of effects for a number of discs.

    Args:
        effects: present effects, in the order of composition and summation.
        clamped: clip heights to the minimum at which the law is valid; for simulators.
    """
    n = n_discs
    height = chain_hooks(bound_hooks(effects, "height"))
    coverage = chain_hooks(bound_hooks(effects, "coverage"))
    speed = chain_hooks(bound_hooks(effects, "speed"))
    factor = multiply_hooks(bound_hooks(effects, "factor"))
    is_below = not any(law and law.surface != "below" for law in (e.distance_law for e in effects))
    law = sum_hooks(
        bound_hooks(effects, "denominator", lambda effect: effect.distance_law is not None)
    )
    # Images of a surface below are ignored for a law of a surface above or beside the rotors
    others = sum_hooks(
        bound_hooks(effects, "denominator", lambda e: is_below and e.distance_law is None)
    )
    image_share = multiply_hooks(bound_hooks(effects, "image_share"))
    response, torques = chain_hooks(bound_hooks(effects, "response")), bound_hooks(effects, "drag")
    if len(torques) > 1:
        raise InputError("two effects of the model have the hook drag; remove one")
    drag = chain_hooks(torques) if torques else NO_CHANGE
    weight, axial_share = wake_rule(rules.wake), tilt_rule(rules.tilt).share
    tilt = sum_hooks(bound_hooks(effects, "tilt"))
    nearest = nearest_z_over_R(effect.distance_law for effect in effects)
    clamp = _clamp_hook(nearest, clamped=clamped)
    neighbours, bodies = _neighbours(n, rules), _bodies(n, rules, clamp)
    heights = unrolled(n, expression(lambda i, flow, p: height(i, flow.height_m[i], flow, p)))
    clamp_all = unrolled(n, expression(lambda i, z, radius: clamp(z[i], radius)))
    mean_change = _mean_change(n if bound_hooks(effects, "height") else 0)
    coverages = unrolled(n, expression(lambda i, flow, p: coverage(i, flow.coverage[i], flow, p)))
    sources = unrolled(n, expression(lambda i, area, active: area[i] * active[i]))
    scale_images = unrolled(n, expression(lambda i, images, share: images[i] * share))
    image_factors = unrolled(
        n,
        expression(
            lambda i, flow, p: partial_factor(
                thrust_factor(
                    image_share(i, flow.axial_share * law(i, flow, p) + others(i, flow, p), flow, p)
                ),
                flow.coverage[i],
            )
        ),
    )
    scale = unrolled(
        n, expression(lambda i, first, flow, p: factor(i, response(i, first[i], flow, p), flow, p))
    )

    @expression
    def with_images(flow: Flow, distances: Any, body: BodyImages, p: Any) -> Flow:
        raw_z, area = heights(flow, p), coverages(flow, p)
        z, source = clamp_all(raw_z, flow.radius_m), sources(area, flow.active)
        plane = Plane(
            flow.plane.centre_m + mean_change(raw_z, flow), flow.plane.slope_x, flow.plane.slope_y
        )
        share = axial_share(axis_cosine(plane))
        return Flow(  # type: ignore[call-arg]  # mypy takes the first star for all fields
            *flow[:N_CONSTANT],
            z,
            area,
            scale_images(neighbours(source, z, distances), share),
            scale_images(bodies(z, plane, body, flow.radius_m), share),
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
    """Return f(z, flow), the mean change of the heights of n discs by effects; 0 for n = 0."""
    changes, share = sum_functions(tuple(_change(i) for i in range(n))), 1.0 / max(n, 1)
    return expression(lambda z, flow: share * changes(z, flow))


@cache
def _change(i: int) -> Hook:
    return expression(lambda z, flow: z[i] - flow.height_m[i])


@cache
def _neighbours(n: int, rules: ImageRules) -> Hook:
    """Return f(source, z, distances), the images of all other discs at each disc (eq. 3)."""
    image = tilt_rule(rules.tilt).image
    return unrolled(n, select_function(tuple(_disc_neighbours(i, n, image) for i in range(n))))


@cache
def _disc_neighbours(i: int, n: int, image: Hook) -> Hook:
    """Return the same for disc i.

    Without a loop, so that the compiler can vectorise over lanes.
    """
    return sum_functions(tuple(_neighbour(i, j, image) for j in range(n) if j != i))


@cache
def _neighbour(i: int, j: int, image: Hook) -> Hook:
    low, high = min(i, j), max(i, j)  # same operands in both directions: half the roots if compiled
    return expression(
        lambda source, z, distances: unless_zero(
            source[j], source[j] * image(z[i], z[j], distances[low][high])
        )
    )


@cache
def _bodies(n: int, rules: ImageRules, clamp: Hook) -> Hook:
    """Return f(z, plane, body, radius), the images of all discs at the body, per disc (eq. 4)."""
    rule = tilt_rule(rules.tilt)
    sources = rules.body_like or range(rules.n_body)
    total = sum_functions(tuple(_body_image(j, rule.image, clamp) for j in sources))
    if not rule.one_body:
        return unrolled(n, expression(lambda i, z, *args: total(z[i], *args)))
    repeat = unrolled(n, expression(lambda i, velocity: velocity))
    return expression(
        lambda z, plane, body, radius: repeat(
            total(clamp(plane.centre_m, radius), plane, body, radius)
        )
    )


@cache
def _body_image(j: int, image: Hook, clamp: Hook) -> Hook:
    """Return f(z, plane, body, radius), the velocity at height z from source j of the body."""
    return expression(
        lambda z, plane, body, radius: image(
            z, clamp(height_over(plane, body.x_m[j], body.y_m[j]), radius), body.arm_m[j]
        )
    )
