"""Effects in a loop: hooks joined into the functions that it calls, and motion of the rotors.

Rotor speeds follow commands by a first-order lag and a delay, exact over plant steps.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.parameter import Parameter
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.disc_thrust import ImageRules, bound_hooks, disc_thrust
from benchtool.physics.effects.effect import HOOKS, N_BEFORE_RATE, N_WITH_THRUST, Effect, Flow
from benchtool.physics.expression import (
    expression,
    inlined_expression,
    read_record,
    with_fields,
    write_record,
)
from benchtool.physics.fold import chain_hooks, source_key, sum_hooks
from benchtool.physics.images import LEVEL
from benchtool.physics.model import Model

LoopHooks = namedtuple(
    "LoopHooks",
    "bare tilt with_images image_factors scaled drags factors speeds with_thrust "
    "torque dry_friction dry_width dry_give gyro followed nearest_z_over_R",
)
"""Joined functions of a set of effects for a number of discs.

Attributes:
    bare: returns a Flow for heights and coverages, without images.
    tilt, with_images, image_factors, scaled, drags, factors, speeds: see `DiscThrust`.
    with_thrust: with_thrust(flow, rate, k, factor) -> the Flow with thrusts and another rate.
    torque, dry_friction, dry_width, dry_give: f(i, flow, p) of the hinge, summed over effects.
    gyro: gyro(time, pitch, rate, acceleration, p) -> the gyro reading with the effects.
    followed: followed(before, after, p) -> rotor speeds after half a plant step with the effects;
        `after` are those of the lag alone.
