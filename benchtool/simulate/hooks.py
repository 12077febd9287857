"""The hooks of a set of effects, joined into what a simulation's loop calls."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Sequence
from typing import Any

from benchtool.core.errors import InputError
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.disc_thrust import ImageRules, bound_hooks, disc_thrust
from benchtool.physics.effects.effect import HOOKS, N_BEFORE_RATE, N_WITH_THRUST, Effect, Flow
from benchtool.physics.expression import expression, with_fields
from benchtool.physics.fold import chained, identity, summed
from benchtool.physics.model import Model
from benchtool.physics.tilt import LEVEL

LoopHooks = namedtuple(
    "LoopHooks",
    "bare tilt with_images image_factors scaled drags factors speeds with_thrust "
    "torque dry_friction dry_width dry_give gyro followed nearest_z_over_R",
)
"""Hold the joined functions of a set of effects over so many discs.

Attributes:
    bare: a Flow of given heights and coverages, without images.
    tilt, with_images, image_factors, scaled, drags, factors, speeds: see `DiscThrust`.
    with_thrust: with_thrust(flow, rate, k, factor) -> the Flow with thrusts, at another rate.
    torque, dry_friction, dry_width, dry_give: f(i, flow, p), of the hinge, summed over effects.
    gyro: gyro(time, pitch, rate, acceleration, p) -> the gyro's reading, changed by effects.
    followed: followed(before, after, p) -> rotor speeds half a plant step on, as effects have them,
        for those of the lag alone.
"""


def joined_hooks(
    effects: tuple[Effect, ...], n_discs: int, rules: ImageRules
) -> Callable[[], LoopHooks]:
    """Return a function that gives the hooks of effects, joined for so many discs.

    A compiled loop knows a function by its name, and cannot be handed a tuple of them: it calls
    this one.
    """
    zeros, ones = (0.0,) * n_discs, (1.0,) * n_discs
    thrust = disc_thrust(effects, n_discs, rules, clamped=True)

    @expression
    def bare(
        radius_m: Any, x_m: Any, y_m: Any, plane: Any, height: Any, coverage: Any, speed: Any,
        time_s: Any = 0.0, pitch: Any = 0.0, rate: Any = 0.0, cosine: Any = 1.0,
        weight_N: Any = 0.0, airspeed: Any = 0.0, acceleration: Any = 0.0,
    ) -> Flow:  # fmt: skip
        return Flow(
            radius_m, x_m, y_m, ones, speed, 0.0, 0.0, time_s, pitch, cosine, weight_N, 0.0, 0.0,
            airspeed, acceleration, height, coverage, zeros, zeros, 0.0, plane, 1.0, rate, zeros,
            0.0, 0.0, (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0),
        )  # fmt: skip

    @expression
    def with_thrust(flow: Any, rate: Any, k: Any, factor: Any) -> Flow:
        speed, thrusts = flow.speed_rad_s, factor
        for i in range(n_discs):
            thrusts = with_fields(thrusts, i, k * speed[i] * speed[i] * factor[i])
        return Flow(*flow[:N_BEFORE_RATE], rate, thrusts, *flow[N_WITH_THRUST:])  # type: ignore[call-arg]

    torque, dry_friction, dry_width, dry_give = (
        summed(bound_hooks(effects, hook))
        for hook in ("torque", "dry_friction", "dry_width", "dry_give")
    )
    reading = chained(bound_hooks(effects, "gyro_reading"))
    following = bound_hooks(effects, "followed_speed")
    speed_after = chained(following)

    @expression
    def gyro(time_s: Any, pitch: Any, rate: Any, acceleration: Any, p: Any) -> Any:
        flow = bare(
            0.0, zeros, zeros, LEVEL, zeros, zeros, zeros, time_s, pitch, rate,
            acceleration=acceleration,
        )  # fmt: skip
        return reading(0, rate, flow, p)

    @expression
    def each_followed(before: Any, after: Any, p: Any) -> Any:
        out, flow = after, bare(0.0, zeros, zeros, LEVEL, zeros, zeros, before)
        for i in range(n_discs):
            out = with_fields(out, i, speed_after(i, after[i], flow, p))
        return out

    followed = each_followed if following else expression(lambda before, after, p: after)
    tilt, speeds, with_images, image_factors, scaled, drags, factors, nearest = thrust
    return expression(
        lambda: LoopHooks(
            bare, tilt, with_images, image_factors, scaled, drags, factors, speeds, with_thrust,
            torque, dry_friction, dry_width, dry_give, gyro, followed, nearest,
        )
    )  # fmt: skip


def loop_effects(
    *models: Model, neutral_too: bool = False, in_flight: bool = False
) -> tuple[Effect, ...]:
    """Return the effects whose hooks a loop for these models calls, in catalogue order.

    Those that cannot act are left out, but for those that stand in every loop; with `neutral_too`
    every effect of the models stands in it, so that one compilation serves all values of their
    numbers. With `in_flight` only those that act there are called, and of those that cannot act
    the images alone stand in every loop: a flight sums them at every surface. Eq. (2) gives way to
    the laws that models have in its place. Lag, delay and random torque act through numbers of
    their own, see `motion_of`.
    """
    found = {
        name: effect
        for name, effect in EFFECTS.items()
        if effect.always_compiled and (effect.hooks.denominator or not in_flight)
    }
    for model in models:
        for effect in model.effects:
            hooks = effect.hooks
            outside = (hooks.lag_s, hooks.delay_s, hooks.random_torque)
            if any(outside) and sum(getattr(hooks, name) is not None for name in HOOKS) == 1:
                continue
            if neutral_too or effect.name in found or model.is_present(effect):
                found[effect.name] = effect
    acting = [effect for model in models for effect in model.present_effects]
    if laws := {effect.name for effect in acting if effect.distance_law is not None}:
        found = {name: e for name, e in found.items() if e.distance_law is None or name in laws}
    order = [*EFFECTS, *(name for name in found if name not in EFFECTS)]
    ordered = (found[name] for name in order if name in found)
    return tuple(effect for effect in ordered if effect.acts_in_flight or not in_flight)


def loop_numbers(model: Model, effects: Sequence[Effect]) -> tuple[float, ...]:
    """Return the effects' numbers in a model, neutral where it lacks them; one zero without any."""
    out = []
    for effect in effects:
        for item in effect.parameters:
            full = f"{effect.name}.{item.name}"
            neutral = item.value if item.neutral is None else item.neutral
            out.append(model.parameters[full].value if full in model.parameters else neutral)
    return tuple(out) or (0.0,)


def identities(effects: Sequence[Effect]) -> list[Any]:
    """Return what distinguishes the hooks of effects from all others, to key a compiled loop.

    Raises:
        InputError: a hook is a function that its name and file do not distinguish from others.
    """
    hooks = [[getattr(effect.hooks, name) for name in HOOKS] for effect in effects]
    for hook in (hook for own in hooks for hook in own if hook is not None):
        if "." in hook.__qualname__ or "<" in hook.__qualname__:
            raise InputError(
                f"the hook {hook.__qualname__} of {hook.__module__} is no function of its module; "
                f"simulations need hooks that can be imported"
            )
    return [
        (len(effect.parameters), [identity(hook) for hook in own])
        for effect, own in zip(effects, hooks, strict=True)
    ]