"""


def joined_hooks(
    effects: tuple[Effect, ...], n_discs: int, rules: ImageRules
) -> Callable[[], LoopHooks]:
    """Return a function that returns the hooks of effects, joined for a number of discs.

    A compiled loop can call functions by name but cannot take a tuple of them as an argument.
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
        sum_hooks(bound_hooks(effects, hook))
        for hook in ("torque", "dry_friction", "dry_width", "dry_give")
    )
    reading = chain_hooks(bound_hooks(effects, "gyro_reading"))
    followed_hooks = bound_hooks(effects, "followed_speed")
    speed_after = chain_hooks(followed_hooks)

    @expression
    def gyro(time_s: Any, pitch: Any, rate: Any, acceleration: Any, p: Any) -> Any:
        flow = bare(
            0.0, zeros, zeros, LEVEL, zeros, zeros, zeros, time_s, pitch, rate,
            acceleration=acceleration,
        )  # fmt: skip
        return reading(0, rate, flow, p)

    @expression
    def follow_all(before: Any, after: Any, p: Any) -> Any:
        speeds, flow = after, bare(0.0, zeros, zeros, LEVEL, zeros, zeros, before)
        for i in range(n_discs):
            speeds = with_fields(speeds, i, speed_after(i, after[i], flow, p))
        return speeds

    followed = follow_all if followed_hooks else expression(lambda before, after, p: after)
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

    Inactive effects are dropped, except those marked `always_compiled`; with `neutral_too` all
    effects of the models are included, so that one compilation serves all parameter values. With
    `in_flight` only effects that act in flight are included, and of the inactive ones only the
    images: a flight sums them at every surface. Laws of the models replace eq. (2). Lag, delay and
    random torque are not hooks of the loop, see `build_motion`.
    """
    included = {
        name: effect
        for name, effect in EFFECTS.items()
        if effect.always_compiled and (effect.hooks.denominator or not in_flight)
    }
    for model in models:
        for effect in model.effects:
            hooks = effect.hooks
            motion_hooks = (hooks.lag_s, hooks.delay_s, hooks.random_torque)
            if any(motion_hooks) and sum(getattr(hooks, name) is not None for name in HOOKS) == 1:
                continue
            if neutral_too or effect.name in included or model.is_present(effect):
                included[effect.name] = effect
    present = [effect for model in models for effect in model.present_effects]
    if laws := {effect.name for effect in present if effect.distance_law is not None}:
        included = {
            name: e for name, e in included.items() if e.distance_law is None or name in laws
        }
    order = [*EFFECTS, *(name for name in included if name not in EFFECTS)]
    ordered = (included[name] for name in order if name in included)
    return tuple(effect for effect in ordered if effect.acts_in_flight or not in_flight)


def loop_numbers(model: Model, effects: Sequence[Effect]) -> tuple[float, ...]:
    """Return the parameter values of effects in a model, neutral if absent; (0,) without any."""
    values = []
    for effect in effects:
        for parameter in effect.parameters:
            full_name = f"{effect.name}.{parameter.name}"
            is_present = full_name in model.parameters
            values.append(
                model.parameters[full_name].value if is_present else neutral_value(parameter)
            )
    return tuple(values) or (0.0,)


def neutral_value(parameter: Parameter) -> float:
    """Return the value at which a parameter is absent, its default if there is none."""
    return parameter.value if parameter.neutral is None else parameter.neutral


def identities(effects: Sequence[Effect]) -> list[Any]:
    """Return the identities of the hooks of effects by name and file, as key of a compiled loop."""
    hooks = [[getattr(effect.hooks, name) for name in HOOKS] for effect in effects]
    for hook in (hook for effect_hooks in hooks for hook in effect_hooks if hook is not None):
        if "." in hook.__qualname__ or "<" in hook.__qualname__:
            raise InputError(
                f"hook {hook.__qualname__} of {hook.__module__} is not a function of its module; "
                f"simulations need hooks that can be imported"
            )
    return [
        (len(effect.parameters), [source_key(hook) for hook in effect_hooks])
        for effect, effect_hooks in zip(effects, hooks, strict=True)
    ]


Rotors = namedtuple("Rotors", "speed_rad_s")  # per disc, in flight per rotor: speed (rad/s)

# Per disc, in flight per rotor: last commanded speed, and the delayed commands at the beginning and
# the end of a plant step.
Targets = namedtuple("Targets", "sent_rad_s old_rad_s new_rad_s")

# Weights over half a plant step: of the speed before it, and of the delayed commands at beginning
# and end of the step.
Lag = namedtuple("Lag", "remains old new", defaults=(0.0, 0.0, 0.0))

# Over a plant step: lag of both halves, decay factor of the random torque and standard deviation of
# its innovation (N m), and delay of commands in whole steps.
Motion = namedtuple(
    "Motion",
    "first second wake_decay wake_innovation_Nm delay_steps",
    defaults=(Lag(), Lag(), 0.0, 0.0, 0.0),
)


@expression
def first_order_lag(lag: Any, speed: Any, old: Any, new: Any) -> Any:
    """Return the speed of each rotor after half a plant step: rad/s."""
    speeds = speed
    for i in range(len(speed)):
        next_speed = lag.remains * speed[i] + lag.old * old[i] + lag.new * new[i]
        speeds = with_fields(speeds, i, next_speed)
    return speeds


@inlined_expression
def apply_delayed_commands(
    w: Any, lane: Any, lanes: Any, sent: Any, step: Any, substeps: Any, slots: Any
) -> None:
    """Write the delayed commands at beginning and end of a plant step."""
    motion = read_record(w, slots.motion, lane, lanes)
    targets = read_record(w, slots.targets, lane, lanes)
    delayed_step, ring = step - int(motion.delay_steps), sent.shape[1]
    before, after = ((delayed_step - 1) // substeps) % ring, (delayed_step // substeps) % ring
    old, new = targets.old_rad_s, targets.new_rad_s
    for i in range(len(old)):
        old = with_fields(old, i, sent[i, before, lane])
        new = with_fields(new, i, sent[i, after, lane])
    write_record(w, slots.targets, lane, lanes, Targets(targets.sent_rad_s, old, new))


def build_motion(model: Model, dt_s: float) -> Motion:
    """Return lag, delay and random torque of a model for plant steps."""
    tau_s, delay_s = model.lag_s, model.delay_s
    delay_steps = int(np.floor(delay_s / dt_s + 1e-9))
    remaining_delay_s, half_s = max(delay_s - delay_steps * dt_s, 0.0), 0.5 * dt_s

    def decay(duration_s: float) -> float:
        """Return the share of the distance to a command that remains after a duration."""
        if duration_s <= 0.0:
            return 1.0
        return float(np.exp(-duration_s / tau_s)) if tau_s > 0.0 else 0.0

    def half_step_lag(old_s: float) -> Lag:
        """Return the lag over half a step, of which the first `old_s` use the old command."""
        before, after = decay(old_s), decay(half_s - old_s)
        return Lag(before * after, (1.0 - before) * after, 1.0 - after)

    wake_decay = wake_innovation = 0.0
    if model.random_torque is not None:
        sd, correlation_s = model.random_torque
        wake_decay = np.exp(-dt_s / correlation_s)
        wake_innovation = sd * np.sqrt(1.0 - wake_decay**2)
    first = half_step_lag(min(remaining_delay_s, half_s))
    second = half_step_lag(max(remaining_delay_s - half_s, 0.0))
    return Motion(first, second, wake_decay, wake_innovation, float(delay_steps))
